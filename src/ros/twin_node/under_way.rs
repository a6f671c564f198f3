//! A way that is too long for one answer: an instrument that is deep in the tissue when it is first seen, or after a gap.
//!
//! The twin goes there in parts, between which the solver looks at its inbox, so that it is seen to be alive and does what it is asked.
//! It goes to the deepest of the poses that come meanwhile first, since the needle was there, and then to the newest.

use std::time::Instant;

use super::inbox::PoseInput;
use super::solver::Progress;
use crate::twin::{Halt, Part, StampedPose, Twin};

/// A way that is no longer than this is made at once, m: what a fast driver goes in some poses.
const LONG_M: f64 = 1e-3;
/// Wall time of one part, s.
const PART_S: f64 = 0.05;
/// Strides of the first part, and most of any.
const FIRST: u32 = 8;
const MOST: f64 = 64.0;

/// A pose that the twin goes to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    pub input: PoseInput,
    pub stamped: StampedPose,
}

/// See the module.
pub(super) struct UnderWay {
    deepest: Goal,
    newest: Goal,
    since: Instant,
    stride_m: f64,
    /// Strides that were made, and the wall time that they took, s.
    made: u32,
    took_s: f64,
    left: u32,
    skipped: u64,
}

impl UnderWay {
    /// The way to a pose, if it is long.
    pub fn to(twin: &Twin, goal: Goal) -> Option<Self> {
        let length = twin.way_to(&goal.stamped).ok().filter(|l| l.way_m > LONG_M && l.strides > FIRST)?;
        // one that no instrument makes is refused as ever
        twin.can_follow(&goal.stamped).then_some(Self {
            deepest: goal,
            newest: goal,
            since: goal.input.received,
            stride_m: length.stride_m,
            made: 0,
            took_s: 0.0,
            left: length.strides,
            skipped: 0,
        })
    }

    /// Where it goes now.
    pub fn goal(&self) -> Goal {
        self.deepest
    }

    /// The newest pose.
    pub fn newest(&self) -> Goal {
        self.newest
    }

    /// Takes a newer pose.
    ///
    /// # Errors
    /// Why it can't be one.
    pub fn head_for(&mut self, twin: &Twin, goal: Goal) -> Result<(), String> {
        if let Err(Halt::Pose { reason }) = twin.way_to(&goal.stamped) {
            return Err(reason);
        }
        if let Some(reason) = twin.jumps(&self.newest.stamped, &goal.stamped) {
            return Err(reason);
        }
        self.skipped += 1;
        self.newest = goal;
        let depth = |goal: &Goal| twin.depth_of(&goal.stamped.pose);
        if depth(&goal) >= depth(&self.deepest) {
            self.deepest = goal;
        }
        Ok(())
    }

    /// Takes the twin a part further.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    pub fn go_on(&mut self, twin: &mut Twin) -> Result<Part, Halt> {
        let begun = Instant::now();
        let part = self.stride_s().map_or(FIRST, |stride_s| (PART_S / stride_s).clamp(1.0, MOST) as u32);
        let outcome = twin.step_in_part(self.goal().stamped, self.stride_m, part)?;
        self.made = self.made.saturating_add(part);
        self.took_s += begun.elapsed().as_secs_f64();
        self.left = if let Part::Left(left) = outcome { left } else { 0 };
        Ok(outcome)
    }

    /// Wall time of a stride so far, s.
    fn stride_s(&self) -> Option<f64> {
        (self.made > 0).then(|| (self.took_s / f64::from(self.made)).max(1e-9))
    }

    /// How far it has come, with what came since this was asked last.
    pub fn progress(&mut self, twin: &Twin) -> Progress {
        let whole = f64::from(self.made.saturating_add(self.left).max(1));
        Progress {
            to_m: twin.depth_of(&self.deepest.stamped.pose),
            share: f64::from(self.made) / whole,
            left_s: self.stride_s().map(|stride_s| stride_s * f64::from(self.left)),
            since: self.since,
            skipped: std::mem::take(&mut self.skipped),
        }
    }
}
