//! Fills faces, then the interior, with nodes one spacing apart: an advancing front of candidates round every node that
//! is already there, each accepted if nothing is nearer than a fraction of the spacing; then a relaxation by
//! short-range forces.

use crate::domain::Domain;
use crate::grid::Grid;
use crate::nodes::Nodes;
use crate::spacing::{Feature, Spacing};
use crate::vector::{Point, add, hash01, norm, scale, sub};
use std::f64::consts::PI;

/// Nearest accepted distance as a fraction of the spacing, on faces and inside.
const FACE_GAP: f64 = 0.86;
pub(crate) const BODY_GAP: f64 = 0.83;
/// Distance between nearest neighbours over the spacing.
pub const PACKED: f64 = 0.91;
/// Candidates round each node.
const FACE_TRIES: usize = 10;
/// Distance kept from faces and their edges, as a fraction of the spacing.
const CLEARANCE: f64 = 0.55;
/// Iterations of the relaxation on faces and inside, and how often the neighbours are looked up anew.
const FACE_RELAXATIONS: usize = 24;
const BODY_RELAXATIONS: usize = 6;
const REFRESH: usize = 6;

/// Nodes that a caller of [`crate::generate_with`] brings.
pub struct OwnNodes {
    /// Places, m, all different.
    pub nodes: Vec<Point>,
    /// Whether a place is kept free of all other nodes.
    pub keeps_free: Box<dyn Fn(Point) -> bool>,
}

/// Whether a place is kept free; `None`: none is.
type Kept = Option<Box<dyn Fn(Point) -> bool>>;

/// The room inside a body whose faces and interfaces have their nodes.
pub struct Room<'a> {
    packing: &'a Packing<'a>,
    nodes: &'a Nodes,
    grid: &'a Grid,
    spacings: &'a [f64],
}

impl Room<'_> {
    /// Lowest and highest coordinates of the body, m.
    #[must_use]
    pub fn bounds(&self) -> (Point, Point) {
        self.packing.domain.bounds()
    }

    /// Wanted distance between nearest nodes at a place, m.
    #[must_use]
    pub fn distance(&self, p: Point) -> f64 {
        self.packing.h(p)
    }

    /// Whether surface and interfaces are at least so far from a place, m.
    #[must_use]
    pub fn is_clear(&self, p: Point, least: f64) -> bool {
        let Packing { domain, spacing, .. } = self.packing;
        domain.depth_to(p, least).min(spacing.interface_distance(domain.height(), p)) >= least
    }

    /// Whether no node is nearer than this to a place, m.
    #[must_use]
    pub fn is_empty(&self, p: Point, radius: f64) -> bool {
        !self.grid.any(&self.nodes.points, p, radius, |_, _| true)
    }

    /// Whether a place, off the layers of needle paths, is as far from the nodes that there are as nodes have to be.
    #[must_use]
    pub fn takes(&self, p: Point) -> bool {
        let growth = self.packing.spacing.growth;
        let crowded = || self.grid.crowded(&self.nodes.points, self.spacings, p, self.distance(p), [BODY_GAP, growth]);
        !self.packing.reserved(p) && !crowded()
    }
}

/// What the fill needs to know.
pub(crate) struct Packing<'a> {
    pub(crate) domain: &'a Domain<'a>,
    pub(crate) spacing: &'a Spacing,
    /// What the caller keeps free of other nodes for its own.
    kept: Kept,
}

impl<'a> Packing<'a> {
    pub(crate) fn new(domain: &'a Domain<'a>, spacing: &'a Spacing) -> Self {
        Self { domain, spacing, kept: None }
    }
}

impl Packing<'_> {
    /// Distance between nearest neighbours that makes edges one spacing long on average.
    pub(crate) fn h(&self, p: Point) -> f64 {
        PACKED * self.spacing.at(self.domain, p)
    }

    /// Distance from p to a candidate in direction `way` (unit): the mean of the spacings at both ends.
    pub(crate) fn stride(&self, p: Point, h: f64, way: Point) -> f64 {
        let once = 0.5 * (h + self.h(add(p, scale(way, h))));
        0.5 * (h + self.h(add(p, scale(way, once))))
    }

    /// Is the place kept free for the layers of a needle path, or for the caller's own nodes?
    pub(crate) fn reserved(&self, p: Point) -> bool {
        let height = self.domain.height();
        self.kept.as_ref().is_some_and(|kept| kept(p))
            || self.spacing.features.iter().any(|f| match *f {
                Feature::Path { axis, capture_radius, length, spacing } => {
                    let spacing = self.spacing.along(self.domain, &axis, spacing, height - p[2]);
                    axis.distance(height, p) < capture_radius + 0.6 * spacing
                        && p[2] > height - length / axis.secant() - 0.6 * spacing
                }
                _ => false,
            })
    }

    fn grid(&self, nodes: &Nodes, expected: f64) -> Grid {
        let (low, high) = self.domain.bounds();
        let mut grid = Grid::new(low, high, (expected as usize).max(nodes.points.len()));
        grid.refill(&nodes.points);
        grid
    }

    /// Fills every face, then the interior, with about so many nodes in all; relaxes each. `own`: nodes of the caller's, between the two.
    pub(crate) fn fill(
        &mut self,
        nodes: &mut Nodes,
        expected: f64,
        own: Option<&mut dyn FnMut(&Room<'_>) -> OwnNodes>,
    ) {
        let mut grid = self.grid(nodes, expected);
        let mut spacings: Vec<f64> = nodes.points.iter().map(|&p| self.h(p)).collect();
        for &face in self.domain.faces() {
            self.fill_face(nodes, &mut grid, &mut spacings, face);
        }
        if let Some(outline) = self.domain.outline() {
            self.fill_skin(outline, nodes, &mut grid, &mut spacings);
        }
        self.relax(nodes, &mut grid, FACE_RELAXATIONS, |faces| faces.count_ones() == 1);
        spacings = nodes.points.iter().map(|&p| self.h(p)).collect();
        self.fill_interfaces(nodes, &mut grid, &mut spacings);
        spacings = nodes.points.iter().map(|&p| self.h(p)).collect();
        if let Some(own) = own {
            let own = own(&Room { packing: self, nodes, grid: &grid, spacings: &spacings });
            for p in own.nodes {
                nodes.push(p, 0, true);
                grid.push(p);
                spacings.push(self.h(p));
            }
            self.kept = Some(own.keeps_free);
        }
        self.fill_body(nodes, &mut grid, &mut spacings);
        self.relax(nodes, &mut grid, BODY_RELAXATIONS, |faces| faces == 0);
    }

    fn fill_face(&self, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>, face: u8) {
        let mut front: Vec<u32> =
            (0..nodes.points.len() as u32).filter(|&i| nodes.faces[i as usize] & face != 0).collect();
        let mut next = 0;
        while next < front.len() {
            let seed = front[next];
            let p = nodes.points[seed as usize];
            next += 1;
            let h = self.h(p);
            let [t1, t2] = self.domain.tangents(face, p);
            let turn = hash01(u64::from(seed), 1);
            for k in 0..FACE_TRIES {
                let (sin, cos) = (2.0 * PI * (k as f64 + turn) / FACE_TRIES as f64).sin_cos();
                let way = add(scale(t1, cos), scale(t2, sin));
                let candidate = self.domain.project(face, add(p, scale(way, self.stride(p, h, way))));
                let gap = self.h(candidate);
                if self
                    .domain
                    .edge_distance(face, candidate)
                    .min(self.spacing.interface_distance(self.domain.height(), candidate))
                    < CLEARANCE * gap
                    || self.reserved(candidate)
                    || grid.crowded(&nodes.points, spacings, candidate, gap, [FACE_GAP, self.spacing.growth])
                {
                    continue;
                }
                front.push(nodes.points.len() as u32);
                nodes.push(candidate, face, false);
                grid.push(candidate);
                spacings.push(gap);
            }
        }
    }

    fn fill_body(&self, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>) {
        let directions = icosahedron();
        let mut next = 0;
        while next < nodes.points.len() {
            let p = nodes.points[next];
            let frame = rotation(next as u64);
            next += 1;
            let h = self.h(p);
            for d in directions {
                let turned = add(add(scale(frame[0], d[0]), scale(frame[1], d[1])), scale(frame[2], d[2]));
                let candidate = add(p, scale(turned, self.stride(p, h, turned)));
                if !self.domain.is_inside(candidate) {
                    continue;
                }
                let gap = self.h(candidate);
                if self
                    .domain
                    .depth_to(candidate, gap)
                    .min(self.spacing.interface_distance(self.domain.height(), candidate))
                    < CLEARANCE * gap
                    || self.reserved(candidate)
                    || grid.crowded(&nodes.points, spacings, candidate, gap, [BODY_GAP, self.spacing.growth])
                {
                    continue;
                }
                nodes.push(candidate, 0, false);
                grid.push(candidate);
                spacings.push(gap);
            }
        }
    }

    fn relax(&self, nodes: &mut Nodes, grid: &mut Grid, iterations: usize, chosen: impl Fn(u8) -> bool) {
        let movable: Vec<u32> = (0..nodes.points.len() as u32)
            .filter(|&i| !nodes.fixed[i as usize] && chosen(nodes.faces[i as usize]))
            .collect();
        let mut near: Vec<u32> = Vec::new();
        let mut start: Vec<usize> = Vec::new();
        let mut moved: Vec<Point> = vec![[0.0; 3]; movable.len()];
        let mut spacings: Vec<f64> = Vec::new();
        for iteration in 0..iterations {
            if iteration % REFRESH == 0 {
                spacings = nodes.points.iter().map(|&p| self.h(p)).collect();
                near.clear();
                start.clear();
                for &i in &movable {
                    start.push(near.len());
                    let p = nodes.points[i as usize];
                    grid.any(&nodes.points, p, 1.7 * spacings[i as usize], |j, _| {
                        if j != i
                            && (nodes.faces[i as usize] == 0 || nodes.faces[j as usize] & nodes.faces[i as usize] != 0)
                        {
                            near.push(j);
                        }
                        false
                    });
                }
                start.push(near.len());
            }
            for (k, &i) in movable.iter().enumerate() {
                moved[k] = self.relaxed(nodes, &spacings, i, &near[start[k]..start[k + 1]]);
            }
            for (k, &i) in movable.iter().enumerate() {
                nodes.points[i as usize] = moved[k];
            }
            if iteration % REFRESH == REFRESH - 1 {
                grid.refill(&nodes.points);
            }
        }
    }

    fn relaxed(&self, nodes: &Nodes, spacings: &[f64], i: u32, near: &[u32]) -> Point {
        let (p, face) = (nodes.points[i as usize], nodes.faces[i as usize]);
        let h = spacings[i as usize];
        let mut q = pushed(p, h, near.iter().map(|&j| (nodes.points[j as usize], spacings[j as usize])));
        let room = if face == 0 {
            self.domain.depth_to(q, h)
        } else {
            q = self.domain.project(face, q);
            self.domain.edge_distance(face, q)
        };
        let room = room.min(self.spacing.interface_distance(self.domain.height(), q));
        if room < CLEARANCE * h || self.reserved(q) { p } else { q }
    }
}

/// Where short-range forces 1.125 - 2.375 w² + 1.25 w³ up to w = 1.5, w = distance over spacing (bubble packing, Shimada and
/// Gossard 1995), take a node at p with the spacing h, from others with theirs.
pub(crate) fn pushed(p: Point, h: f64, others: impl Iterator<Item = (Point, f64)>) -> Point {
    let mut force = [0.0; 3];
    for (q, spacing) in others {
        let d = sub(p, q);
        let length = norm(d);
        let w = 2.0 * length / (h + spacing);
        if length > 0.0 && w < 1.5 {
            let f = 1.125 + w * w * (1.25 * w - 2.375);
            force = add(force, scale(d, f / length));
        }
    }
    add(p, scale(force, 0.2 * h / norm(force).max(1.0)))
}

/// Unit vectors to the twelve corners of an icosahedron: the neighbours in a dense packing.
fn icosahedron() -> [Point; 12] {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let s = 1.0 / (1.0 + golden * golden).sqrt();
    let (a, b) = (s, golden * s);
    std::array::from_fn(|i| {
        let (a, b) = ([a, -a][i / 2 % 2], [b, -b][i % 2]);
        [[0.0, a, b], [a, b, 0.0], [b, 0.0, a]][i / 4]
    })
}

/// A rotation fixed by the node's number (uniform quaternion of hashed numbers).
fn rotation(i: u64) -> [Point; 3] {
    let (u, v, w) = (hash01(i, 2), 2.0 * PI * hash01(i, 3), 2.0 * PI * hash01(i, 4));
    let (r1, r2) = ((1.0 - u).sqrt(), u.sqrt());
    let [x, y, z, s] = [r1 * v.sin(), r1 * v.cos(), r2 * w.sin(), r2 * w.cos()];
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * s), 2.0 * (x * z - y * s)],
        [2.0 * (x * y - z * s), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * s)],
        [2.0 * (x * z + y * s), 2.0 * (y * z - x * s), 1.0 - 2.0 * (x * x + y * y)],
    ]
}
