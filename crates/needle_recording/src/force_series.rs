//! The measured force as a function of time, interpolated at the stamps of the poses.

use needle_core::instrument::reading::{FORCE_N, TIME_S, is_force};

/// A pause of more than this many ordinary sampling intervals is a gap, across which nothing is interpolated.
const GAP_INTERVALS: f64 = 5.0;
/// Gaps shorter than this are always interpolated, s.
const LEAST_GAP_S: f64 = 0.1;

/// Force of the tissue on the instrument in frame `sample`, N, sampled over time.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ForceSeries {
    samples: Vec<(f64, [f64; 3])>,
    longest_gap_s: f64,
    left_out: usize,
    one_clock: bool,
    holes: Vec<[f64; 2]>,
}

impl ForceSeries {
    /// Takes samples of (time in s, force in N) in any order. Samples that no load cell can produce (see
    /// [`needle_core::instrument::reading`]) are left out. Of several samples at one time the last is kept.
    #[must_use]
    pub fn new(mut samples: Vec<(f64, [f64; 3])>) -> Self {
        let all = samples.len();
        samples.retain(|(time, force)| TIME_S.contains(*time) && is_force(force));
        let left_out = all - samples.len();
        // a sort takes memory even where there is nothing to do
        if !samples.is_sorted_by(|a, b| a.0 <= b.0) {
            samples.sort_by(|a, b| a.0.total_cmp(&b.0)); // stable: the last of equal times stays last
        }
        samples.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                *kept = *next;
            }
            same
        });
        let mut intervals: Vec<f64> = samples.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        intervals.sort_unstable_by(f64::total_cmp);
        let median = intervals.get(intervals.len() / 2).copied().unwrap_or(0.0);
        let longest_gap_s = (GAP_INTERVALS * median).max(LEAST_GAP_S);
        Self { samples, longest_gap_s, left_out, one_clock: false, holes: Vec::new() }
    }

    /// Sets whether force and position were stamped by one clock; then no offset between them is estimated.
    #[must_use]
    pub fn on_one_clock(self, one_clock: bool) -> Self {
        Self { one_clock, ..self }
    }

    /// Whether force and position were stamped by one clock.
    #[must_use]
    pub const fn one_clock(&self) -> bool {
        self.one_clock
    }

    /// Sets the intervals without recorded data during which the instrument may have moved, from and to, s.
    #[must_use]
    pub(crate) fn with_holes(self, holes: Vec<[f64; 2]>) -> Self {
        Self { holes, ..self }
    }

    /// Intervals without recorded data, from and to, s.
    #[must_use]
    pub fn holes(&self) -> &[[f64; 2]] {
        &self.holes
    }

    /// What was left out, in one sentence; `None` if nothing was.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        let n = self.left_out;
        (n > 0).then(|| {
            format!(
                "{n} readings of the load cell left out: a component is not in {FORCE_N} N, or a time not in {TIME_S} s"
            )
        })
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Number of samples from one time to another.
    #[must_use]
    pub fn between(&self, from_s: f64, to_s: f64) -> usize {
        let before = |time_s: f64| self.samples.partition_point(|(time, _)| *time < time_s);
        let after = self.samples.partition_point(|(time, _)| *time <= to_s);
        after.saturating_sub(before(from_s))
    }

    /// Force at a time, interpolated linearly; `None` before the first sample, after the last, and in a gap.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<[f64; 3]> {
        let after = self.samples.partition_point(|(time, _)| *time < time_s);
        let &(t1, f1) = self.samples.get(after)?;
        if t1 == time_s {
            return Some(f1);
        }
        let &(t0, f0) = self.samples.get(after.checked_sub(1)?)?;
        if t1 - t0 > self.longest_gap_s {
            return None;
        }
        let w = (time_s - t0) / (t1 - t0);
        Some(std::array::from_fn(|k| f0[k] + w * (f1[k] - f0[k])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(times: impl IntoIterator<Item = f64>) -> ForceSeries {
        ForceSeries::new(times.into_iter().map(|t| (t, [t, 2.0 * t, -t])).collect())
    }

    #[test]
    fn nothing_is_made_up_outside_or_in_a_gap() {
        let series = line([0.0, 0.01, 0.02, 0.03, 10.0, 10.01]);
        assert_eq!(series.at(-1e-9), None);
        assert_eq!(series.at(10.02), None);
        assert_eq!(series.at(5.0), None, "ten seconds without a sample");
        assert_eq!(series.at(10.0), Some([10.0, 20.0, -10.0]), "at a sample there is one");
        assert_eq!(ForceSeries::default().at(0.0), None);
        assert_eq!(series.at(f64::NAN), None);
    }

    #[test]
    fn disorder_repeats_and_nonsense_are_sorted_out() {
        let force = |f: f64| [f, 0.0, 0.0];
        let series = ForceSeries::new(vec![
            (0.02, force(2.0)),
            (0.0, force(0.0)),
            (0.01, force(9.0)),
            (0.01, force(1.0)),
            (0.015, force(f64::NAN)),
            (f64::INFINITY, force(0.0)),
        ]);
        assert_eq!(series.at(0.01), Some(force(1.0)), "of two at one time the last counts");
        assert_eq!(series.at(0.015), Some(force(1.5)), "the sample that is no number is not there");
    }

    #[test]
    fn a_force_that_no_load_cell_gives_is_left_out_and_said() {
        let samples =
            vec![(0.0, [0.0, 0.0, 1.0]), (0.01, [0.0, 0.0, 1e200]), (0.02, [0.0, 0.0, 3.0]), (1e300, [0.0; 3])];
        let series = ForceSeries::new(samples);
        assert_eq!(series.at(0.01), Some([0.0, 0.0, 2.0]));
        assert!(series.loss().is_some_and(|loss| loss.contains("2 readings")), "{:?}", series.loss());
        assert_eq!(ForceSeries::new(vec![(0.0, [1.0; 3])]).loss(), None);
    }

    proptest! {
        #[test]
        fn a_straight_line_comes_back(t in 0.0..1.0f64, n in 11usize..50) {
            let series = line((0..=n).map(|i| i as f64 / n as f64));
            let [x, y, z] = series.at(t).expect("inside");
            prop_assert!((x - t).abs() < 1e-14 && (y - 2.0 * t).abs() < 1e-14 && (z + t).abs() < 1e-14);
        }
    }
}
