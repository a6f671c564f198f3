//! Predicted and measured force in order of time: the input of verdict and alignment.

use super::{Answer, Run};
use needle_core::twin::Phase;

/// Time for which the twin's tissue oscillates after a bonded instrument has separated, s (upper bound). The force is
/// not quasi-static then.
pub(super) const SWINGS_S: f64 = 0.3;
/// Fewest readings before the contact that determine the load cell's zero.
const LEAST_IDLE: usize = 8;

/// One entry per reading. The load cell's zero is subtracted from measured forces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// Time, s.
    pub time_s: Vec<f64>,
    /// Depth of the tip, m.
    pub depth_m: Vec<f64>,
    /// Predicted force, N, positive against the insertion.
    pub predicted_n: Vec<f64>,
    /// Measured force, N, with the same sign.
    pub measured_n: Vec<f64>,
    /// Peak of the force of which this is a component, N; 0 if it is not a component.
    pub whole_n: f64,
    /// The load cell's zero that was subtracted, N.
    pub zero_n: f64,
    /// Whether force and position were stamped by one clock. Then no offset between them is estimated.
    pub one_clock: bool,
    /// Number of readings of the load cell between which the measured forces are interpolated; `None`: as many as
    /// there are rows, or more.
    pub readings: Option<usize>,
    /// How many of the load cell's drift and zero are known. An alignment does not estimate these.
    pub known: usize,
}

impl Rows {
    /// The answers of a run that have a measured force, except while the tissue oscillates after the instrument
    /// separated.
    #[must_use]
    pub(crate) fn of(run: &Run) -> Self {
        Self::pairs(run, |a| Some((a.predicted_n, a.measured_n?)))
    }

    /// The same for one component of the force in frame `sample`, 0 to 2 for x to z, if the load cell measured a
    /// vector. It is judged relative to the size of the whole force.
    #[must_use]
    pub(crate) fn of_component(run: &Run, k: usize) -> Self {
        let of = |a: &Answer| a.measured_vector_n.map(|measured| (a.predicted_vector_n[k], measured[k]));
        Self { whole_n: Self::of(run).peak_n(), ..Self::pairs(run, of) }
    }

    /// Answers with a predicted and a measured force.
    fn pairs(run: &Run, force: impl Fn(&Answer) -> Option<(f64, f64)>) -> Self {
        let at_rest = at_rest(&run.answers);
        let usable = |a: &Answer| {
            let (predicted, measured) = force(a)?;
            ((predicted - measured).is_finite() && a.time_s.is_finite() && a.depth_m.is_finite())
                .then_some([a.time_s, a.depth_m, predicted, measured])
        };
        let mut columns: [Vec<f64>; 4] = Default::default();
        for row in run.answers.iter().zip(at_rest).filter(|(_, at_rest)| *at_rest).filter_map(|(a, _)| usable(a)) {
            columns.iter_mut().zip(row).for_each(|(column, x)| column.push(x));
        }
        let [time_s, depth_m, predicted_n, measured_n] = columns;
        Self {
            one_clock: run.one_clock,
            readings: run.force_readings,
            ..Self::new(time_s, depth_m, predicted_n, measured_n)
        }
    }

    /// From columns of equal length: times in s, depths in m, predicted and measured forces in N. The load cell's
    /// zero is estimated and subtracted.
    #[must_use]
    pub fn new(time_s: Vec<f64>, depth_m: Vec<f64>, predicted_n: Vec<f64>, measured_n: Vec<f64>) -> Self {
        let mut rows = Self { time_s, depth_m, predicted_n, measured_n, ..Self::default() };
        rows.zero_n = rows.idle().unwrap_or(0.0);
        rows.measured_n.iter_mut().for_each(|m| *m -= rows.zero_n);
        rows
    }

    /// Share of the rows that are readings of their own; the others lie between two of them.
    #[must_use]
    pub(crate) fn own_share(&self) -> f64 {
        self.readings.map_or(1.0, |readings| (readings as f64 / self.len().max(1) as f64).min(1.0))
    }

    /// Number of rows.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there is none.
    #[must_use]
    pub(crate) fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Median reading of the load cell in the first half of the time before the first contact, N.
    fn idle(&self) -> Option<f64> {
        let contact = self.depth_m.iter().position(|d| *d > 0.0).unwrap_or(self.len());
        let mut idle = self.measured_n[..contact.div_ceil(2)].to_vec();
        idle.sort_unstable_by(f64::total_cmp);
        (idle.len() >= LEAST_IDLE).then(|| idle[idle.len() / 2])
    }

    /// Predicted - measured, N.
    #[must_use]
    pub(crate) fn residual(&self, i: usize) -> f64 {
        self.predicted_n[i] - self.measured_n[i]
    }

    /// Largest predicted or measured force, N. The largest hundredth of the measured ones is ignored, because knocks
    /// are not a peak.
    #[must_use]
    pub(crate) fn peak_n(&self) -> f64 {
        let mut sizes: Vec<f64> = self.measured_n.iter().map(|m| m.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        let measured = sizes.get(sizes.len().saturating_sub(1 + sizes.len() / 100)).copied().unwrap_or(0.0);
        self.predicted_n.iter().map(|p| p.abs()).fold(measured.max(self.whole_n), f64::max)
    }

    /// Largest depth, m; 0 if the instrument stays above the sample.
    #[must_use]
    pub(crate) fn deepest_m(&self) -> f64 {
        self.depth_m.iter().copied().fold(0.0, f64::max)
    }

    /// Readings at which the predicted or the measured force exceeds a share of the peak.
    #[must_use]
    pub(crate) fn loaded(&self, share: f64) -> Vec<usize> {
        let least = share * self.peak_n();
        (0..self.len()).filter(|&i| self.predicted_n[i].abs().max(self.measured_n[i].abs()) > least).collect()
    }

    /// The rows without those in the air before a contact, where a prediction says nothing: the instrument is above the
    /// surface on its way in and less than a share of the peak is predicted. On the way out tissue may still stick to it.
    #[must_use]
    pub(crate) fn in_contact(&self, share: f64) -> Self {
        let least = share * self.predicted_n.iter().map(|p| p.abs()).fold(0.0, f64::max);
        let air = |i: usize| self.depth_m[i] <= 0.0 && self.predicted_n[i].abs() <= least;
        let mut kept: Vec<bool> = (0..self.len()).map(|i| !air(i)).collect();
        let mut from = 0;
        while let Some(begin) = (from..self.len()).find(|&i| air(i)) {
            let end = (begin..self.len()).find(|&i| !air(i)).unwrap_or(self.len());
            // the way out of an earlier contact ends at the highest point
            let highest = (begin..end).min_by(|&a, &b| self.depth_m[a].total_cmp(&self.depth_m[b])).unwrap_or(begin);
            kept[begin..highest].fill(begin > 0);
            from = end;
        }
        let of = |column: &[f64]| column.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(x, _)| *x).collect();
        let mut rows = Self {
            time_s: of(&self.time_s),
            depth_m: of(&self.depth_m),
            predicted_n: of(&self.predicted_n),
            measured_n: of(&self.measured_n),
            whole_n: self.whole_n,
            zero_n: self.zero_n,
            one_clock: self.one_clock,
            readings: None,
            known: self.known,
        };
        let own = self.own_share();
        rows.readings = self.readings.map(|_| (own * rows.len() as f64).round() as usize);
        rows
    }

    /// Standard deviation of some readings' residuals about a straight line, N, and the correlation of neighbours.
    #[must_use]
    pub(crate) fn scatter(&self, of: &[usize]) -> (f64, f64) {
        let n = of.len() as f64;
        let x = |k: usize| k as f64 - 0.5 * (n - 1.0);
        let mean = of.iter().map(|&i| self.residual(i)).sum::<f64>() / n;
        let across: f64 = (0..of.len()).map(|k| x(k) * x(k)).sum();
        let slope = of.iter().enumerate().map(|(k, &i)| x(k) * self.residual(i)).sum::<f64>() / across;
        let left: Vec<f64> = of.iter().enumerate().map(|(k, &i)| self.residual(i) - mean - slope * x(k)).collect();
        let squares: f64 = left.iter().map(|e| e * e).sum();
        let products: f64 = left.windows(2).map(|w| w[0] * w[1]).sum();
        ((squares / (n - 2.0).max(1.0)).sqrt(), if squares > 0.0 { products / squares } else { 0.0 })
    }

    /// Correlation of neighbouring residuals, after subtraction of their mean.
    #[must_use]
    pub(crate) fn autocorrelation(&self) -> Option<f64> {
        let n = self.len();
        let mean = (0..n).map(|i| self.residual(i)).sum::<f64>() / n as f64;
        let off = |i: usize| self.residual(i) - mean;
        let squares: f64 = (0..n).map(|i| off(i) * off(i)).sum();
        let products: f64 = (1..n).map(|i| off(i) * off(i - 1)).sum();
        Some(products / squares).filter(|c| c.is_finite())
    }

    /// Share of the residuals' sum of squares in each of several equal parts of the depth.
    #[must_use]
    pub(crate) fn shares(&self, parts: usize) -> Vec<f64> {
        let mut sums = vec![0.0; parts];
        let deepest = self.deepest_m();
        for i in (0..self.len()).filter(|&i| self.depth_m[i] > 0.0) {
            let part = ((self.depth_m[i] / deepest * parts as f64) as usize).min(parts - 1);
            sums[part] += self.residual(i).powi(2);
        }
        let whole: f64 = sums.iter().sum();
        if whole > 0.0 { sums.iter().map(|s| s / whole).collect() } else { Vec::new() }
    }
}

/// Which answers are outside the oscillation of tissue that has just separated from the instrument.
#[must_use]
pub(crate) fn at_rest(answers: &[Answer]) -> Vec<bool> {
    let mut left_s = f64::NEG_INFINITY;
    let mut at_rest = |a: &Answer| {
        if a.phase != Phase::Approach {
            left_s = a.time_s;
        }
        a.phase != Phase::Approach || a.time_s - left_s > SWINGS_S
    };
    answers.iter().map(&mut at_rest).collect()
}
