//! A way that is too long for one answer: an instrument that is deep in the tissue when it is first seen, or after a gap.
//!
//! The twin goes there in parts, between which the solver looks at its inbox, so that it is seen to be alive and does what it is asked.
//! It goes to the farthest of the poses that come meanwhile first (the deepest on the way in), since the needle was there, and then to the newest.

use std::time::Instant;

use super::inbox::PoseInput;
use super::solver::Progress;
use needle_core::twin::{Halt, Part, StampedPose, Twin};

/// A way that takes no longer than this is made at once, s: an answer that is older is of little use.
const AT_ONCE_S: f64 = 0.2;
/// Wall time of one part, s.
const PART_S: f64 = 0.05;
/// Most strides of a part.
const MOST: f64 = 64.0;

/// A pose that the twin goes to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    pub input: PoseInput,
    pub stamped: StampedPose,
}

/// See the module.
pub(super) struct UnderWay {
    farthest: Goal,
    newest: Goal,
    /// The way goes deeper.
    inward: bool,
    since: Instant,
    /// Longest that the way asked for so far, m: what is left of it would ask for shorter ones.
    stride_m: f64,
    /// Wall time of a stride of late, s.
    stride_s: f64,
    /// Strides that were made.
    made: u32,
    left: u32,
    skipped: u64,
}

impl UnderWay {
    /// The way to a pose, if it takes long. `from_m`: depth at which it begins, m; `stride_s`: wall time of a stride of late, s.
    pub fn to(twin: &Twin, goal: Goal, from_m: f64, stride_s: f64) -> Option<Self> {
        let length = twin.way_to(&goal.stamped).ok().filter(|l| f64::from(l.strides) * stride_s > AT_ONCE_S)?;
        // one that no instrument makes is refused as ever
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

    /// Where it goes now.
    pub fn goal(&self) -> Goal {
        self.farthest
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
        let farther = depth(&goal) - depth(&self.farthest);
        if (self.inward && farther >= 0.0) || (!self.inward && farther <= 0.0) {
            self.farthest = goal;
        }
        Ok(())
    }

    /// Takes the twin a part further.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    pub fn go_on(&mut self, twin: &mut Twin) -> Result<Part, Halt> {
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

    /// Wall time of a stride of late, s.
    pub fn stride_s(&self) -> f64 {
        self.stride_s
    }

    /// How far it has come, with what came since this was asked last.
    pub fn progress(&mut self, twin: &Twin) -> Progress {
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
