//! Nodes on edges and features: rims, box edges, contact rings, the layers of a needle path.

use crate::domain::Domain;
use crate::error::CloudError;
use crate::faces::{BASE, MIRROR, SIDE, TOP};
use crate::interfaces;
use crate::nodes::{Nodes, circle, equidistribute};
use crate::outline::Outline;
use crate::path::{Axis, path_shape};
use crate::skin;
use crate::solid::changes;
use crate::spacing::{Feature, Spacing};
use crate::vector::{Point, add, distance, dot, norm, scale, sub};

/// Nodes on the straight line from a to b, between those that lie on it already, its ends among them.
fn fill_line(domain: &Domain, spacing: &Spacing, nodes: &mut Nodes, [a, b]: [Point; 2], faces: u8) {
    let way = sub(b, a);
    let length = norm(way);
    let on_line = |p: &Point| {
        let t = dot(sub(*p, a), way) / (length * length);
        let gap = distance(*p, add(a, scale(way, t)));
        (gap <= ON_LINE * length && (-ON_LINE..=1.0 + ON_LINE).contains(&t)).then_some(t)
    };
    let mut stops: Vec<(f64, Point)> = nodes.points.iter().filter_map(|p| Some((on_line(p)?, *p))).collect();
    stops.sort_by(|p, q| p.0.total_cmp(&q.0));
    for stretch in stops.windows(2) {
        let (from, to) = (stretch[0].1, stretch[1].1);
        let curve = |t: f64| [0, 1, 2].map(|k| if a[k] == b[k] { a[k] } else { from[k] + t * (to[k] - from[k]) });
        for t in equidistribute(domain, spacing, &curve, false, 1) {
            if !in_path(domain, spacing, curve(t)) {
                nodes.push(curve(t), faces, true);
            }
        }
    }
}

/// Whether a point is within the capture radius of a path, whose nodes are its own: a layer that is turned by half a
/// pitch has none on the plane of symmetry but that of the axis.
fn in_path(domain: &Domain, spacing: &Spacing, p: Point) -> bool {
    spacing.features.iter().any(|feature| match *feature {
        Feature::Path { axis, capture_radius, length, .. } => {
            let depth = domain.height() - p[2];
            depth <= length / axis.secant() && axis.distance(domain.height(), p) <= capture_radius
        }
        _ => false,
    })
}

/// Distance from a line over its length below which a node lies on it.
const ON_LINE: f64 = 1e-9;

/// The edges of a half body's plane of symmetry, and where layers meet it.
fn mirror_lines(domain: &Domain, spacing: &Spacing, nodes: &mut Nodes) {
    let (low, high) = domain.bounds();
    let ends = |z: f64| [[low[0], 0.0, z], [high[0], 0.0, z]];
    for x in [low[0], high[0]] {
        let side = if x < 0.0 || !domain.is_plane(SIDE) { 4 } else { 8 };
        fill_line(domain, spacing, nodes, [[x, 0.0, low[2]], [x, 0.0, high[2]]], side | MIRROR);
    }
    fill_line(domain, spacing, nodes, ends(low[2]), BASE | MIRROR);
    fill_line(domain, spacing, nodes, ends(high[2]), TOP | MIRROR);
    for z in interfaces::heights(domain, spacing) {
        fill_line(domain, spacing, nodes, ends(z), MIRROR);
    }
}

/// All nodes that are fixed from the start.
///
/// # Errors
/// Two features closer to each other than half their spacing.
pub(crate) fn place(domain: &Domain, spacing: &Spacing) -> Result<Nodes, CloudError> {
    let mut nodes = Nodes::default();
    rims(domain, spacing, &mut nodes);
    let height = domain.height();
    for f in &spacing.features {
        match *f {
            Feature::ContactRing { centre, radius, .. } if domain.is_half() => {
                half_circle(domain, spacing, &mut nodes, centre, radius, height, [TOP, TOP | MIRROR, TOP | MIRROR]);
            }
            Feature::ContactRing { centre, radius, .. } => {
                let curve = circle(centre, radius, height);
                for t in equidistribute(domain, spacing, &curve, true, 8) {
                    nodes.push(on_top(domain, curve(t))?, TOP, true);
                }
            }
            Feature::Path { axis, capture_radius, length, spacing: fine } => {
                let layers = spacing.layers(domain, &axis, length, fine);
                let rings = |depth| path_shape(capture_radius, length, spacing.along(domain, &axis, fine, depth)).1;
                let first = nodes.points.len();
                path(&mut nodes, domain, &axis, capture_radius, &rings, &layers);
                if let Some(outline) = domain.outline() {
                    outline.holds_path(&axis, capture_radius, length)?;
                    fit_to_top(domain, outline, fine, &mut nodes, first)?;
                }
            }
            Feature::Rim { .. } | Feature::Region { .. } | Feature::Patch { .. } | Feature::FinePath { .. } => {}
        }
    }
    interfaces::place_edges(domain, spacing, &mut nodes);
    if let Some(outline) = domain.outline() {
        skin::place_creases(outline, spacing, &mut nodes);
    }
    if domain.is_half() {
        mirror_lines(domain, spacing, &mut nodes);
    }
    too_close(domain, spacing, &nodes)?;
    Ok(nodes)
}

fn rims(domain: &Domain, spacing: &Spacing, nodes: &mut Nodes) {
    match *domain {
        Domain::Cylinder { radius, height } => {
            for (z, face) in [(0.0, BASE), (height, TOP)] {
                let curve = circle([0.0, 0.0], radius, z);
                for t in equidistribute(domain, spacing, &curve, true, 6) {
                    nodes.push(curve(t), face | 4, true);
                }
            }
        }
        Domain::HalfCylinder { radius, height } => {
            for (z, face) in [(0.0, BASE), (height, TOP)] {
                let corner = face | 4 | MIRROR;
                half_circle(domain, spacing, nodes, [0.0; 2], radius, z, [face | 4, corner, corner]);
            }
        }
        Domain::Box { .. } | Domain::HalfBox { .. } => box_edges(domain, spacing, nodes),
        // after the features, which meet its surface where they do
        Domain::Outline(_) => {}
    }
}

/// A point of the top face: of an outline's above or below a place.
fn on_top(domain: &Domain, p: Point) -> Result<Point, CloudError> {
    let Some(outline) = domain.outline() else { return Ok(p) };
    match outline.height_of(TOP, [p[0], p[1]]) {
        Some(z) => Ok([p[0], p[1], z]),
        None => Err(CloudError::NotMeshable {
            reason: format!("the instrument reaches beyond the contact surface at {p:?} m"),
        }),
    }
}

/// Moves a path's first layer onto a surface that is no plane, and leaves out what lies above it or next to it.
fn fit_to_top(
    domain: &Domain,
    outline: &Outline,
    spacing: f64,
    nodes: &mut Nodes,
    first: usize,
) -> Result<(), CloudError> {
    let path = nodes.points.split_off(first);
    let faces = nodes.faces.split_off(first);
    nodes.fixed.truncate(first);
    for (p, faces) in path.into_iter().zip(faces) {
        if faces & TOP != 0 {
            nodes.push(on_top(domain, p)?, faces, true);
        } else if outline.depth(p) > UNDER * spacing {
            nodes.push(p, faces, true);
        }
    }
    Ok(())
}

/// Least depth of a path's nodes below a surface that is no plane, over the spacing.
const UNDER: f64 = 0.5;

/// The half of a circle with y >= 0: the bits of its nodes' faces, and those of the ends at +x and -x.
fn half_circle(
    domain: &Domain,
    spacing: &Spacing,
    nodes: &mut Nodes,
    centre: [f64; 2],
    radius: f64,
    z: f64,
    [faces, first, last]: [u8; 3],
) {
    let whole = circle(centre, radius, z);
    nodes.push([centre[0] + radius, 0.0, z], first, true);
    nodes.push([centre[0] - radius, 0.0, z], last, true);
    let curve = |t: f64| whole(0.5 * t);
    for t in equidistribute(domain, spacing, &curve, false, 4) {
        nodes.push(curve(t), faces, true);
    }
}

fn box_edges(domain: &Domain, spacing: &Spacing, nodes: &mut Nodes) {
    let (low, high) = domain.bounds();
    let corner = |bits: usize| [0, 1, 2].map(|k| if bits >> k & 1 == 1 { high[k] } else { low[k] });
    let faces = |p: Point| {
        let on = |k: usize, low_bit: u8, high_bit: u8| {
            let ends = [(low[k], low_bit), (high[k], high_bit)];
            ends.into_iter().find(|(end, _)| p[k] == *end).map_or(0, |(_, bit)| bit)
        };
        on(0, 4, 8) | on(1, if domain.is_half() { MIRROR } else { 16 }, 32) | on(2, BASE, TOP)
    };
    for bits in 0..8 {
        nodes.push(corner(bits), faces(corner(bits)), true);
    }
    for axis in 0..3 {
        for bits in (0..8).filter(|b| b >> axis & 1 == 0) {
            let (a, b) = (corner(bits), corner(bits | 1 << axis));
            if faces(a) & faces(b) & MIRROR != 0 {
                // these come last
                continue;
            }
            let curve = |t: f64| {
                let mut p = a;
                p[axis] = a[axis] + t * (b[axis] - a[axis]);
                p
            };
            for t in equidistribute(domain, spacing, &curve, false, 1) {
                nodes.push(curve(t), faces(curve(t)), true);
            }
        }
    }
}

/// A layer this close to another one, over the spacing, is left out.
const CLOSEST_LAYER: f64 = 0.4;

impl Spacing {
    /// Vertical depths of the layers of a path: equal steps between the places where its axis passes from one region to
    /// another, or steps that grow from an [`Feature::FinePath`] on.
    pub(crate) fn layers(&self, domain: &Domain, axis: &Axis, length: f64, spacing: f64) -> Vec<f64> {
        let height = domain.height();
        let depth = length / axis.secant();
        let curve = |t: f64| axis.section(height, t * depth, 0.0, 0.0);
        let mut crossings = self.crossings(&curve);
        if let Some(outline) = domain.outline() {
            crossings.extend(changes(&|t| outline.group_at(curve(t))).into_iter().map(|[a, b]| 0.5 * (a + b)));
            crossings.sort_by(f64::total_cmp);
        }
        let mut ends = vec![0.0];
        for t in crossings {
            let apart = |other: f64| length * (t - other).abs() > CLOSEST_LAYER * spacing;
            if apart(1.0) && ends.last().is_none_or(|&last| apart(last)) {
                ends.push(t);
            }
        }
        ends.push(1.0);
        let mut layers = vec![0.0];
        for stretch in ends.windows(2) {
            let within = |t: f64| stretch[0] + t * (stretch[1] - stretch[0]);
            if stretch.iter().any(|end| self.along(domain, axis, spacing, depth * end) < spacing) {
                let curve = |t: f64| axis.section(height, depth * within(t), 0.0, 0.0);
                let graded = equidistribute(domain, self, &curve, false, 1);
                layers.extend(graded.into_iter().map(|t| depth * within(t)));
                layers.push(depth * stretch[1]);
                continue;
            }
            let (steps, _) = path_shape(spacing, length * (stretch[1] - stretch[0]), spacing);
            let at = |k: usize| stretch[0] + (stretch[1] - stretch[0]) * (k as f64 / steps as f64);
            layers.extend((1..=steps).map(|k| depth * at(k)));
        }
        layers
    }

    /// Number of nodes that a path has within its capture radius (0 for other features).
    pub(crate) fn path_nodes(&self, domain: &Domain, path: &Feature) -> usize {
        let Feature::Path { axis, capture_radius, length, spacing } = *path else { return 0 };
        let nodes = |(layer, depth): (usize, f64)| {
            let (_, rings) = path_shape(capture_radius, length, self.along(domain, &axis, spacing, depth));
            if domain.is_half() {
                // the axis and half of each ring; those that aren't turned have two nodes more on the plane
                return 1 + 3 * rings * (rings + 1) / 2 + (1 - layer % 2) * rings;
            }
            1 + 3 * rings * (rings + 1)
        };
        self.layers(domain, &axis, length, spacing).into_iter().enumerate().map(nodes).sum()
    }
}

/// Layers of rings of 6, 12, 18, ... nodes round an axis node, at these depths; every other layer is turned by half a pitch. A half body
/// has those with y >= 0.
fn path(nodes: &mut Nodes, domain: &Domain, axis: &Axis, radius: f64, rings: &dyn Fn(f64) -> usize, layers: &[f64]) {
    let mut push = |p: Point, faces: u8| {
        let near = ON_LINE * radius;
        match domain.is_half() {
            true if p[1] < -near => {}
            true if p[1] <= near => nodes.push([p[0], 0.0, p[2]], faces | MIRROR, true),
            _ => nodes.push(p, faces, true),
        }
    };
    for (layer, &depth) in layers.iter().enumerate() {
        let faces = if layer == 0 { TOP } else { 0 };
        push(axis.section(domain.height(), depth, 0.0, 0.0), faces);
        let rings = rings(depth);
        for ring in 1..=rings {
            let r = radius * (ring as f64 / rings as f64);
            let turn = if layer % 2 == 1 { 0.5 } else { 0.0 };
            for k in 0..6 * ring {
                push(axis.section(domain.height(), depth, r, (k as f64 + turn) / (6 * ring) as f64), faces);
            }
        }
    }
}

fn too_close(domain: &Domain, spacing: &Spacing, nodes: &Nodes) -> Result<(), CloudError> {
    let (low, high) = domain.bounds();
    let mut grid = crate::grid::Grid::new(low, high, nodes.points.len());
    for &p in &nodes.points {
        let h = spacing.at(domain, p);
        let mut other = p;
        let is_other = |j: u32, _: f64| {
            other = nodes.points[j as usize];
            true
        };
        if grid.any(&nodes.points, p, 0.4 * h, is_other) {
            return Err(CloudError::too_close(p, other, h));
        }
        grid.push(p);
    }
    Ok(())
}
