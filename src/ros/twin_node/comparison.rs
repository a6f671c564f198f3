//! Predicted against measured force while the node runs.
//!
//! A reading counts for a pose if it lies round the pose's stamp: two readings no more than [`MAX_GAP_NANOS`] apart are
//! interpolated. Until the later of the two is here the prediction waits, at most [`PATIENCE`] of wall time.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::identification::Identification;
use super::solver::Answer;
use crate::compare::learning::Swing;
use crate::instrument::reading::is_force;
use crate::ros::messages::needle_twin::ForceComparison;
use crate::ros::messages::std_msgs::Header;
use crate::twin::Phase;

const MAX_GAP_NANOS: i64 = 100_000_000;
const PATIENCE: Duration = Duration::from_millis(200);
/// Readings and waiting predictions that are kept: seconds at any sensible rate.
const KEPT: usize = 4096;
/// A reading that has not moved for so long while the prediction has is stuck.
const STUCK_NANOS: i64 = 1_000_000_000;
/// ... while the prediction moved by more than this, N, and by more than a twentieth of its peak.
const STUCK_CHANGE_N: f64 = 2e-3;

#[derive(Clone, Copy, Debug)]
struct Reading {
    stamp_nanos: i64,
    force_n: [f64; 3],
}

/// Readings whose stamps are within this of the newest make up the tare.
const TARE_NANOS: i64 = 100_000_000;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Comparator {
    readings: VecDeque<Reading>,
    waiting: VecDeque<(Answer, Instant)>,
    tare_n: [f64; 3],
    squares: f64,
    /// The same of the vectors' differences, N^2.
    vector_squares: f64,
    /// Components that the load cell has ever read.
    read: [bool; 3],
    max_abs: f64,
    samples: u64,
    peak_predicted: f64,
    not_finite_nanos: Option<i64>,
    same_since: Option<(Reading, f64)>,
    identification: Option<Identification>,
    swing: Swing,
}

fn axial(force: [f64; 3], axis: [f64; 3]) -> f64 {
    -(force[0] * axis[0] + force[1] * axis[1] + force[2] * axis[2])
}

impl Comparator {
    /// Compares, and identifies what is asked for.
    pub fn new(identification: Option<Identification>) -> Self {
        Self { identification, ..Self::default() }
    }

    /// Takes a reading.
    pub fn measured(&mut self, stamp_nanos: i64, force_n: [f64; 3]) {
        if !is_force(&force_n) {
            self.not_finite_nanos = Some(stamp_nanos);
            return;
        }
        // A jump back (a bag was looped): what came before belongs to another run.
        if self.readings.back().is_some_and(|last| stamp_nanos <= last.stamp_nanos) {
            if self.readings.back().is_some_and(|last| last.stamp_nanos - stamp_nanos < MAX_GAP_NANOS) {
                return;
            }
            self.readings.clear();
            self.same_since = None;
        }
        if self.readings.len() == KEPT {
            self.readings.pop_front();
        }
        self.readings.push_back(Reading { stamp_nanos, force_n });
    }

    /// Takes a prediction.
    pub fn predicted(&mut self, answer: Answer) {
        let predicted = axial(answer.prediction.force_n, answer.pose.pose.axis);
        self.peak_predicted = self.peak_predicted.max(predicted.abs());
        if self.waiting.len() == KEPT {
            self.waiting.pop_front();
        }
        self.waiting.push_back((answer, Instant::now()));
    }

    /// Takes the readings of the last tenth of a second as zero. `range_n`: where the load cell ends, N; 0 if that is not known.
    ///
    /// # Errors
    /// Why there is no such reading, or why it can't be taken.
    pub fn tare(&mut self, range_n: f64) -> Result<[f64; 3], String> {
        let newest = self.readings.back().ok_or("no load-cell reading has come")?.stamp_nanos;
        let recent = self.readings.iter().rev().take_while(|r| newest - r.stamp_nanos <= TARE_NANOS);
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for reading in recent {
            for (total, force) in sum.iter_mut().zip(reading.force_n) {
                *total += force;
            }
            n += 1.0;
        }
        let tare_n = sum.map(|total| total / n);
        if range_n > 0.0 && tare_n.iter().any(|f| f.abs() >= range_n) {
            return Err(format!(
                "the load cell reads {tare_n:?} N, at the end of its range ({range_n} N): unload it first"
            ));
        }
        self.tare_n = tare_n;
        self.clear_statistics();
        // With another zero, what was learnt of the offset is not true any more.
        self.identification.iter_mut().for_each(Identification::reset);
        Ok(self.tare_n)
    }

    /// Forgets everything but the tare.
    pub fn reset(&mut self) {
        let mut identification = self.identification.take();
        identification.iter_mut().for_each(Identification::reset);
        *self = Self { tare_n: self.tare_n, identification, ..Self::default() };
    }

    fn clear_statistics(&mut self) {
        self.squares = 0.0;
        self.vector_squares = 0.0;
        self.max_abs = 0.0;
        self.samples = 0;
    }

    /// RMSE and largest |residual| so far, N, if there were comparisons.
    pub fn statistics(&self) -> Option<(f64, f64)> {
        #[allow(clippy::cast_precision_loss)]
        (self.samples > 0).then(|| ((self.squares / self.samples as f64).sqrt(), self.max_abs))
    }

    /// Whether the load cell has read more than one component.
    fn measures_vectors(&self) -> bool {
        self.read.iter().filter(|read| **read).count() > 1
    }

    /// Root mean square of the vectors' differences so far, N; 0 where only one component is measured.
    #[allow(clippy::cast_precision_loss)]
    fn rmse_vector(&self) -> f64 {
        if self.samples > 0 && self.measures_vectors() {
            (self.vector_squares / self.samples as f64).sqrt()
        } else {
            0.0
        }
    }

    /// The next comparison that can be made, if any.
    pub fn next(&mut self, frame_id: &str, range_n: f64) -> Option<ForceComparison> {
        let (answer, since) = *self.waiting.front()?;
        let stamp = answer.stamp.nanos();
        let newest = self.readings.back().map(|r| r.stamp_nanos);
        if newest.is_none_or(|newest| newest < stamp) && since.elapsed() < PATIENCE {
            return None;
        }
        self.waiting.pop_front();
        Some(self.compare(&answer, stamp, frame_id, range_n))
    }

    fn compare(&mut self, answer: &Answer, stamp: i64, frame_id: &str, range_n: f64) -> ForceComparison {
        let predicted_n = axial(answer.prediction.force_n, answer.pose.pose.axis);
        let mut message = ForceComparison {
            header: Header { stamp: answer.stamp, frame_id: frame_id.to_owned() },
            depth_m: answer.prediction.depth_m,
            predicted_n,
            predicted_force_n: answer.prediction.force_n.into(),
            tare_n: self.tare_n.into(),
            load_cell: ForceComparison::LOAD_CELL_MISSING,
            ..ForceComparison::default()
        };
        if self.not_finite_nanos.is_some_and(|t| (t - stamp).abs() < MAX_GAP_NANOS) {
            message.load_cell = ForceComparison::LOAD_CELL_NOT_FINITE;
        } else if let Some((force, nearest)) = self.reading_at(stamp) {
            self.judge(&mut message, answer, force, stamp, nearest, range_n);
        }
        if let Some((rmse, max)) = self.statistics() {
            message.rmse_n = rmse;
            message.max_abs_error_n = max;
        }
        message.samples = self.samples;
        message.rmse_vector_n = self.rmse_vector();
        if let Some(identification) = &mut self.identification {
            let inserted = matches!(answer.prediction.phase, Phase::Penetration | Phase::Retraction);
            let doubt_n = self.swing.see(answer.pose.time_s, predicted_n, &answer.prediction.health);
            identification.take(&mut message, stamp, inserted, doubt_n);
        }
        message
    }

    #[allow(clippy::cast_precision_loss)] // a fraction of a second
    fn judge(
        &mut self,
        message: &mut ForceComparison,
        answer: &Answer,
        force: [f64; 3],
        stamp: i64,
        nearest: i64,
        range_n: f64,
    ) {
        message.measured_force_n = force.into();
        message.measured_delay_s = (stamp - nearest) as f64 * 1e-9;
        if range_n > 0.0 && force.iter().any(|f| f.abs() >= range_n) {
            message.load_cell = ForceComparison::LOAD_CELL_SATURATED;
            return;
        }
        if self.is_stuck(Reading { stamp_nanos: stamp, force_n: force }, message.predicted_n) {
            message.load_cell = ForceComparison::LOAD_CELL_STUCK;
            return;
        }
        let net = [force[0] - self.tare_n[0], force[1] - self.tare_n[1], force[2] - self.tare_n[2]];
        message.load_cell = ForceComparison::LOAD_CELL_OK;
        message.valid = true;
        message.measured_n = axial(net, answer.pose.pose.axis);
        message.residual_n = message.predicted_n - message.measured_n;
        self.squares += message.residual_n * message.residual_n;
        self.max_abs = self.max_abs.max(message.residual_n.abs());
        (0..3).for_each(|k| self.read[k] |= force[k] != 0.0);
        let predicted = answer.prediction.force_n;
        let square = (0..3).map(|k| (predicted[k] - net[k]).powi(2)).sum::<f64>();
        self.vector_squares += square;
        if self.measures_vectors() {
            message.vector_error_n = square.sqrt();
        }
        self.samples += 1;
    }

    /// Force at a time and the stamp of the reading nearest to it.
    #[allow(clippy::cast_precision_loss)] // differences of stamps
    fn reading_at(&self, stamp: i64) -> Option<([f64; 3], i64)> {
        let after = self.readings.partition_point(|r| r.stamp_nanos < stamp);
        let later = self.readings.get(after);
        let earlier = after.checked_sub(1).and_then(|i| self.readings.get(i));
        match (earlier, later) {
            (_, Some(b)) if b.stamp_nanos == stamp => Some((b.force_n, stamp)),
            (Some(a), Some(b)) if b.stamp_nanos - a.stamp_nanos <= MAX_GAP_NANOS => {
                let t = (stamp - a.stamp_nanos) as f64 / (b.stamp_nanos - a.stamp_nanos) as f64;
                let force = std::array::from_fn(|k| a.force_n[k] + t * (b.force_n[k] - a.force_n[k]));
                Some((force, if t < 0.5 { a.stamp_nanos } else { b.stamp_nanos }))
            }
            (earlier, later) => {
                let distance = |r: &&Reading| (r.stamp_nanos - stamp).abs();
                let nearest = earlier.into_iter().chain(later).min_by_key(distance)?;
                (distance(&nearest) <= MAX_GAP_NANOS / 2).then_some((nearest.force_n, nearest.stamp_nanos))
            }
        }
    }

    fn is_stuck(&mut self, reading: Reading, predicted: f64) -> bool {
        match self.same_since {
            Some((since, predicted_then)) if since.force_n == reading.force_n => {
                let change = (predicted - predicted_then).abs();
                reading.stamp_nanos - since.stamp_nanos > STUCK_NANOS
                    && change > STUCK_CHANGE_N.max(0.05 * self.peak_predicted)
            }
            _ => {
                self.same_since = Some((reading, predicted));
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::ros::messages::builtin_interfaces::Time;
    use crate::twin::{Health, Phase, Pose, Prediction, StampedPose, Work};

    fn answer(nanos: i64, force: f64) -> Answer {
        let now = Instant::now();
        Answer {
            stamp: Time::from_nanos(nanos),
            received: now,
            begun: now,
            done: now,
            pose: StampedPose { time_s: 0.0, pose: Pose { tip: [0.0; 3], axis: [0.0, 0.0, -1.0] } },
            prediction: Prediction {
                time_s: 0.0,
                depth_m: 0.001,
                force_n: [0.0, 0.0, force],
                base_force_n: [0.0; 3],
                torque_nm: [0.0; 3],
                phase: Phase::Indentation,
                event: None,
                steps: 1,
                health: Health::default(),
            },
            work: Work::default(),
            boundaries_m: None,
        }
    }

    #[test]
    fn readings_are_interpolated_and_the_sign_is_that_of_the_tissue_on_the_instrument() {
        let mut c = Comparator::default();
        c.measured(1_000_000_000, [0.0, 0.0, 0.10]);
        c.predicted(answer(1_005_000_000, 0.25));
        assert!(c.next("sample", 0.0).is_none(), "the later reading is not here");
        c.measured(1_010_000_000, [0.0, 0.0, 0.20]);
        let m = c.next("sample", 0.0).unwrap();
        assert!(m.valid);
        assert!((m.measured_n - 0.15).abs() < 1e-12);
        assert!((m.residual_n - 0.10).abs() < 1e-12);
        assert!((m.rmse_n - 0.10).abs() < 1e-12);
        assert_eq!(m.samples, 1);
    }

    #[test]
    fn a_load_cell_of_several_axes_is_compared_as_a_vector() {
        let mut c = Comparator::default();
        let mut said = |nanos: i64, force: [f64; 3]| {
            c.measured(nanos, force);
            c.predicted(answer(nanos, 0.5));
            let m = c.next("sample", 0.0).unwrap();
            [m.vector_error_n, m.rmse_vector_n]
        };
        assert_eq!(said(1_000_000_000, [0.0, 0.0, 0.5]), [0.0, 0.0], "one axis alone so far");
        let [error, rmse] = said(2_000_000_000, [0.3, 0.0, 0.1]);
        assert!((error - 0.5).abs() < 1e-15 && (rmse - 0.125f64.sqrt()).abs() < 1e-15, "{error} {rmse}");
    }

    #[test]
    fn tare_is_the_present_reading() {
        let mut c = Comparator::default();
        assert!(c.tare(0.0).is_err());
        c.measured(1_000_000_000, [0.0, 0.0, 0.5]);
        assert_eq!(c.tare(0.0).unwrap(), [0.0, 0.0, 0.5]);
        c.predicted(answer(1_000_000_000, 0.0));
        let m = c.next("sample", 0.0).unwrap();
        assert!(m.valid && m.measured_n == 0.0 && m.measured_force_n.z == 0.5);
    }

    #[test]
    fn missing_not_finite_and_saturated_are_said_and_left_out() {
        let mut c = Comparator::default();
        c.measured(1_000_000_000, [0.0, f64::NAN, 0.5]);
        c.measured(1_001_000_000, [0.0, 0.0, 10.0]);
        c.predicted(answer(1_000_000_000, 0.0));
        assert_eq!(c.next("sample", 0.0).unwrap().load_cell, ForceComparison::LOAD_CELL_NOT_FINITE);
        let mut c = Comparator::default();
        c.measured(2_000_000_000, [0.0, 0.0, 10.0]);
        c.predicted(answer(1_000_000_000, 0.0));
        assert_eq!(c.next("sample", 5.0).unwrap().load_cell, ForceComparison::LOAD_CELL_MISSING);
        c.predicted(answer(2_000_000_000, 0.0));
        assert_eq!(c.next("sample", 5.0).unwrap().load_cell, ForceComparison::LOAD_CELL_SATURATED);
        assert_eq!(c.statistics(), None);
    }

    #[test]
    fn a_reading_that_stands_still_while_the_prediction_moves_is_stuck() {
        let mut c = Comparator::default();
        for i in 0..200 {
            let stamp = 1_000_000_000 + i * 10_000_000;
            c.measured(stamp, [0.0, 0.0, 0.1]);
            c.predicted(answer(stamp, 0.1 + 0.001 * i as f64));
            let m = c.next("sample", 0.0).unwrap();
            assert_eq!(m.load_cell == ForceComparison::LOAD_CELL_STUCK, i > 100, "{i}");
        }
    }

    #[test]
    fn a_reading_that_no_load_cell_gives_counts_for_nothing() {
        let mut c = Comparator::default();
        c.measured(1_000_000_000, [0.0, 0.0, 0.10]);
        c.measured(1_000_100_000, [0.0, 0.0, 1e200]);
        c.measured(1_000_200_000, [0.0, 0.0, 0.10]);
        c.predicted(answer(1_000_200_000, 0.25));
        let m = c.next("sample", 0.0).unwrap();
        assert!(!m.valid && m.load_cell == ForceComparison::LOAD_CELL_NOT_FINITE);
        c.measured(1_200_000_000, [0.0, 0.0, 0.10]);
        c.predicted(answer(1_200_000_000, 0.25));
        let m = c.next("sample", 0.0).unwrap();
        assert!(m.valid && m.rmse_n < 0.2, "{}", m.rmse_n);
        c.measured(2_000_000_000, [0.0, 0.0, 1e308]);
        assert!(c.tare(0.0).unwrap()[2] < 0.2, "it is of the readings before");
        assert!(c.tare(0.05).unwrap_err().contains("unload"));
    }
}
