//! Nodes on the boundaries of regions in space: on their edges and where they meet the body's side first, then over the
//! surfaces by an advancing front, relaxed within the surface. Those on surfaces may slide there after that, the others are fixed.

use crate::domain::Domain;
use crate::faces::INTERFACE;
use crate::faces::MIRROR;
use crate::grid::Grid;
use crate::nodes::{Nodes, circle, equidistribute};
use crate::packing::{Packing, pushed};
use crate::solid::Solid;
use crate::spacing::Spacing;
use crate::vector::{Point, add, between, distance, hash01, norm, scale, sub, tangents};
use std::f64::consts::PI;

/// A curve over its parameter from 0 to 1, whether it is closed, and the bits of the faces that it lies on.
type Edge = (Box<dyn Fn(f64) -> Point>, bool, u8);

/// Nearest accepted distance as a fraction of the spacing, and distance kept from faces.
const GAP: f64 = 0.86;
const CLEARANCE: f64 = 0.55;
const TRIES: usize = 10;
const RELAXATIONS: usize = 18;
/// "On the interface of two groups of a mesh", over the spacing.
const AT: f64 = 0.3;
/// "On the surface", over the height of the body.
const ON: f64 = 1e-7;

impl Solid {
    /// Outward normal of the surface of equal distance through p.
    fn normal(&self, p: Point, step: f64) -> Point {
        let slope = |k: usize| {
            let (mut a, mut b) = (p, p);
            a[k] -= step;
            b[k] += step;
            self.signed(b) - self.signed(a)
        };
        let n = [0, 1, 2].map(slope);
        let length = norm(n);
        if length > 0.0 { scale(n, 1.0 / length) } else { [0.0, 0.0, 1.0] }
    }

    /// The point of the boundary next to p, nearly.
    fn onto(&self, p: Point, step: f64) -> Point {
        let once = |p: Point| sub(p, scale(self.normal(p, step), self.signed(p)));
        match *self {
            Self::Layer { bottom, top } => {
                let z = if (p[2] - bottom).abs() < (p[2] - top).abs() { bottom } else { top };
                [p[0], p[1], z]
            }
            _ => once(once(p)),
        }
    }

    /// Edges of the boundary within a body, and where it meets the body's side.
    fn edges(&self, domain: &Domain) -> Vec<Edge> {
        let line = |a: Point, b: Point| move |t: f64| between(a, b, t);
        let mut edges: Vec<Edge> = Vec::new();
        match (*self, *domain) {
            (Self::Layer { bottom, top }, Domain::Cylinder { radius, .. }) => {
                for z in [bottom, top] {
                    edges.push((Box::new(circle([0.0; 2], radius, z)), true, 4));
                }
            }
            (Self::Layer { bottom, top }, Domain::HalfCylinder { radius, .. }) => {
                for z in [bottom, top] {
                    let whole = circle([0.0; 2], radius, z);
                    for x in [radius, -radius] {
                        edges.push((Box::new(move |_| [x, 0.0, z]), true, 4 | MIRROR));
                    }
                    edges.push((Box::new(move |t| whole(0.5 * t)), false, 4));
                }
            }
            (Self::Layer { bottom, top }, Domain::HalfBox { size }) => {
                let (x, y) = (0.5 * size[0], 0.5 * size[1]);
                for z in [bottom, top] {
                    for (corner, faces) in
                        [([-x, 0.0], 4 | MIRROR), ([x, 0.0], 8 | MIRROR), ([-x, y], 36), ([x, y], 40)]
                    {
                        edges.push((Box::new(move |_| [corner[0], corner[1], z]), true, faces));
                    }
                    edges.push((Box::new(line([-x, 0.0, z], [-x, y, z])), false, 4));
                    edges.push((Box::new(line([x, 0.0, z], [x, y, z])), false, 8));
                    edges.push((Box::new(line([-x, y, z], [x, y, z])), false, 32));
                }
            }
            (Self::Layer { bottom, top }, Domain::Box { size }) => {
                let (x, y) = (0.5 * size[0], 0.5 * size[1]);
                for z in [bottom, top] {
                    edges.push((Box::new(line([-x, -y, z], [-x, y, z])), false, 4));
                    edges.push((Box::new(line([x, -y, z], [x, y, z])), false, 8));
                    edges.push((Box::new(line([-x, -y, z], [x, -y, z])), false, 16));
                    edges.push((Box::new(line([-x, y, z], [x, y, z])), false, 32));
                    for (corner, faces) in [([-x, -y], 20), ([x, -y], 24), ([-x, y], 36), ([x, y], 40)] {
                        edges.push((Box::new(move |_| [corner[0], corner[1], z]), true, faces));
                    }
                }
            }
            (Self::Sphere { centre, radius }, half) if half.is_half() => {
                let round = circle([centre[0], centre[2]], radius, 0.0);
                let upright = move |t: f64| {
                    let [x, z, y] = round(t);
                    [x, y, z]
                };
                edges.push((Box::new(upright), true, MIRROR));
            }
            (Self::Cylinder { centre: [x, _, z], radius, height }, half) if half.is_half() => {
                let ends = [z - 0.5 * height, z + 0.5 * height];
                for z in ends {
                    let whole = circle([x, 0.0], radius, z);
                    for x in [x - radius, x + radius] {
                        edges.push((Box::new(move |_| [x, 0.0, z]), true, MIRROR));
                    }
                    edges.push((Box::new(move |t| whole(0.5 * t)), false, 0));
                    edges.push((Box::new(line([x - radius, 0.0, z], [x + radius, 0.0, z])), false, MIRROR));
                }
                for x in [x - radius, x + radius] {
                    edges.push((Box::new(line([x, 0.0, ends[0]], [x, 0.0, ends[1]])), false, MIRROR));
                }
            }
            (Self::Cylinder { centre: [x, y, z], radius, height }, _) => {
                for z in [z - 0.5 * height, z + 0.5 * height] {
                    edges.push((Box::new(circle([x, y], radius, z)), true, 0));
                }
            }
            (Self::Box { centre, size }, _) => {
                let corner = move |bits: usize| {
                    [0, 1, 2].map(|k| centre[k] + size[k] * if bits >> k & 1 == 1 { 0.5 } else { -0.5 })
                };
                for bits in 0..8 {
                    edges.push((Box::new(move |_| corner(bits)), true, 0));
                    for axis in (0..3).filter(|axis| bits >> axis & 1 == 0) {
                        edges.push((Box::new(line(corner(bits), corner(bits | 1 << axis))), false, 0));
                    }
                }
            }
            (Self::Sphere { .. }, _) | (Self::Layer { .. }, Domain::Outline(_)) => {}
        }
        edges
    }
}

impl Spacing {
    /// One bit for each region that touches a point.
    pub(crate) fn touching(&self, domain: &Domain, p: Point) -> u64 {
        let near = ON * domain.height();
        let mut bits = 1 << self.region(p);
        if let Some(outline) = domain.outline() {
            if outline.interface_distance(p) < AT * self.at(domain, p) {
                return u64::MAX;
            }
            // a region of the scene comes before a group of the mesh
            let group = outline.group_at(p).map_or(0, |g| 32 + g % 32);
            bits = if bits == 1 { 1 << group } else { bits };
        }
        if self.interface_distance(domain.height(), p) < near {
            for k in 0..27 {
                let way = [k % 3, k / 3 % 3, k / 9].map(|i| 4.0 * near * (f64::from(i) - 1.0));
                let [x, y, z] = add(p, way);
                bits |= 1 << self.region([x, y, z.clamp(0.0, domain.height())]);
            }
        }
        bits
    }

    /// The point on the nearest boundary of a region that a node is moved to, if it lies between two regions there.
    pub(crate) fn onto_interface(&self, domain: &Domain, p: Point) -> Option<Point> {
        let step = 4.0 * ON * domain.height();
        let solid = self.solids().min_by(|a, b| a.signed(p).abs().total_cmp(&b.signed(p).abs()))?;
        let q = solid.onto(p, step);
        (solid.signed(q).abs() < 0.25 * step && self.parts(solid, q, step)).then_some(q)
    }

    /// Whether a point on a boundary lies between two regions.
    fn parts(&self, solid: &Solid, p: Point, step: f64) -> bool {
        let off = scale(solid.normal(p, step), step);
        self.region(add(p, off)) != self.region(sub(p, off))
    }
}

/// Heights at which layers end within a body.
pub(crate) fn heights(domain: &Domain, spacing: &Spacing) -> Vec<f64> {
    let step = 4.0 * ON * domain.height();
    let ends = spacing.solids().flat_map(|solid| match *solid {
        Solid::Layer { bottom, top } => vec![bottom, top],
        _ => Vec::new(),
    });
    let parts = |z: &f64| spacing.region([0.0, 0.0, z - step]) != spacing.region([0.0, 0.0, z + step]);
    let mut heights: Vec<f64> = ends.filter(|z| *z > step && *z < domain.height() - step).filter(parts).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup_by(|a, b| (*a - *b).abs() < step);
    heights
}

/// Nodes on the edges of the regions' boundaries, as far as they lie in the body.
pub(crate) fn place_edges(domain: &Domain, spacing: &Spacing, nodes: &mut Nodes) {
    let (step, whole) = (4.0 * ON * domain.height(), domain.whole());
    for solid in spacing.solids() {
        for (curve, closed, faces) in solid.edges(domain) {
            let point = distance(curve(0.0), curve(0.3)) == 0.0;
            let at = if point {
                vec![0.0]
            } else {
                equidistribute(domain, spacing, &curve, closed, if closed { 6 } else { 1 })
            };
            for p in at.into_iter().map(&curve) {
                let inside = p[2] > step && p[2] < domain.height() - step && domain.depth(p) > -step;
                let apart = |q: &Point| distance(p, *q) > 0.5 * spacing.at(domain, p);
                let bits = spacing.touching(domain, p);
                // a path's own nodes stand where it passes the boundary
                let free = !domain.is_half() || !Packing::new(domain, spacing).reserved(p);
                // where a sphere comes nearer to a face than nodes are apart, the face has its nodes
                let apart_from_faces =
                    !matches!(solid, Solid::Sphere { .. }) || whole.depth(p) > 0.5 * spacing.at(domain, p);
                if inside && free && apart_from_faces && bits.count_ones() > 1 && nodes.points.iter().all(apart) {
                    nodes.push(p, faces, true);
                }
            }
        }
    }
}

impl Packing<'_> {
    /// Fills the regions' boundaries with nodes, and fixes them.
    pub(crate) fn fill_interfaces(&self, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>) {
        for solid in self.spacing.solids() {
            self.fill_interface(solid, nodes, grid, spacings);
        }
    }

    fn fill_interface(&self, solid: &Solid, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>) {
        let height = self.domain.height();
        let (near, step) = (ON * height, 4.0 * ON * height);
        let on = |p: Point| solid.signed(p).abs() < near && self.domain.depth(p) > -near;
        let first = nodes.points.len();
        let mut front: Vec<u32> = (0..first as u32).filter(|&i| on(nodes.points[i as usize])).collect();
        let mut push = |nodes: &mut Nodes, grid: &mut Grid, p: Point, h: f64| {
            nodes.push(p, INTERFACE, false);
            grid.push(p);
            spacings.push(h);
        };
        if let (true, Solid::Sphere { centre, radius }) = (front.is_empty(), *solid) {
            let seed = add(centre, [0.0, 0.0, radius]);
            if self.accepts(solid, seed, step) {
                push(nodes, grid, seed, self.h(seed));
                front.push(first as u32);
            }
        }
        let mut next = 0;
        while next < front.len() {
            let seed = front[next];
            let p = nodes.points[seed as usize];
            next += 1;
            let [t1, t2] = tangents(solid.normal(p, step));
            let turn = hash01(u64::from(seed), 8);
            for k in 0..TRIES {
                let (sin, cos) = (2.0 * PI * (k as f64 + turn) / TRIES as f64).sin_cos();
                let way = add(scale(t1, cos), scale(t2, sin));
                let candidate = solid.onto(add(p, scale(way, self.h(p))), step);
                let h = self.h(candidate);
                let close = |q: &Point| distance(*q, candidate) < GAP * 0.5 * (h + self.h(*q));
                if !self.accepts(solid, candidate, step)
                    || within(grid, &nodes.points, candidate, 1.5 * h).any(|q| close(&q))
                {
                    continue;
                }
                front.push(nodes.points.len() as u32);
                push(nodes, grid, candidate, h);
            }
        }
        self.relax_interface(solid, nodes, first, step);
        grid.refill(&nodes.points);
    }

    /// Whether a node may be put there on an interface.
    fn accepts(&self, solid: &Solid, p: Point, step: f64) -> bool {
        self.domain.depth(p) > CLEARANCE * self.h(p)
            && solid.signed(p).abs() < step
            && !self.reserved(p)
            && self.spacing.parts(solid, p, step)
    }

    /// Short-range forces between the nodes from `first` on and all that lie on the surface.
    fn relax_interface(&self, solid: &Solid, nodes: &mut Nodes, first: usize, step: f64) {
        let on = |p: &Point| solid.signed(*p).abs() < step;
        for _ in 0..RELAXATIONS {
            let all: Vec<Point> = nodes.points.iter().copied().filter(on).collect();
            let mut grid = Grid::new(self.domain.bounds().0, self.domain.bounds().1, all.len().max(64));
            grid.refill(&all);
            let moved: Vec<Point> =
                nodes.points[first..].iter().map(|&p| self.pushed(solid, p, &all, &grid, step)).collect();
            nodes.points[first..].copy_from_slice(&moved);
        }
    }

    fn pushed(&self, solid: &Solid, p: Point, all: &[Point], grid: &Grid, step: f64) -> Point {
        let h = self.h(p);
        let near = within(grid, all, p, 1.7 * h).map(|q| (q, self.h(q)));
        let q = solid.onto(pushed(p, h, near), step);
        if self.accepts(solid, q, step) { q } else { p }
    }
}

fn within<'a>(grid: &Grid, points: &'a [Point], p: Point, r: f64) -> impl Iterator<Item = Point> + use<'a> {
    let mut found = Vec::new();
    grid.any(points, p, r, |j, _| {
        found.push(j);
        false
    });
    found.into_iter().map(|j| points[j as usize])
}
