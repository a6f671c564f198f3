//! Prediction of a further motion by a second twin with a copy of the state; the live twin is not changed.
//!
//! The double is built once, beside the twin ([`Twin::double`]). For a question the twin's thread copies its state into it
//! between two poses ([`Twin::take_over`]: no allocation, no waiting). [`Twin::look_ahead`] then runs in another thread for
//! as long as it needs.
//!
//! The motion is cut more coarsely than live poses are, since a pose costs at least one step; the steps between two poses
//! follow from the travel (see `pace`), not from the clock.

use std::sync::Arc;

use super::{Halt, Pose, Prediction, StampedPose, Twin};

/// A further motion along the instrument's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// How far, m; negative: back.
    pub distance_m: f64,
    /// How fast, m/s. It matters only for a material that relaxes, and for a cutting force that grows with the speed.
    pub speed_m_per_s: f64,
    /// Poses that it is cut into, at least 1.
    pub poses: u32,
    /// Most explicit steps for each of them, at least 1.
    pub steps_per_pose: u32,
}

impl Motion {
    /// Distance between two poses of a motion, m.
    pub(crate) const SPACING_M: f64 = 20e-6;
    /// Explicit steps of a motion. The needle preset's force at the end of a millimetre is then within one per cent of
    /// that of the motion itself, at the end of two within two per cent (half plane, from depths of 2 to 6 mm).
    pub const STEPS: u32 = 300;

    /// A motion cut as finely as the force needs, for about as many explicit steps as there is time for.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    pub fn new(distance_m: f64, speed_m_per_s: f64, steps: u32) -> Self {
        let wanted = (distance_m.abs() / Self::SPACING_M).ceil();
        let poses = wanted.clamp(1.0, f64::from(steps.max(1))) as u32;
        Self { distance_m, speed_m_per_s, poses, steps_per_pose: (steps / poses).max(1) }
    }

    /// The pose after `i` of the motion's poses.
    fn pose(&self, from: &StampedPose, i: u32) -> StampedPose {
        let share = f64::from(i) / f64::from(self.poses);
        let Pose { tip, axis, .. } = from.pose;
        let way = share * self.distance_m;
        StampedPose {
            time_s: from.time_s + way.abs() / self.speed_m_per_s,
            pose: Pose { tip: std::array::from_fn(|k| tip[k] + way * axis[k]), ..from.pose },
        }
    }
}

impl Twin {
    /// A second twin of the same model, which it shares, with a copy of the state; it steps on one thread.
    #[must_use]
    pub fn double(&self) -> Self {
        Self {
            fixed: Arc::clone(&self.fixed),
            solver: self.solver.branch(),
            contact: self.contact.clone(),
            progress: self.progress.clone(),
            saved: self.saved.clone(),
            counters: super::Counters::default(),
            happened: super::Happened::default(),
            folds: self.folds.clone(),
            recovered: self.recovered.clone(),
        }
    }

    /// Takes over the state of the twin that this one is a double of. Copies a few hundred bytes per node and allocates
    /// nothing, so that it may run between two poses. Of a sibling of that one ([`Twin::sibling`]) it takes over the scene as well; that
    /// allocates a copy of its contact.
    pub fn take_over(&mut self, live: &Self) {
        if !Arc::ptr_eq(&self.fixed, &live.fixed) {
            self.fixed = Arc::clone(&live.fixed);
            self.contact.clone_from(&live.contact);
            self.saved.contact_of(&live.contact);
        }
        self.solver.take_over(&live.solver);
        if let (Some(own), Some(live)) = (&mut self.contact, &live.contact) {
            own.take_over(live);
        }
        self.progress.clone_from(&live.progress);
        self.progress.steps_since_save = 0;
        self.progress.lost = None;
    }

    /// Makes a further motion from the pose at which the state was taken over, and says what every pose of it would
    /// bring. Overwrites `out`, which has the predictions up to where the motion could be followed.
    ///
    /// # Errors
    /// As [`Twin::step`]: [`Halt::Pose`] where the motion leaves what the scene's cloud was made for,
    /// [`Halt::Diverged`] if the solution is lost on the way.
    pub fn look_ahead(&mut self, from: &StampedPose, motion: &Motion, out: &mut Vec<Prediction>) -> Result<(), Halt> {
        out.clear();
        self.solver.settle();
        let (tip, shaft, phase) = (self.progress.tip, self.progress.shaft, self.progress.phase);
        self.keep_place(tip, shaft, self.depth_of(&from.pose), phase);
        self.limit_steps(motion.steps_per_pose);
        self.progress.speed.begin(from.time_s, self.depth_of(&from.pose));
        for i in 1..=motion.poses {
            out.push(self.step(motion.pose(from, i))?);
        }
        Ok(())
    }
}
