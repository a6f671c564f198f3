//! Nodes under construction, and how they are spread along a curve.

use std::f64::consts::PI;

use crate::domain::Domain;
use crate::spacing::Spacing;
use crate::vector::{Point, distance};

/// Nodes under construction: position, faces they lie on (bits), and whether they may still move.
#[derive(Default)]
pub(crate) struct Nodes {
    pub(crate) points: Vec<Point>,
    pub(crate) faces: Vec<u8>,
    pub(crate) fixed: Vec<bool>,
}

impl Nodes {
    pub(crate) fn push(&mut self, p: Point, faces: u8, fixed: bool) {
        self.points.push(p);
        self.faces.push(faces);
        self.fixed.push(fixed);
    }
}

/// Parameters t in \[0, 1) of points along a closed or open curve such that each stretch is worth one spacing.
/// An open curve's own end points are left out.
pub(crate) fn equidistribute(
    domain: &Domain,
    spacing: &Spacing,
    curve: &dyn Fn(f64) -> Point,
    closed: bool,
    fewest: usize,
) -> Vec<f64> {
    let length: f64 = (0..64).map(|k| distance(curve(k as f64 / 64.0), curve((k + 1) as f64 / 64.0))).sum();
    let samples = ((4.0 * length / spacing.finest()) as usize).clamp(256, 1 << 20);
    let mut worth = Vec::with_capacity(samples + 1);
    worth.push(0.0);
    for k in 0..samples {
        let (a, b) = (k as f64 / samples as f64, (k + 1) as f64 / samples as f64);
        let step = distance(curve(a), curve(b)) / spacing.at(domain, curve(0.5 * (a + b)));
        worth.push(worth[k] + step);
    }
    let count = (worth[samples].round() as usize).max(fewest);
    let unit = worth[samples] / count as f64;
    let mut at = 0;
    let mut parameters = Vec::with_capacity(count);
    for k in usize::from(!closed)..count {
        let wanted = k as f64 * unit;
        while at + 1 < samples && worth[at + 1] <= wanted {
            at += 1;
        }
        let within = (wanted - worth[at]) / (worth[at + 1] - worth[at]);
        parameters.push((at as f64 + within) / samples as f64);
    }
    parameters
}

/// A circle in a horizontal plane.
pub(crate) fn circle(centre: [f64; 2], radius: f64, z: f64) -> impl Fn(f64) -> Point {
    move |t| {
        let (sin, cos) = (2.0 * PI * t).sin_cos();
        [centre[0] + radius * cos, centre[1] + radius * sin, z]
    }
}
