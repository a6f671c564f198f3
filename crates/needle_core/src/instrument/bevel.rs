//! The push of a bevelled tip.
//!
//! Tissue that is cut with a force F_c along the axis presses on the bevel's face at right angles, where nothing rubs. Of that pressure the part across
//! the axis is
//!
//! ```text
//! F_b = F_c / tan(alpha)                 alpha: angle between face and axis
//! ```
//!
//! (Misra, Reed, Schafer, Ramesh, Okamura, "Mechanics of flexible needles robotically steered through soft tissue", 2010, and Roesthuis, van Veen,
//! Jahya, Misra, "Mechanics of needle-tissue interaction", 2011, have the same resolution of the tip's force). It pushes the needle towards the point's
//! side, and the tissue the other way: both is done by the load on the tissue alone, since the needle has what the tissue bears.
//!
//! The face is 2 R / tan(alpha) long. A layer of nodes that the point has come to is pushed until the full section is there,
//!
//! ```text
//! p = (d - z) / length                   share of the face that has passed the layer
//! F = F_b 6 p (1 - p) h / length         h: distance between layers; the sum over the layers of a face is F_b
//! ```
//!
//! and then it keeps the place that it was pushed to: the needle stands beside where tissue was cut, and is drawn there.

use crate::scene::Needle;

/// Retraction from the deepest point over which the push ends, over the needle's radius: what was cut lets go.
const LETS_GO: f64 = 0.1;
/// Layers that a face reaches over, at least.
const FEWEST_LAYERS: f64 = 2.0;
/// Spring with which a layer beside a face is led, over mu h of a node: to where the layer is, so that its force is the push.
const LEAD: f64 = 3.0;

/// A bevel's push on the tissue, by places along the path.
#[derive(Clone, Debug)]
pub(super) struct Push {
    /// Vertical length of the face, m.
    length: f64,
    radius: f64,
    /// Directions in which the tip is pushed at a roll of 0 and of a quarter of a turn.
    aside: [[f64; 3]; 2],
    /// Roll that the scene has, rad.
    roll: f64,
    /// F_b at each place, N.
    force: Vec<f64>,
}

impl Push {
    /// Of a needle whose layers are so far apart at most, m; `cutting`: F_c at each place, N.
    pub(super) fn new(needle: &Needle, layer: f64, cutting: impl Iterator<Item = f64>) -> Option<Self> {
        let bevel = needle.bevel?;
        let tangent = bevel.angle.get().tan();
        let [x, y] = needle.slope();
        let length = needle.diameter.get() / tangent / (1.0 + x * x + y * y).sqrt();
        Some(Self {
            length: length.max(FEWEST_LAYERS * layer),
            radius: 0.5 * needle.diameter.get(),
            aside: aside(needle),
            roll: bevel.roll.get(),
            force: cutting.map(|cutting| bevel.force.unwrap_or(cutting / tangent)).collect(),
        })
    }

    /// p of a layer at a depth z, the point being at a depth d, m.
    pub(super) fn passed(&self, d: f64, z: f64) -> f64 {
        ((d - z) / self.length).clamp(0.0, 1.0)
    }

    /// Force on the tissue of the layer at a place, h from the next, N, while the point is so far behind the deepest that it has been, m, and the
    /// shaft is turned by an angle in rad.
    pub(super) fn on_layer(&self, place: usize, p: f64, h: f64, back: f64, roll: f64) -> [f64; 3] {
        let cuts = (1.0 - back / (LETS_GO * self.radius)).clamp(0.0, 1.0);
        let (sin, cos) = (self.roll + roll).sin_cos();
        let force = cuts * 6.0 * p * (1.0 - p) * h / self.length * self.force[place];
        std::array::from_fn(|k| -force * (cos * self.aside[0][k] + sin * self.aside[1][k]))
    }

    /// Force on the needle of a layer that is pushed: across the axis the push, along it what the tissue has.
    pub(super) fn on_needle(&self, force: [f64; 3], axis: [f64; 3], push: [f64; 3]) -> [f64; 3] {
        let along = (0..3).map(|k| (force[k] + push[k]) * axis[k]).sum::<f64>();
        std::array::from_fn(|k| along * axis[k] - push[k])
    }

    /// Spring that leads a node of a layer, N/m, for mu h in N/m.
    pub(super) fn lead(shear: f64) -> f64 {
        LEAD * shear
    }
}

/// Directions in which a bevel pushes its tip, at no roll and after a quarter of a turn: a horizontal unit vector for an upright needle, across the
/// path of another; and across the vertical plane of the path.
fn aside(needle: &Needle) -> [[f64; 3]; 2] {
    let (sin, cos) = needle.azimuth.get().sin_cos();
    let (up, side) = needle.tilt.get().sin_cos();
    [[side * cos, side * sin, up], [-sin, cos, 0.0]]
}
