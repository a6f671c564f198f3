//! The three legs of a run: insertion, hold, retraction.

use std::ops::Range;

use super::Run;

/// Share of the largest depth within which the instrument counts as held at it.
const HOLD_BAND: f64 = 0.002;

/// Share of the depth below which the hold has ended: several insertions are no hold.
const LEAVES: f64 = 0.9;

/// Share of the largest depth by which a motion must reverse for a new pass to begin.
const TURN: f64 = 0.1;

/// One pass of the instrument: an insertion or a retraction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pass {
    /// Range of its answers.
    pub range: Range<usize>,
    /// Whether it is a retraction.
    pub back: bool,
    /// Index of the insertion that it is or follows, from 0.
    pub number: usize,
}

/// Division of a run's answers into insertion, hold and retraction. Any of them may be empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Legs {
    /// First answer at the deepest point; the insertion ends before it.
    pub hold: usize,
    /// First answer of the retraction, one past the last at the deepest point.
    pub retraction: usize,
    /// Number of answers.
    pub end: usize,
}

impl Run {
    /// Legs of the motion, from depth alone. "At the deepest point" is within 0.2% of it, so that the noise of a
    /// depth sensor makes no legs. A motion with several cycles counts as held between its deepest answers.
    #[must_use]
    pub fn legs(&self) -> Legs {
        let depths = || self.answers.iter().map(|a| a.depth_m);
        let deepest = depths().filter(|d| d.is_finite()).fold(0.0, f64::max);
        let held = |d: f64| deepest > 0.0 && d >= (1.0 - HOLD_BAND) * deepest;
        let end = self.answers.len();
        Legs {
            hold: depths().position(held).unwrap_or(end),
            retraction: depths().rposition(held).map_or(end, |last| last + 1),
            end,
        }
    }

    /// The insertions and retractions in order ([`passes`]).
    #[must_use]
    pub fn passes(&self) -> Vec<Pass> {
        passes(&self.answers.iter().map(|a| a.depth_m).collect::<Vec<f64>>())
    }

    /// Depth, m, and duration, s, of the hold at the deepest point. `None` if the run only touches it: no more than
    /// 2% of its time, because a slow reversal stays near the deepest point too.
    #[must_use]
    pub fn hold(&self) -> Option<(f64, f64)> {
        let Legs { hold, retraction, .. } = self.legs();
        let (first, last) = (self.answers.get(hold)?, self.answers.get(retraction.checked_sub(1)?)?);
        let whole = self.answers.last()?.time_s - self.answers.first()?.time_s;
        let duration = last.time_s - first.time_s;
        if self.answers[hold..retraction].iter().any(|a| a.depth_m < LEAVES * first.depth_m) {
            return None;
        }
        let depth = self.answers[hold..retraction].iter().map(|a| a.depth_m).fold(first.depth_m, f64::max);
        (duration.is_finite() && duration > 0.02 * whole.max(0.0)).then_some((depth, duration))
    }
}

/// The insertions and retractions of a motion in order, none of them empty, from its depths in m. A stay at the turning
/// point belongs to the pass before it.
#[must_use]
pub fn passes(depth_m: &[f64]) -> Vec<Pass> {
    let known = |i: &usize| depth_m[*i].is_finite();
    let deepest = (0..depth_m.len()).filter(known).map(|i| depth_m[i]).fold(0.0, f64::max);
    // the motion above the surface does not count
    let depth = |i: usize| depth_m[i].max(0.0);
    let mut passes = Vec::<Pass>::new();
    let (mut begun, mut far, mut best, mut back) = (0, 0, 0.0, false);
    let pass = |passes: &[Pass], range: Range<usize>, back: bool| Pass {
        range,
        back,
        number: passes.iter().filter(|pass| pass.back).count(),
    };
    for i in (0..depth_m.len()).filter(known) {
        let short = if back { depth(i) - best } else { best - depth(i) };
        if short <= HOLD_BAND * deepest {
            far = i;
            best = if short < 0.0 { depth(i) } else { best };
        } else if short > TURN * deepest {
            passes.push(pass(&passes, begun..far + 1, back));
            (begun, far, best, back) = (far + 1, i, depth(i), !back);
        }
    }
    if begun < depth_m.len() {
        passes.push(pass(&passes, begun..depth_m.len(), back));
    }
    passes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::Answer;
    use needle_core::twin::Phase;

    fn legs(depths: &[f64]) -> (usize, usize, usize) {
        let answer = |&depth_m: &f64| Answer {
            time_s: 0.0,
            depth_m,
            predicted_n: 0.0,
            measured_n: None,
            predicted_vector_n: [0.0; 3],
            measured_vector_n: None,
            model_error_n: 0.0,
            phase: Phase::Indentation,
            event: None,
            steps: 0,
            latency_s: 0.0,
        };
        let Legs { hold, retraction, end } =
            Run { answers: depths.iter().map(answer).collect(), ..Run::default() }.legs();
        (hold, retraction, end)
    }

    #[test]
    fn a_noisy_hold_is_one_leg() {
        assert_eq!(legs(&[-1.0, 0.0, 5.0, 10.0, 9.97, 10.01, 9.995, 6.0, 0.0]), (3, 7, 9));
    }

    #[test]
    fn a_turn_is_no_hold() {
        let run = |depths: Vec<f64>| {
            let answer = |(i, depth_m): (usize, f64)| Answer {
                time_s: i as f64,
                depth_m,
                predicted_n: 0.0,
                measured_n: None,
                predicted_vector_n: [0.0; 3],
                measured_vector_n: None,
                model_error_n: 0.0,
                phase: Phase::Indentation,
                event: None,
                steps: 0,
                latency_s: 0.0,
            };
            Run { answers: depths.into_iter().enumerate().map(answer).collect(), ..Run::default() }
        };
        let ramp = || (0..50).map(f64::from);
        let turn = run(ramp().chain(ramp().rev()).collect());
        assert_eq!(turn.hold(), None);
        let held = run(ramp().chain(vec![49.0; 30]).chain(ramp().rev()).collect());
        assert_eq!(held.hold(), Some((49.0, 31.0)));
        let twice = run(ramp().chain(ramp().rev()).chain(ramp()).collect());
        assert_eq!(twice.hold(), None);
        assert_eq!(Run::default().hold(), None);
    }

    #[test]
    fn in_out_and_in_again_are_three_ways() {
        let run = |depths: &[f64]| {
            let answer = |&depth_m: &f64| Answer {
                time_s: 0.0,
                depth_m,
                predicted_n: 0.0,
                measured_n: None,
                predicted_vector_n: [0.0; 3],
                measured_vector_n: None,
                model_error_n: 0.0,
                phase: Phase::Indentation,
                event: None,
                steps: 0,
                latency_s: 0.0,
            };
            Run { answers: depths.iter().map(answer).collect(), ..Run::default() }
        };
        let ways = |depths: &[f64]| -> Vec<(Range<usize>, bool, usize)> {
            run(depths).passes().into_iter().map(|p| (p.range, p.back, p.number)).collect()
        };
        let fine: Vec<f64> = (0..1000).map(|i| 1e-3 * f64::from(i)).collect();
        let back: Vec<f64> = fine.iter().rev().copied().collect();
        let cycle = [&fine[..], &back, &fine].concat();
        let found = ways(&cycle);
        let kinds: Vec<(bool, usize)> = found.iter().map(|(_, back, number)| (*back, *number)).collect();
        assert_eq!(kinds, [(false, 0), (true, 0), (false, 1)]);
        for (way, turn) in found.iter().zip([1000, 2000]) {
            assert!(way.0.end.abs_diff(turn) <= 4, "{way:?}: slow ways turn where they turn");
        }
        // a hold belongs to the pass before it, and sensor noise is no pass
        let held = [-1.0, 0.0, 5.0, 10.0, 9.99, 10.0, 5.0, -1.0, -1.0, 0.0, 5.0];
        assert_eq!(ways(&held), [(0..6, false, 0), (6..10, true, 0), (10..11, false, 1)]);
        assert_eq!(ways(&[0.0, 1.0, 2.0]), [(0..3, false, 0)]);
        assert_eq!(ways(&[-1.0, -0.5]), [(0..2, false, 0)]);
        assert!(ways(&[]).is_empty());
    }

    #[test]
    fn insertion_alone_has_no_retraction() {
        assert_eq!(legs(&[0.0, 1.0, 2.0]), (2, 3, 3));
        assert_eq!(legs(&[-1.0, -0.5]), (2, 2, 2), "never in contact: all approach");
        assert_eq!(legs(&[]), (0, 0, 0));
    }
}
