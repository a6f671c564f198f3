//! Figures of merit of a finished run: force error, latency, speed.
//!
//! A figure that is not known (no measured force, nothing stepped, a number that is not finite) is `None`, never
//! zero.

use super::{Answer, Run};

/// Predicted against measured force.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct ForceMetrics {
    /// Predicted force of the largest magnitude, with its sign, N.
    pub peak_predicted_n: Option<f64>,
    /// Measured force of the largest magnitude, with its sign, N.
    pub peak_measured_n: Option<f64>,
    /// Root mean square of predicted - measured over the answers that have both, N.
    pub rmse_n: Option<f64>,
    /// `rmse_n` over the magnitude of `peak_measured_n`.
    pub nrmse: Option<f64>,
    /// Largest |predicted - measured|, N.
    pub max_abs_error_n: Option<f64>,
    /// Root mean square of the length of the vector predicted - measured, N, if the load cell measured a vector.
    pub rmse_vector_n: Option<f64>,
    /// Largest such length, N.
    pub max_vector_error_n: Option<f64>,
}

/// Estimated error that discretisation and steps make, over all answers of a twin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelError {
    /// Root mean square of the force's, N.
    pub force_rms_n: f64,
    /// Its largest, N.
    pub force_max_n: f64,
    /// Root mean square over the targets' displacements, of which it is the same share as of the largest force, m; `None` without targets.
    pub targets_rms_m: Option<f64>,
}

/// Wall time from a pose's arrival to its prediction, ms, by the nearest-rank rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latency {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl Run {
    /// Predicted against measured force over all answers.
    #[must_use]
    pub fn force_metrics(&self) -> ForceMetrics {
        let residuals = || self.answers.iter().filter_map(|a| a.residual_n());
        let rmse_n = root_mean_square(residuals());
        let vectors: &[Answer] = if self.measures_vectors() { &self.answers } else { &[] };
        let lengths = || vectors.iter().filter_map(Answer::vector_error_n);
        let peak_measured_n = largest_magnitude(self.answers.iter().filter_map(|a| a.measured_n));
        ForceMetrics {
            peak_predicted_n: largest_magnitude(self.answers.iter().map(|a| a.predicted_n)),
            peak_measured_n,
            rmse_n,
            nrmse: rmse_n.zip(peak_measured_n).and_then(|(rmse, peak)| ratio(rmse, peak.abs())),
            max_abs_error_n: residuals().map(f64::abs).reduce(f64::max),
            rmse_vector_n: root_mean_square(lengths()),
            max_vector_error_n: lengths().reduce(f64::max),
        }
    }

    /// Estimated error of the model; `None` if no twin answered.
    #[must_use]
    pub fn model_error(&self) -> Option<ModelError> {
        let errors = || self.answers.iter().map(|a| a.model_error_n).filter(|e| e.is_finite());
        let force_rms_n = root_mean_square(errors())?;
        let largest_n = largest_magnitude(self.answers.iter().map(|a| a.predicted_n)).map_or(0.0, f64::abs);
        let start = self.targets.first().map_or(&[][..], |row| &row.positions);
        let displacements = self.targets.iter().flat_map(|row| {
            row.positions.iter().zip(start).map(|(p, q)| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt())
        });
        let share = ratio(force_rms_n, largest_n).unwrap_or(0.0);
        Some(ModelError {
            force_rms_n,
            force_max_n: errors().fold(0.0, f64::max),
            targets_rms_m: root_mean_square(displacements.filter(|d| d.is_finite())).map(|d| share * d),
        })
    }

    /// The root mean square of the estimated error of the model over the largest predicted force; 0 without answers or force.
    #[must_use]
    pub fn relative_model_error(&self) -> f64 {
        let largest_n = largest_magnitude(self.answers.iter().map(|a| a.predicted_n)).map_or(0.0, f64::abs);
        self.model_error().and_then(|error| ratio(error.force_rms_n, largest_n)).unwrap_or(0.0)
    }

    /// Whether the load cell measured the force as a vector: at least two of its components are not always zero.
    #[must_use]
    pub(crate) fn measures_vectors(&self) -> bool {
        let read = |k: usize| self.answers.iter().filter_map(|a| a.measured_vector_n).any(|f| f[k] != 0.0);
        (0..3).filter(|&k| read(k)).count() > 1
    }

    /// Latency of the answers; `None` without a finite one.
    #[must_use]
    pub fn latency_ms(&self) -> Option<Latency> {
        let mut ms: Vec<f64> = self.answers.iter().map(|a| 1e3 * a.latency_s).filter(|t| t.is_finite()).collect();
        ms.sort_unstable_by(f64::total_cmp);
        let rank = |p: f64| ms.get(((p * ms.len() as f64).ceil() as usize).saturating_sub(1)).copied();
        Some(Latency { p50: rank(0.5)?, p99: rank(0.99)?, max: *ms.last()? })
    }

    /// Simulated (or recorded) seconds per wall second of stepping; above 1 is faster than real time.
    #[must_use]
    pub fn real_time_factor(&self) -> Option<f64> {
        ratio(self.simulated_s, self.wall_s)
    }

    /// Mean number of explicit steps of an answered pose.
    #[must_use]
    pub fn steps_per_pose(&self) -> Option<f64> {
        ratio(self.steps as f64, self.answers.len() as f64)
    }

    /// Mean wall time of one explicit step, microseconds.
    #[must_use]
    pub fn step_us(&self) -> Option<f64> {
        ratio(1e6 * self.wall_s, self.steps as f64)
    }
}

/// `None` without values.
fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), e| (sum + e * e, count + 1.0));
    (count > 0.0).then(|| (sum / count).sqrt())
}

/// `a / b`; `None` if it is not finite.
fn ratio(a: f64, b: f64) -> Option<f64> {
    Some(a / b).filter(|r| b != 0.0 && r.is_finite())
}

fn largest_magnitude(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.filter(|f| f.is_finite()).max_by(|a, b| a.abs().total_cmp(&b.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::Answer;
    use needle_core::twin::Phase;

    fn answer(predicted_n: f64, measured_n: Option<f64>, latency_s: f64) -> Answer {
        let phase = Phase::Indentation;
        Answer {
            time_s: 0.0,
            depth_m: 0.0,
            predicted_n,
            measured_n,
            predicted_vector_n: [0.0, 0.0, predicted_n],
            measured_vector_n: None,
            model_error_n: 0.0,
            phase,
            event: None,
            steps: 1,
            latency_s,
        }
    }

    #[test]
    fn errors_are_taken_over_the_answers_that_have_both() {
        let answers = vec![
            answer(1.0, Some(1.0), 0.0),
            answer(-5.0, None, 0.0),
            answer(2.0, Some(-4.0), 0.0),
            answer(f64::NAN, Some(1.0), 0.0),
        ];
        let m = Run { answers, ..Run::default() }.force_metrics();
        assert_eq!(m.peak_predicted_n, Some(-5.0));
        assert_eq!(m.peak_measured_n, Some(-4.0));
        assert_eq!(m.rmse_n, Some(18f64.sqrt()));
        assert_eq!(m.nrmse, Some(18f64.sqrt() / 4.0));
        assert_eq!(m.max_abs_error_n, Some(6.0));
        assert_eq!(m.rmse_vector_n, None, "no vector was measured");
    }

    #[test]
    fn a_load_cell_of_several_axes_is_compared_as_a_vector() {
        let of = |measured: [[f64; 3]; 2]| {
            let answer = |m: [f64; 3]| Answer { measured_vector_n: Some(m), ..answer(1.0, Some(m[2]), 0.0) };
            let m = Run { answers: measured.map(answer).to_vec(), ..Run::default() }.force_metrics();
            (m.rmse_vector_n, m.max_vector_error_n)
        };
        // predicted is (0, 0, 1)
        assert_eq!(of([[3.0, 0.0, 1.0], [0.0, 0.0, 5.0]]), (Some(12.5f64.sqrt()), Some(4.0)));
        assert_eq!(of([[0.0, 0.0, 1.0], [0.0, 0.0, 5.0]]), (None, None), "one axis alone was wired");
    }

    #[test]
    fn what_cannot_be_said_is_none() {
        let run = Run { answers: vec![answer(0.0, Some(0.0), f64::NAN)], ..Run::default() };
        assert_eq!(run.force_metrics().nrmse, None, "a zero peak is no scale");
        assert_eq!(run.latency_ms(), None);
        assert_eq!(run.real_time_factor(), None);
        assert_eq!(Run::default().force_metrics(), ForceMetrics::default());
    }

    #[test]
    fn percentiles_are_answers_that_were_seen() {
        let answers = (1..=200).rev().map(|i| answer(0.0, None, f64::from(i) * 1e-3)).collect();
        let latency = Run { answers, ..Run::default() }.latency_ms().expect("there are answers");
        assert_eq!((latency.p50, latency.p99, latency.max), (100.0, 198.0, 200.0));
    }
}
