//! Which part of a recording is fitted, and which is held out to be predicted.

use std::ops::Range;

use crate::compare::Run;

/// Which part is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldOut {
    /// All of it.
    Nothing,
    /// Everything up to the end of the hold: the way out is neither fitted nor predicted.
    Retraction,
    /// Up to half of the deepest depth; the rest of the insertion is predicted.
    Half,
    /// Up to the first pose beyond this recorded depth, m; the rest of the insertion is predicted.
    Beyond(f64),
}

/// Indices of answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parts {
    /// Those that are fitted.
    pub fitted: Range<usize>,
    /// Those that are predicted from the fit.
    pub held_out: Option<Range<usize>>,
}

impl Parts {
    /// Parts of a run, from its depths alone.
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
