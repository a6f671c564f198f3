//! The axis of a needle's path, which may be oblique.

use crate::vector::{Point, length2};
use std::f64::consts::PI;

/// A straight line from a point of the top face downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Where it meets the top face, x, y in metres.
    pub entry: [f64; 2],
    /// Lateral way per metre of depth below the top face; zero for a vertical needle.
    pub slope: [f64; 2],
}

impl Axis {
    /// A vertical axis.
    #[must_use]
    pub const fn vertical(entry: [f64; 2]) -> Self {
        Self { entry, slope: [0.0; 2] }
    }

    /// Length along the axis per metre of depth.
    #[must_use]
    pub fn secant(&self) -> f64 {
        (1.0 + self.slope[0] * self.slope[0] + self.slope[1] * self.slope[1]).sqrt()
    }

    /// x, y of the axis at a depth below the top face, m.
    #[must_use]
    pub fn at(&self, depth: f64) -> [f64; 2] {
        [self.entry[0] + self.slope[0] * depth, self.entry[1] + self.slope[1] * depth]
    }

    /// Distance of a point from the axis in metres; `top` is the height of the top face.
    #[must_use]
    pub fn distance(&self, top: f64, p: Point) -> f64 {
        let centre = self.at(top - p[2]);
        let (along, across) = self.turned([p[0] - centre[0], p[1] - centre[1]]);
        length2(along / self.secant(), across)
    }

    /// Unit vector from the axis to a point, across the axis; zero for a point of it. `top` is the height of the top face.
    #[must_use]
    pub fn outward(&self, top: f64, p: Point) -> Point {
        let centre = self.at(top - p[2]);
        let along = [self.slope[0], self.slope[1], -1.0].map(|x| x / self.secant());
        let v = [p[0] - centre[0], p[1] - centre[1], 0.0];
        let share = v[0] * along[0] + v[1] * along[1];
        let across: Point = std::array::from_fn(|k| v[k] - share * along[k]);
        let length = across.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 1e-9 * (top - p[2]).abs() && length > 0.0 { across.map(|x| x / length) } else { [0.0; 3] }
    }

    /// A point of the horizontal section, an ellipse, of the cylinder of this radius round the axis, in turns.
    #[must_use]
    pub fn section(&self, top: f64, depth: f64, radius: f64, turn: f64) -> Point {
        let centre = self.at(depth);
        let (sin, cos) = (2.0 * PI * turn).sin_cos();
        let [c, s] = self.direction();
        let (along, across) = (radius * self.secant() * cos, radius * sin);
        [centre[0] + c * along - s * across, centre[1] + s * along + c * across, top - depth]
    }

    /// Unit vector of the slope in x, y; x if there is none.
    fn direction(&self) -> [f64; 2] {
        let length = length2(self.slope[0], self.slope[1]);
        if length > 0.0 { self.slope.map(|s| s / length) } else { [1.0, 0.0] }
    }

    /// Components along the slope and across it.
    fn turned(&self, v: [f64; 2]) -> (f64, f64) {
        let [c, s] = self.direction();
        (c * v[0] + s * v[1], c * v[1] - s * v[0])
    }
}

/// Number of equal steps down a path, and of rings round its axis.
pub(crate) fn path_shape(radius: f64, length: f64, spacing: f64) -> (usize, usize) {
    ((length / spacing).round().max(1.0) as usize, (radius / spacing).round().max(1.0) as usize)
}
