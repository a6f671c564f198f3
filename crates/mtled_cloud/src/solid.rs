//! Shapes of regions inside a body, and which region a point lies in.

use std::cmp::Ordering;

use crate::vector::{Point, between, distance, length2};

/// How far solids may reach into each other and still do no more than touch, m: rounding.
const TOUCH: f64 = 1e-12;

/// A part of space. Lengths in m, axes upright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    /// All between two heights.
    Layer {
        /// Lower z.
        bottom: f64,
        /// Upper z.
        top: f64,
    },
    /// Sphere.
    Sphere {
        /// Centre.
        centre: Point,
        /// Radius.
        radius: f64,
    },
    /// Upright cylinder.
    Cylinder {
        /// Centre.
        centre: Point,
        /// Radius.
        radius: f64,
        /// Height.
        height: f64,
    },
    /// Upright box.
    Box {
        /// Centre.
        centre: Point,
        /// Edges along x, y and z.
        size: Point,
    },
}

impl Solid {
    /// Distance to the boundary, m; negative inside.
    #[must_use]
    pub fn signed(&self, p: Point) -> f64 {
        // of a body that is long in all directions but these: outside, the distance to the edge where several are positive
        let joined = |gaps: &[f64]| {
            let inside = gaps.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if inside <= 0.0 { inside } else { gaps.iter().map(|g| g.max(0.0).powi(2)).sum::<f64>().sqrt() }
        };
        match *self {
            Self::Layer { bottom, top } => (bottom - p[2]).max(p[2] - top),
            Self::Sphere { centre, radius } => distance(p, centre) - radius,
            Self::Cylinder { centre, radius, height } => {
                joined(&[length2(p[0] - centre[0], p[1] - centre[1]) - radius, (p[2] - centre[2]).abs() - 0.5 * height])
            }
            Self::Box { centre, size } => joined(&[0, 1, 2].map(|k| (p[k] - centre[k]).abs() - 0.5 * size[k])),
        }
    }

    /// The solid with what ends at the top or the base of a body of this height going on beyond: no boundary is there.
    pub(crate) fn open(&self, height: f64) -> Self {
        let near = 1e-7 * height;
        let beyond = |low: f64, high: f64| {
            (if low <= near { -height } else { low }, if high >= height - near { 2.0 * height } else { high })
        };
        let about = |z: f64, h: f64| {
            let (low, high) = beyond(z - 0.5 * h, z + 0.5 * h);
            (0.5 * (low + high), high - low)
        };
        match *self {
            Self::Layer { bottom, top } => {
                let (bottom, top) = beyond(bottom, top);
                Self::Layer { bottom, top }
            }
            Self::Cylinder { centre: [x, y, z], radius, height: h } => {
                let (z, h) = about(z, h);
                Self::Cylinder { centre: [x, y, z], radius, height: h }
            }
            Self::Box { centre: [x, y, z], size: [a, b, c] } => {
                let (z, c) = about(z, c);
                Self::Box { centre: [x, y, z], size: [a, b, c] }
            }
            Self::Sphere { .. } => *self,
        }
    }

    /// Whether another one has no part in common with it; they may touch.
    #[must_use]
    pub fn is_apart(&self, other: &Self) -> bool {
        let ([a, b], [c, d]) = (self.bounds(), other.bounds());
        if (0..3).any(|k| b[k] <= c[k] + TOUCH || d[k] <= a[k] + TOUCH) {
            return true;
        }
        match (*self, *other) {
            (Self::Sphere { centre, radius }, solid) | (solid, Self::Sphere { centre, radius }) => {
                solid.signed(centre) >= radius - TOUCH
            }
            // both upright, and beside each other
            (Self::Cylinder { centre: [x, y, _], radius, .. }, solid @ (Self::Cylinder { .. } | Self::Box { .. }))
            | (solid @ Self::Box { .. }, Self::Cylinder { centre: [x, y, _], radius, .. }) => {
                let level = match solid {
                    Self::Cylinder { centre, .. } | Self::Box { centre, .. } => centre[2],
                    _ => 0.0,
                };
                solid.signed([x, y, level]) >= radius - TOUCH
            }
            _ => false,
        }
    }

    /// Its place in an order from the top down, of which no two that are apart have the same.
    #[must_use]
    pub fn from_the_top(&self, other: &Self) -> Ordering {
        let key = |solid: &Self| {
            let [low, high] = solid.bounds();
            [-high[2], -low[2], low[0], low[1], high[0], high[1]]
        };
        let all = key(self).into_iter().zip(key(other));
        all.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    }

    /// The lowest and the highest corner of the upright box round it, m.
    #[must_use]
    pub fn bounds(&self) -> [Point; 2] {
        const EVER: f64 = f64::INFINITY;
        let about = |centre: Point, half: Point| [-1.0, 1.0].map(|s| [0, 1, 2].map(|k| centre[k] + s * half[k]));
        match *self {
            Self::Layer { bottom, top } => [[-EVER, -EVER, bottom], [EVER, EVER, top]],
            Self::Sphere { centre, radius } => about(centre, [radius; 3]),
            Self::Cylinder { centre, radius, height } => about(centre, [radius, radius, 0.5 * height]),
            Self::Box { centre, size } => about(centre, size.map(|s| 0.5 * s)),
        }
    }

    /// Smallest extent, m.
    #[must_use]
    pub fn thickness(&self) -> f64 {
        match *self {
            Self::Layer { bottom, top } => top - bottom,
            Self::Sphere { radius, .. } => 2.0 * radius,
            Self::Cylinder { radius, height, .. } => height.min(2.0 * radius),
            Self::Box { size, .. } => size[0].min(size[1]).min(size[2]),
        }
    }

    /// Curves of the boundary in the half plane of an axis that the solid lies on, each from t = 0 to 1: (r, 0, z). `reach`
    /// is how far layers go.
    pub(crate) fn curves(&self, reach: f64) -> Vec<Curve> {
        match *self {
            Self::Layer { bottom, top } => [bottom, top].map(|z| Curve::Line([0.0, 0.0, z], [reach, 0.0, z])).to_vec(),
            Self::Sphere { centre, radius } => vec![Curve::Arc { z: centre[2], radius }],
            Self::Cylinder { centre, radius, height } => {
                let [low, high] = [-0.5, 0.5].map(|s| centre[2] + s * height);
                vec![
                    Curve::Line([0.0, 0.0, low], [radius, 0.0, low]),
                    Curve::Line([radius, 0.0, low], [radius, 0.0, high]),
                    Curve::Line([0.0, 0.0, high], [radius, 0.0, high]),
                ]
            }
            Self::Box { .. } => Vec::new(),
        }
    }
}

/// A curve in the half plane.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Curve {
    /// From one end to the other.
    Line(Point, Point),
    /// Half a circle about a point of the axis, from below.
    Arc { z: f64, radius: f64 },
}

impl Curve {
    pub(crate) fn at(&self, t: f64) -> Point {
        match *self {
            Self::Line(a, b) => between(a, b, t),
            Self::Arc { z, radius } => {
                let (sin, cos) = (std::f64::consts::PI * (t - 0.5)).sin_cos();
                let r = if t <= 0.0 || t >= 1.0 { 0.0 } else { radius * cos };
                [r, 0.0, z + radius * sin]
            }
        }
    }
}

/// Samples of a curve.
const SAMPLES: usize = 2000;

/// Short stretches of [0, 1] within which a piecewise constant function changes.
pub(crate) fn changes<T: PartialEq>(of: &dyn Fn(f64) -> T) -> Vec<[f64; 2]> {
    let at = |k: usize| k as f64 / SAMPLES as f64;
    let refined = |mut a: f64, mut b: f64| {
        let first = of(a);
        for _ in 0..40 {
            let middle = 0.5 * (a + b);
            if of(middle) == first { a = middle } else { b = middle }
        }
        [a, b]
    };
    (0..SAMPLES).filter(|&k| of(at(k)) != of(at(k + 1))).map(|k| refined(at(k), at(k + 1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Feature, Spacing};

    #[test]
    fn distances_are_those_to_the_boundary() {
        let cylinder = Solid::Cylinder { centre: [0.0, 0.0, 5.0], radius: 2.0, height: 4.0 };
        for (p, d) in
            [([0.0, 0.0, 5.0], -2.0), ([1.5, 0.0, 5.0], -0.5), ([5.0, 0.0, 11.0], 5.0), ([0.0, 0.0, 8.0], 1.0)]
        {
            assert!((cylinder.signed(p) - d).abs() < 1e-12, "{p:?}");
        }
        let layer = Solid::Layer { bottom: 1.0, top: 3.0 };
        assert_eq!([layer.open(3.0).signed([0.0, 0.0, 3.0]), layer.open(4.0).signed([0.0, 0.0, 3.0])], [-2.0, 0.0]);
        assert_eq!([layer.signed([9.0, 0.0, 2.5]), layer.signed([0.0, 0.0, 4.0])], [-0.5, 1.0]);
    }

    #[test]
    fn what_touches_is_apart_and_what_overlaps_is_not() {
        let layer = |bottom: f64, top: f64| Solid::Layer { bottom, top };
        let sphere = |centre: Point, radius: f64| Solid::Sphere { centre, radius };
        let cylinder = |centre: Point| Solid::Cylinder { centre, radius: 1.0, height: 2.0 };
        let cube = |centre: Point| Solid::Box { centre, size: [2.0; 3] };
        for (a, b, apart) in [
            (layer(0.0, 1.0), layer(1.0, 2.0), true),
            (layer(0.0, 1.1), layer(1.0, 2.0), false),
            (layer(0.0, 1.0), sphere([0.0, 0.0, 2.0], 1.0), true),
            (layer(0.0, 1.0), cylinder([0.0, 0.0, 1.5]), false),
            (sphere([0.0; 3], 1.0), sphere([1.5, 1.5, 0.0], 1.0), true),
            (sphere([0.0; 3], 1.0), sphere([1.0, 1.0, 0.0], 1.0), false),
            (sphere([0.0; 3], 1.0), cube([1.8, 1.8, 0.0]), true),
            (sphere([0.0; 3], 1.0), cube([1.6, 1.6, 0.0]), false),
            (cylinder([0.0; 3]), cylinder([1.5, 1.5, 0.5]), true),
            (cylinder([0.0; 3]), cylinder([1.3, 1.3, 0.5]), false),
            (cylinder([0.0; 3]), cube([1.8, 1.8, 0.5]), true),
            (cube([1.6, 1.6, 0.5]), cylinder([0.0; 3]), false),
            (cube([0.0; 3]), cube([2.0, 0.5, 0.5]), true),
            (cube([0.0; 3]), cube([1.9, 0.5, 0.5]), false),
        ] {
            assert_eq!([a.is_apart(&b), b.is_apart(&a)], [apart; 2], "{a:?} {b:?}");
        }
    }

    #[test]
    fn the_first_region_that_holds_a_point_counts() {
        let region = |solid| Feature::Region { solid, spacing: 0.1 };
        let sphere = Solid::Sphere { centre: [0.0; 3], radius: 1.0 };
        let features = vec![region(sphere), region(Solid::Layer { bottom: 0.5, top: 2.0 })];
        let spacing = Spacing { far: 0.1, growth: 0.3, features };
        let up = |t: f64| [0.0, 0.0, 3.0 * t];
        assert_eq!([0.9, 1.1, 2.1].map(|z| spacing.region([0.0, 0.0, z])), [1, 2, 0]);
        let crossings: Vec<f64> = spacing.crossings(&up).iter().map(|t| 3.0 * t).collect();
        assert!((crossings[0] - 1.0).abs() < 1e-9 && (crossings[1] - 2.0).abs() < 1e-9, "{crossings:?}");
    }
}
