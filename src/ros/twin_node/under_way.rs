//! A motion that takes too long for one answer: an instrument that is deep in the tissue at the first pose, or after
//! a gap.
//!
//! The twin moves there in parts. In between the solver checks its inbox, so that it shows signs of life and handles
//! requests. It moves first to the farthest of the poses that come meanwhile (the deepest during an insertion), since
//! the needle was there. Then it moves to the newest.

use std::time::Instant;

use super::answer::Progress;
use super::inbox::PoseInput;
use needle_core::twin::{Halt, Part, StampedPose, Twin};

/// A motion that takes no longer than this is made at once, s: an older answer is of little use.
const AT_ONCE_S: f64 = 0.2;
/// Wall time of one part, s.
const PART_S: f64 = 0.05;
/// Largest number of strides in a part.
const MOST: f64 = 64.0;

/// A pose that is the goal of the motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    pub input: PoseInput,
    pub stamped: StampedPose,
}

/// See the module.
pub(super) struct UnderWay {
    farthest: Goal,
    newest: Goal,
    /// Whether the motion goes deeper.
    inward: bool,
    since: Instant,
    /// Longest stride that the motion allowed so far, m: the remaining motion alone would need shorter ones.
    stride_m: f64,
    /// Recent wall time of a stride, s.
    stride_s: f64,
    /// Number of strides made.
    made: u32,
    left: u32,
    skipped: u64,
}

impl UnderWay {
    /// The motion to a pose, if it takes long. `from_m`: depth at its start, m; `stride_s`: recent wall time of a
    /// stride, s.
    pub(crate) fn to(twin: &Twin, goal: Goal, from_m: f64, stride_s: f64) -> Option<Self> {
        let length = twin.way_to(&goal.stamped).ok().filter(|l| f64::from(l.strides) * stride_s > AT_ONCE_S)?;
        // a motion that no instrument makes is refused as usual
        twin.can_follow(&goal.stamped).then_some(Self {
            farthest: goal,
            newest: goal,
            inward: twin.depth_of(&goal.stamped.pose) >= from_m,
            since: goal.input.received,
            stride_m: length.stride_m,
            stride_s,
            made: 0,
            left: length.strides,
            skipped: 0,
        })
    }

    /// The present goal.
    pub(crate) fn goal(&self) -> Goal {
        self.farthest
    }

    /// The newest pose.
    pub(crate) fn newest(&self) -> Goal {
        self.newest
    }

    /// Takes a newer pose.
    ///
    /// # Errors
    /// Why it is not a valid goal.
    pub(crate) fn head_for(&mut self, twin: &Twin, goal: Goal) -> Result<(), String> {
        if let Err(Halt::Pose { reason }) = twin.way_to(&goal.stamped) {
            return Err(reason);
        }
        if let Some(reason) = twin.jumps(&self.newest.stamped, &goal.stamped) {
            return Err(reason);
        }
        self.skipped += 1;
        self.newest = goal;
        let depth = |goal: &Goal| twin.depth_of(&goal.stamped.pose);
        let farther = depth(&goal) - depth(&self.farthest);
        if (self.inward && farther >= 0.0) || (!self.inward && farther <= 0.0) {
            self.farthest = goal;
        }
        Ok(())
    }

    /// Moves the twin by one part.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    pub(crate) fn go_on(&mut self, twin: &mut Twin) -> Result<Part, Halt> {
        let begun = Instant::now();
        let part = (PART_S / self.stride_s).clamp(1.0, MOST) as u32;
        self.stride_m = twin.way_to(&self.goal().stamped)?.stride_m.max(self.stride_m);
        let outcome = twin.step_in_part(self.goal().stamped, self.stride_m, part)?;
        let made = part.min(self.left.max(1));
        self.made = self.made.saturating_add(made);
        self.stride_s += 0.3 * (begun.elapsed().as_secs_f64() / f64::from(made) - self.stride_s);
        self.left = if let Part::Left(left) = outcome { left } else { 0 };
        Ok(outcome)
    }

    /// Recent wall time of a stride, s.
    pub(crate) fn stride_s(&self) -> f64 {
        self.stride_s
    }

    /// The progress, with the number of poses since the last call.
    pub(crate) fn progress(&mut self, twin: &Twin) -> Progress {
        let whole = f64::from(self.made.saturating_add(self.left).max(1));
        Progress {
            to_m: twin.depth_of(&self.farthest.stamped.pose),
            share: f64::from(self.made) / whole,
            left_s: self.stride_s * f64::from(self.left),
            since: self.since,
            skipped: std::mem::take(&mut self.skipped),
        }
    }
}
