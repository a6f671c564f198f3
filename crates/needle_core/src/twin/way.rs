//! Large jumps of the instrument between two poses: the motion in between is unknown.
//!
//! It is assumed to be straight and divided into smaller moves (strides). In one move the needle preset's solution is lost in
//! half of the jumps of 1.0 mm. Only the part below the surface counts. A motion that was above the surface is assumed to enter
//! at the present axis, or to leave at the former one, so that the sample bounds the strides.

use crate::instrument::reading::SPEED_M_PER_S;
use crate::instrument::{Contact, Tip};

use super::{StampedPose, Twin, pierce};
use crate::scene::{Dimension, Scene};

/// Length of a stride over the height of the body; a jump of less than two strides is made at once (but for a needle with friction).
const STRIDE: f64 = 0.0125;
/// Shortest stride of a needle that bends over its radius, and how many a jump is made in until they are ten times as long.
const BENDING_STRIDE: f64 = 0.05;
const BENDING_STRIDES: f64 = 40.0;
/// Fastest motion that is accepted, over the speed of the scene's own motion.
const OWN_SPEED: f64 = 2.0;

/// A straight way below the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    /// Where it begins and ends below the surface, relative to the entry point, m.
    ends: [[f64; 3]; 2],
    /// Whether it begins at the surface, with the instrument above it.
    enters: bool,
    /// Where the tip is in the end, below the surface or not.
    to: Tip,
    /// m
    pub length: f64,
    /// Number of strides, 0 for a jump that is made at once.
    strides: u32,
}

impl Way {
    /// How many moves it is made in.
    pub(crate) fn moves(&self) -> f64 {
        f64::from(self.strides.max(1))
    }

    /// Number of strides; 0: it is made at once.
    pub(crate) const fn strides(&self) -> u32 {
        self.strides
    }

    /// The same way in strides of a length, m.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    pub(crate) fn in_strides(self, stride_m: f64) -> Self {
        // the rest of a way that was cut into these is a whole number of them but for round-off
        let strides = if stride_m > 0.0 { (self.length / stride_m - 1e-6).ceil().max(0.0) as u32 } else { 0 };
        Self { strides, ..self }
    }

    /// The places on the way, without the one at which the tip is in the end.
    pub(crate) fn places(self) -> impl Iterator<Item = Tip> {
        let [from, to] = self.ends;
        let secant = (1.0 + self.to.slope.iter().map(|s| s * s).sum::<f64>()).sqrt();
        let share = move |i: u32| f64::from(i) / f64::from(self.strides);
        let first = u32::from(!self.enters);
        let last = if self.to.offset[2] > 0.0 { self.strides } else { self.strides.saturating_sub(1) };
        (first..=last).filter(move |_| self.strides > 0).map(move |i| {
            let offset: [f64; 3] = std::array::from_fn(|k| from[k] + share(i) * (to[k] - from[k]));
            Tip { offset, depth: -offset[2] * secant, slope: self.to.slope, roll: self.to.roll }
        })
    }
}

/// Length of a stride of a needle that bends, m: rod and tissue find each other once in each.
fn bending_stride(scene: &Scene, length: f64) -> f64 {
    let radius = 0.5 * scene.instrument.and_then(|i| i.needle_diameter_m()).unwrap_or(0.0);
    (length / BENDING_STRIDES).clamp(BENDING_STRIDE * radius, 10.0 * BENDING_STRIDE * radius)
}

impl Twin {
    /// The way from the last pose.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    pub(super) fn way(&self, to: &Tip) -> Way {
        let surface = to.axis_at(0.0);
        let (above, leaves) = (self.progress.tip[2] > 0.0, to.offset[2] > 0.0);
        let from = if above { [surface[0], surface[1], 0.0] } else { self.progress.tip };
        let end = if leaves { [self.progress.shaft[0], self.progress.shaft[1], 0.0] } else { to.offset };
        let length = (0..3).map(|k| (end[k] - from[k]).powi(2)).sum::<f64>().sqrt();
        let length = if above && leaves { 0.0 } else { length };
        let (stride, once) = self.stride(length);
        let stride = self.care() * stride;
        let strides = if length > once * stride { (length / stride).ceil() as u32 } else { 0 };
        Way { ends: [from, end], enters: above, to: *to, length, strides }
    }

    /// Length of a stride of a way, m, and how many of them are made at once.
    fn stride(&self, length: f64) -> (f64, f64) {
        match &self.contact {
            Some(Contact::Frictional(n)) => {
                let in_space = self.dimension() != Dimension::Axisymmetric;
                (pierce::stride(n.radius(), length, in_space), 1.0)
            }
            Some(contact) if contact.shaft().is_some() => (bending_stride(&self.fixed.scene, length), 1.0),
            _ => (STRIDE * self.fixed.height, 2.0),
        }
    }

    /// Why an instrument cannot have moved to a place by then, if it cannot.
    pub(super) fn too_fast(&self, to: &Tip, time_s: f64) -> Option<String> {
        let way = self.way(to);
        self.progress.seen_s.and_then(|seen_s| self.jump(way.length, time_s - seen_s))
    }

    /// Whether a pose of a stream can be used, and an instrument can have come there.
    #[must_use]
    pub fn can_follow(&self, pose: &StampedPose) -> bool {
        self.admit_next(pose).is_ok()
    }

    /// Why an instrument can't have moved between two poses, one after the other, if it can't.
    #[must_use]
    pub fn jumps(&self, from: &StampedPose, to: &StampedPose) -> Option<String> {
        let way = (0..3).map(|k| (to.pose.tip[k] - from.pose.tip[k]).powi(2)).sum::<f64>().sqrt();
        self.jump(way, to.time_s - from.time_s)
    }

    fn jump(&self, way: f64, elapsed: f64) -> Option<String> {
        let own = self.fixed.scene.motion.map_or(0.0, |m| OWN_SPEED * m.speed.get());
        let (limit, elapsed) = (SPEED_M_PER_S.max(own), elapsed.abs());
        (way > 2.0 * STRIDE * self.fixed.height && way > limit * elapsed).then(|| {
            format!(
                "its tip is {way:.6} m from where it was {elapsed:.6} s before; an instrument moves by at most {limit} m/s \
                 (or twice motion.speed_m_per_s)"
            )
        })
    }
}
