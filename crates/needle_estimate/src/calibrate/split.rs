//! Splits a recording into a fitted part and a held-out part that is predicted.

use std::ops::Range;

use crate::compare::Run;

/// Which part is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldOut {
    /// All of the recording.
    Nothing,
    /// Everything up to the end of the hold. The retraction is neither fitted nor predicted.
    Retraction,
    /// Up to half of the largest depth. The rest of the insertion is predicted.
    Half,
    /// Up to the first pose beyond this recorded depth, m. The rest of the insertion is predicted.
    Beyond(f64),
}

/// Index ranges of answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parts {
    /// The fitted part.
    pub fitted: Range<usize>,
    /// The part that is predicted from the fit.
    pub held_out: Option<Range<usize>>,
}

impl Parts {
    /// Splits a run by its depths alone.
    pub(super) fn of(run: &Run, hold_out: HoldOut) -> Self {
        let legs = run.legs();
        match hold_out {
            HoldOut::Nothing => Self { fitted: 0..legs.end, held_out: None },
            HoldOut::Retraction => Self { fitted: 0..legs.retraction, held_out: None },
            HoldOut::Half => {
                let deepest = run.answers.iter().map(|a| a.depth_m).fold(0.0, f64::max);
                Self::up_to(run, 0.5 * deepest, legs.hold)
            }
            HoldOut::Beyond(depth_m) => Self::up_to(run, depth_m, legs.hold),
        }
    }

    fn up_to(run: &Run, depth_m: f64, end: usize) -> Self {
        let first = run.answers[..end].iter().position(|a| a.depth_m > depth_m).unwrap_or(end);
        Self { fitted: 0..first, held_out: Some(first..end) }
    }
}
