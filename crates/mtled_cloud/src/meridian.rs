//! Nodes and triangles of the meridian half plane of an upright cylinder: what an axisymmetric model needs of a cloud.
//!
//! ```text
//! domain, spacing ─► path, edges ─► interior, relaxation ─► order ─► triangles ─► smoothing ─► triangles ─► Meridian
//! ```
//!
//! Points are (r, 0, z), so that whatever knows distances in space knows them here as well: the same [`Spacing`] with
//! the same features grades both kinds of cloud.

mod relax;

use crate::domain::Domain;
use crate::error::CloudError;
use crate::faces::{BASE, SIDE, TOP};
use crate::grid::Grid;
use crate::nodes::equidistribute;
use crate::order::hilbert_order;
use crate::packing::Packing;
use crate::path::path_shape;
use crate::solid::{Curve, changes};
use crate::spacing::{Feature, MAX_NODES, Spacing};
use crate::triangulate::{orient, triangulate};
use crate::vector::{Point, add, between, distance, hash01, scale, sub};
use std::f64::consts::PI;

/// Nearest accepted distance as a fraction of the spacing.
const GAP: f64 = 0.86;
/// Candidates round each node.
const TRIES: usize = 10;
/// Distance kept from the edges of the half plane, as a fraction of the spacing.
const CLEARANCE: f64 = 0.55;
/// Iterations of the relaxation, and how often the neighbours are looked up anew.
const RELAXATIONS: usize = 36;
const REFRESH: usize = 6;
/// Sweeps of smoothing over the first triangles.
const SWEEPS: usize = 2;
/// Lowest shape of a triangle, 4 √3 area over the sum of its squared edges: 1 if equilateral, 0 if flat.
pub(crate) const LEAST_SHAPE: f64 = 0.35;
/// Distance from an interface at which the regions on its sides are looked up, over the smaller of radius and height.
const OFF: f64 = 1e-6;
/// Nodes per square of the spacing in a dense packing, 2/√3.
const DENSITY: f64 = 1.1547;

/// Nodes and triangles of a meridian half plane, m.
#[derive(Clone, Debug, PartialEq)]
pub struct Meridian {
    /// (r, 0, z) of each node, along a Hilbert curve; r is exactly 0 on the axis.
    pub points: Vec<Point>,
    /// Counter-clockwise with r to the right and z up.
    pub triangles: Vec<[u32; 3]>,
    /// Faces of the body that each node lies on: [`BASE`], [`TOP`], [`SIDE`] (its lowest bit).
    pub faces: Vec<u8>,
}

/// The bit of a cylinder's side.
const WALL: u8 = SIDE & SIDE.wrapping_neg();

impl Meridian {
    /// Lowest shape of any triangle.
    #[must_use]
    pub fn lowest_shape(&self) -> f64 {
        let shape = |t: &[u32; 3]| {
            let p = t.map(|v| self.points[v as usize]);
            let squares: f64 = (0..3).map(|k| distance(p[k], p[(k + 1) % 3]).powi(2)).sum();
            2.0 * 3f64.sqrt() * orient(p[0], p[1], p[2]) / squares
        };
        self.triangles.iter().map(shape).fold(1.0, f64::min)
    }
}

/// Generates the half plane of a cylinder for a spacing whose features lie on the axis or go round it.
///
/// # Errors
/// A body that is not a cylinder, a number out of its range, too many nodes, or features too close for the spacing.
pub fn meridian(domain: &Domain, spacing: &Spacing) -> Result<Meridian, CloudError> {
    let Domain::Cylinder { radius, height } = *domain else {
        return Err(CloudError::NotMeshable { reason: "only a cylinder has a meridian half plane".to_owned() });
    };
    spacing.validate_features(domain)?;
    let plane = Plane { domain, spacing, radius, height };
    plane.affordable()?;
    let mut nodes = plane.edges()?;
    plane.fill(&mut nodes)?;
    plane.relax(&mut nodes);
    let order = hilbert_order(&nodes.points);
    let pick = |i: &u32| *i as usize;
    let mut points: Vec<Point> = order.iter().map(|i| nodes.points[pick(i)]).collect();
    let fixed: Vec<bool> = order.iter().map(|i| pick(i) < nodes.fixed).collect();
    let faces = points.iter().map(|p| plane.faces(*p)).collect();
    for _ in 0..SWEEPS {
        let triangles = triangulate(&points)?;
        plane.smooth(&mut points, &fixed, &triangles);
    }
    let triangles = triangulate(&points)?;
    let meridian = Meridian { points, triangles, faces };
    let lowest = meridian.lowest_shape();
    if lowest < LEAST_SHAPE {
        let reason = format!("a triangle of shape {lowest:.3} is left (least allowed: {LEAST_SHAPE})");
        return Err(CloudError::NotMeshable { reason });
    }
    Ok(meridian)
}

/// Nodes under construction: the first `fixed` may not move.
struct Nodes {
    points: Vec<Point>,
    fixed: usize,
}

struct Plane<'a> {
    domain: &'a Domain<'a>,
    spacing: &'a Spacing,
    radius: f64,
    height: f64,
}

impl Plane<'_> {
    /// Spacing at a point: a thin region has that of its boundaries throughout, or the row of nodes between them would have gaps, and each
    /// makes the region stiffer.
    fn h(&self, p: Point) -> f64 {
        self.spacing.at(self.domain, p).min(self.spacing.within(p))
    }

    /// Distance to the nearest edge of the half plane, the axis being one, or interface between regions.
    fn room(&self, p: Point) -> f64 {
        let edges = p[0].min(self.radius - p[0]).min(p[2]).min(self.height - p[2]);
        edges.min(self.spacing.interface_distance(self.height, p))
    }

    fn reserved(&self, p: Point) -> bool {
        Packing::new(self.domain, self.spacing).reserved(p)
    }

    fn faces(&self, p: Point) -> u8 {
        let bit = |on: bool, bit: u8| if on { bit } else { 0 };
        bit(p[2] == 0.0, BASE) | bit(p[2] == self.height, TOP) | bit(p[0] == self.radius, WALL)
    }

    /// Refuses more than [`MAX_NODES`] nodes before anything is allocated: area over spacing squared, and what the
    /// refinement round each feature adds at most.
    fn affordable(&self) -> Result<(), CloudError> {
        let mut nodes = DENSITY * self.radius * self.height / (self.spacing.far * self.spacing.far);
        for f in &self.spacing.features {
            // a half disc of directions round a point of the half plane, or a strip along the axis
            let (near, far, g) = (f.spacing(), self.spacing.far, self.spacing.growth);
            let along = if f.path_nodes() > 0 { self.height } else { 0.0 };
            nodes += DENSITY * (PI / (g * g) * (1.0 + (far / near).ln()) + along / (g * near));
        }
        self.spacing.room_for_cells(nodes, 2.0, 2.0 * crate::BYTES_PER_NODE).map(drop)
    }

    fn grid(&self, points: &[Point]) -> Grid {
        // one layer of cubes
        let cell = (self.radius * self.height / (2.0 * points.len().max(512) as f64)).sqrt();
        let mut grid = Grid::new([0.0, 0.0, 0.0], [self.radius, cell, self.height], points.len().max(512));
        grid.refill(points);
        grid
    }

    /// Layers of a needle's path, edges of contact, and the half plane's own edges.
    fn edges(&self) -> Result<Nodes, CloudError> {
        let mut points = Vec::new();
        let (mut inner, mut floor, mut marks) = (0.0, self.height, Vec::new());
        for f in &self.spacing.features {
            match *f {
                Feature::Path { axis, capture_radius, length, spacing } => {
                    for depth in self.spacing.layers(self.domain, &axis, length, spacing) {
                        let z = self.height - depth;
                        let fine = self.spacing.along(self.domain, &axis, spacing, depth);
                        let (_, rings) = path_shape(capture_radius, length, fine);
                        let place = |ring: usize| [capture_radius * (ring as f64 / rings as f64), 0.0, z];
                        points.extend((0..=rings).map(place));
                        floor = z;
                    }
                    inner = capture_radius;
                }
                Feature::ContactRing { radius, .. } => marks.push(radius),
                Feature::Rim { .. } | Feature::Region { .. } | Feature::Patch { .. } | Feature::FinePath { .. } => {}
            }
        }
        let (r, h) = (self.radius, self.height);
        points.extend([[0.0, 0.0, 0.0], [r, 0.0, 0.0], [r, 0.0, h]]);
        if inner == 0.0 {
            points.push([0.0, 0.0, h]);
        }
        let mut top = vec![inner];
        top.extend(marks.iter().copied());
        top.push(r);
        points.extend(marks.iter().map(|&m| [m, 0.0, h]));
        let ends = self.interfaces([inner, floor], &mut points);
        for between in top.windows(2) {
            self.broken_line([between[0], 0.0, h], [between[1], 0.0, h], &ends, &mut points);
        }
        self.broken_line([0.0, 0.0, 0.0], [r, 0.0, 0.0], &ends, &mut points);
        self.broken_line([r, 0.0, 0.0], [r, 0.0, h], &ends, &mut points);
        self.broken_line([0.0, 0.0, 0.0], [0.0, 0.0, floor], &ends, &mut points);
        self.too_close(&points)?;
        Ok(Nodes { fixed: points.len(), points })
    }

    /// Nodes on the interfaces between regions, but not on a needle's path, which ends at `floor` and has the radius
    /// `inner`. Returns the ends of the stretches: where interfaces meet each other, the axis or an edge.
    fn interfaces(&self, [inner, floor]: [f64; 2], points: &mut Vec<Point>) -> Vec<Point> {
        let mut ends: Vec<Point> = Vec::new();
        let mut stretches = Vec::new();
        let off = OFF * self.radius.min(self.height);
        for curve in self.spacing.solids().flat_map(|solid| solid.curves(self.radius)) {
            // the regions on both sides, if they differ
            let sides = |t: f64| {
                let (p, q) = (curve.at(t), curve.at(if t < 0.5 { t + 1e-4 } else { t - 1e-4 }));
                let along = sub(q, p);
                let normal = scale([along[2], 0.0, -along[0]], off / crate::vector::norm(along));
                let within = p[0] <= self.radius && p[2] > off && p[2] < self.height - off;
                let captured = inner > 0.0 && p[0] < inner * (1.0 + 1e-9) && p[2] > floor - off;
                let sides = [self.spacing.region(add(p, normal)), self.spacing.region(sub(p, normal))];
                let between = [sides[0].min(sides[1]), sides[0].max(sides[1])];
                (within && !captured && sides[0] != sides[1]).then_some(between)
            };
            let mut at = vec![0.0];
            at.extend(changes(&sides).into_iter().flatten());
            at.push(1.0);
            for stretch in at.chunks_exact(2).filter(|s| sides(0.5 * (s[0] + s[1])).is_some()) {
                stretches.push((curve, [stretch[0], stretch[1]]));
                ends.extend([stretch[0], stretch[1]].map(|t| self.snapped(curve.at(t))));
            }
        }
        for &p in &ends {
            self.push_apart(p, points);
        }
        for (curve, [a, b]) in stretches {
            let piece = |t: f64| curve.at(a + t * (b - a));
            for t in equidistribute(self.domain, self.spacing, &piece, false, 1) {
                let p = piece(t);
                // where a sphere comes nearer to a face than nodes are apart, the face has its nodes
                let gap = p[2].min(self.height - p[2]).min(self.radius - p[0]);
                if !matches!(curve, Curve::Arc { .. }) || gap > 0.5 * self.h(p) {
                    self.push_apart(p, points);
                }
            }
        }
        ends
    }

    /// A point on the axis or an edge of the half plane to the last digit, if it is there at all.
    fn snapped(&self, [r, y, z]: Point) -> Point {
        // an interface is followed to a distance of `OFF` from base and top
        let near = 2.0 * OFF * self.radius.min(self.height);
        let snap = |x: f64, to: f64| if (x - to).abs() < near { to } else { x };
        [snap(snap(r, 0.0), self.radius), y, snap(snap(z, 0.0), self.height)]
    }

    /// Adds a node unless there is one nearly there.
    fn push_apart(&self, p: Point, points: &mut Vec<Point>) {
        let least = 0.5 * self.h(p);
        if points.iter().all(|&q| distance(p, q) > least) && !self.reserved_for_path(p) {
            points.push(p);
        }
    }

    /// Whether a node there would disturb the layers of a path: a quarter of a spacing from them is enough for a fixed one.
    fn reserved_for_path(&self, p: Point) -> bool {
        self.reserved(p)
            && self.spacing.features.iter().any(|f| match *f {
                Feature::Path { capture_radius, spacing, .. } => p[0] < capture_radius + 0.45 * spacing,
                _ => false,
            })
    }

    /// Nodes on a straight edge that is broken at those of the places that lie on it.
    fn broken_line(&self, a: Point, b: Point, places: &[Point], points: &mut Vec<Point>) {
        let k = if a[0] == b[0] { 2 } else { 0 };
        let on = |p: &&Point| p[2 - k] == a[2 - k] && p[k] > a[k] && p[k] < b[k];
        let mut ends: Vec<Point> = places.iter().filter(on).copied().collect();
        ends.extend([a, b]);
        ends.sort_by(|p, q| p[k].total_cmp(&q[k]));
        ends.dedup();
        ends.windows(2).for_each(|ends| self.line(ends[0], ends[1], points));
    }

    /// Nodes between the ends of a straight edge, one spacing apart.
    fn line(&self, a: Point, b: Point, points: &mut Vec<Point>) {
        let curve = |t: f64| between(a, b, t);
        points.extend(equidistribute(self.domain, self.spacing, &curve, false, 1).into_iter().map(curve));
    }

    fn too_close(&self, points: &[Point]) -> Result<(), CloudError> {
        let grid = self.grid(points);
        for (i, &p) in points.iter().enumerate() {
            let h = self.h(p);
            let mut other = p;
            let is_other = |j: u32, _: f64| {
                other = points[j as usize];
                j as usize != i
            };
            if grid.any(points, p, 0.4 * h, is_other) {
                return Err(CloudError::too_close(p, other, h));
            }
        }
        Ok(())
    }

    /// An advancing front of candidates round every node, each accepted if no node is nearer than [`GAP`] spacings.
    fn fill(&self, nodes: &mut Nodes) -> Result<(), CloudError> {
        let mut grid = self.grid(&nodes.points);
        let mut spacings: Vec<f64> = nodes.points.iter().map(|&p| self.h(p)).collect();
        let mut next = 0;
        while next < nodes.points.len() {
            let p = nodes.points[next];
            let turn = hash01(next as u64, 1);
            next += 1;
            for k in 0..TRIES {
                let (sin, cos) = (2.0 * PI * (k as f64 + turn) / TRIES as f64).sin_cos();
                let way = [cos, 0.0, sin];
                let candidate = add(p, scale(way, self.stride(p, way)));
                let h = self.h(candidate);
                if self.room(candidate) < CLEARANCE * h
                    || self.reserved(candidate)
                    || grid.crowded(&nodes.points, &spacings, candidate, h, [GAP, self.spacing.growth])
                {
                    continue;
                }
                nodes.points.push(candidate);
                grid.push(candidate);
                spacings.push(h);
            }
            if nodes.points.len() > MAX_NODES {
                return Err(CloudError::NotMeshable { reason: format!("more than {MAX_NODES} nodes") });
            }
        }
        Ok(())
    }

    /// Distance from p to a candidate: the mean of the spacings at both ends.
    fn stride(&self, p: Point, way: Point) -> f64 {
        let h = self.h(p);
        let once = 0.5 * (h + self.h(add(p, scale(way, h))));
        0.5 * (h + self.h(add(p, scale(way, once))))
    }
}
