//! The three legs of a run: towards the deepest point, at it, away from it.

use super::Run;

/// Part of the largest depth within which the instrument counts as held at it.
const HOLD_BAND: f64 = 0.002;

/// Share of the depth below which the instrument has left it: several insertions are no hold.
const LEAVES: f64 = 0.9;

/// Where a run's answers fall into insertion, hold and retraction. Any of them may be empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Legs {
    /// First answer at the deepest point: before it lies the insertion.
    pub hold: usize,
    /// First answer of the retraction, one past the last at the deepest point.
    pub retraction: usize,
    /// Number of answers.
    pub end: usize,
}

impl Run {
    /// Legs of the motion, from depth alone. "At the deepest point" is within 0.2% of it, so that the noise of a
    /// depth sensor makes no legs of its own; a motion with several cycles counts as held between its deepest
    /// answers.
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

    /// Depth, m, and duration, s, of the stay at the deepest point; `None` if the run only touches it (no more than
    /// 2% of its time: a slow turn stays near its deepest point as well).
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{compare::Answer, twin::Phase};

    fn legs(depths: &[f64]) -> (usize, usize, usize) {
        let answer = |&depth_m: &f64| Answer {
            time_s: 0.0,
            depth_m,
            predicted_n: 0.0,
            measured_n: None,
            predicted_vector_n: [0.0; 3],
            measured_vector_n: None,
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
    fn insertion_alone_has_no_retraction() {
        assert_eq!(legs(&[0.0, 1.0, 2.0]), (2, 3, 3));
        assert_eq!(legs(&[-1.0, -0.5]), (2, 2, 2), "never in contact: all approach");
        assert_eq!(legs(&[]), (0, 0, 0));
    }
}
