//! Compares predicted and measured force at run time.
//!
//! A pose is compared with the readings around its stamp: two readings no more than [`MAX_GAP_NANOS`] apart are
//! interpolated. The prediction waits for the later of the two, at most [`PATIENCE`] of wall time.
//!
//! A comparison is as old as its pose and its reading, by their times of reception ([`Agreement`]).

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::answer::Answer;
use super::identification::Identification;
use needle_core::instrument::reading::{MeasuredAxes, is_force};
use needle_core::twin::{Phase, Prediction};
use needle_estimate::compare::frozen::Frozen;
use needle_estimate::compare::learning::Swing;
use needle_estimate::live_spring::{LiveSpring, SoFar};
use ros2_messages::needle_twin::ForceComparison;
use ros2_messages::std_msgs::Header;

const MAX_GAP_NANOS: i64 = 100_000_000;
const PATIENCE: Duration = Duration::from_millis(200);
/// Number of stored readings and waiting predictions: seconds at any sensible rate.
const KEPT: usize = 4096;
/// Readings after which an axis without a number is not measured.
const ENOUGH: u32 = 50;

/// A reading of the load cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    pub stamp_nanos: i64,
    /// Time of reception.
    pub received: Instant,
    pub force_n: [f64; 3],
    /// Torque about the load cell's origin, N m.
    pub torque_nm: [f64; 3],
}

/// Agreement of a prediction and a reading, and their times of reception.
#[derive(Clone, Copy, Debug)]
pub(super) struct Agreement {
    pub pose_received: Instant,
    pub reading_received: Instant,
    /// Length of the difference over the measured components, N.
    pub error_n: f64,
    /// The same for the torque, if it is measured, N m.
    pub error_nm: Option<f64>,
    /// Length of the measured force, N.
    pub measured_n: f64,
}

/// The state of the load cell according to its newest readings.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cell {
    /// Stamp and time of reception of the newest reading that can be compared.
    pub usable: Option<(i64, Instant)>,
    /// Why the newest reading can't be compared: a `LOAD_CELL_` constant.
    pub fault: Option<u8>,
}

/// Readings whose stamps are within this time of the newest are averaged for the tare.
const TARE_NANOS: i64 = 100_000_000;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Comparator {
    readings: VecDeque<Reading>,
    waiting: VecDeque<(Answer, Instant)>,
    tare_n: [f64; 3],
    squares: f64,
    /// Sum of squares of the vectors' differences, N^2.
    vector_squares: f64,
    /// Components for which the load cell has ever given a value.
    read: [bool; 3],
    max_abs: f64,
    samples: u64,
    peak_predicted: f64,
    not_finite_nanos: Option<i64>,
    cell: Cell,
    frozen: Frozen,
    /// The newest prediction along the instrument, N.
    predicted_n: f64,
    tare_nm: [f64; 3],
    /// Components of the torque for which the load cell has ever given a value.
    read_torque: [bool; 3],
    axes: MeasuredAxes,
    /// Number of readings up to [`ENOUGH`].
    noted: u32,
    /// Stamp of the first reading of the present run.
    begun_nanos: Option<i64>,
    identification: Option<Identification>,
    swing: Swing,
    spring: LiveSpring,
}

fn axial(force: [f64; 3], axis: [f64; 3]) -> f64 {
    -(force[0] * axis[0] + force[1] * axis[1] + force[2] * axis[2])
}

impl Comparator {
    /// Compares forces, and runs the identification if it is configured.
    pub(crate) fn new(identification: Option<Identification>) -> Self {
        Self { identification, ..Self::default() }
    }

    /// Takes a reading. `range_n`: range of the load cell, N, 0 if it is not known; `band_n`: tolerated disagreement.
    pub(crate) fn measured(&mut self, mut reading: Reading, range_n: f64, band_n: f64) {
        self.leave_out_what_is_not_measured(&mut reading);
        let Reading { stamp_nanos, received, force_n, .. } = reading;
        if !is_force(&force_n) {
            self.not_finite_nanos = Some(stamp_nanos);
            self.cell.fault = Some(ForceComparison::LOAD_CELL_NOT_FINITE);
            return;
        }
        // A jump back (a bag was looped): earlier readings belong to another run.
        if self.readings.back().is_some_and(|last| stamp_nanos <= last.stamp_nanos) {
            if self.readings.back().is_some_and(|last| last.stamp_nanos - stamp_nanos < MAX_GAP_NANOS) {
                return;
            }
            self.readings.clear();
            (self.frozen, self.begun_nanos) = (Frozen::default(), None);
        }
        let time = Duration::from_nanos(stamp_nanos.abs_diff(*self.begun_nanos.get_or_insert(stamp_nanos)));
        self.frozen.take(time, force_n, self.predicted_n, self.peak_predicted, band_n);
        self.cell.fault = if range_n > 0.0 && force_n.iter().any(|f| f.abs() >= range_n) {
            Some(ForceComparison::LOAD_CELL_SATURATED)
        } else {
            self.frozen.is_suspected().then_some(ForceComparison::LOAD_CELL_STUCK)
        };
        if self.cell.fault.is_none() {
            self.cell.usable = Some((stamp_nanos, received));
        }
        if self.readings.len() == KEPT {
            self.readings.pop_front();
        }
        self.readings.push_back(reading);
    }

    /// The state of the load cell according to its newest readings.
    pub(crate) const fn cell(&self) -> Cell {
        self.cell
    }

    /// Which axes the load cell does not measure, said once there are enough readings.
    pub(crate) fn unmeasured(&mut self) -> Option<String> {
        self.noted = self.noted.saturating_add(1);
        (self.noted == ENOUGH).then(|| self.axes.missing()).flatten()
    }

    fn leave_out_what_is_not_measured(&mut self, reading: &mut Reading) {
        self.axes.note(&reading.force_n);
        reading.force_n = self.axes.force(reading.force_n).unwrap_or([f64::NAN; 3]);
        // a cell of one axis measures along the instrument, whichever axis its driver uses
        reading.force_n.swap(self.axes.only().unwrap_or(2), 2);
        for k in 0..3 {
            // the torque is optional: without it the force is still compared
            let read = reading.torque_nm[k].is_finite() && reading.torque_nm[k] != 0.0;
            self.read_torque[k] |= read;
            if !self.read_torque[k] {
                reading.torque_nm[k] = 0.0;
            }
        }
    }

    /// Takes a prediction.
    pub(crate) fn predicted(&mut self, answer: Answer) {
        let predicted = axial(answer.prediction.force_n, answer.pose.pose.axis);
        self.predicted_n = predicted;
        self.peak_predicted = self.peak_predicted.max(predicted.abs());
        if self.waiting.len() == KEPT {
            self.waiting.pop_front();
        }
        self.waiting.push_back((answer, Instant::now()));
    }

    /// Takes the mean of the readings in the last tenth of a second as zero. `range_n`: range of the load cell, N; 0
    /// if it is not known. `band_n`: largest change of the zero, N; 0: no limit.
    ///
    /// # Errors
    /// Why there is no such reading, or why the tare is rejected.
    pub(crate) fn tare(&mut self, range_n: f64, band_n: f64) -> Result<[f64; 3], String> {
        let newest = self.readings.back().ok_or("no load-cell reading has come")?.stamp_nanos;
        let recent = self.readings.iter().rev().take_while(|r| newest - r.stamp_nanos <= TARE_NANOS);
        let (mut sum, mut n) = ([0.0; 6], 0.0);
        for reading in recent {
            for (total, x) in sum.iter_mut().zip(reading.force_n.iter().chain(&reading.torque_nm)) {
                *total += x;
            }
            n += 1.0;
        }
        let [x, y, z, mx, my, mz] = sum.map(|total| total / n);
        let tare_n = [x, y, z];
        if range_n > 0.0 && tare_n.iter().any(|f| f.abs() >= range_n) {
            return Err(format!(
                "the load cell reads {tare_n:?} N, at the end of its range ({range_n} N): unload it first"
            ));
        }
        let moved_n = length(std::array::from_fn(|k| tare_n[k] - self.tare_n[k]));
        if band_n > 0.0 && moved_n >= band_n {
            return Err(format!(
                "the load cell is {moved_n:.4} N from its zero, beyond residual_band_n ({band_n} N): unload it first. If that is the \
                 weight of the tool, call ~/force_tare"
            ));
        }
        (self.tare_n, self.tare_nm) = (tare_n, [mx, my, mz].map(|m| if m.is_finite() { m } else { 0.0 }));
        self.clear_statistics();
        // With another zero, the identified offset is no longer valid.
        self.identification.iter_mut().for_each(Identification::reset);
        Ok(self.tare_n)
    }

    /// Resets everything except the tare.
    pub(crate) fn reset(&mut self) {
        let mut identification = self.identification.take();
        identification.iter_mut().for_each(Identification::reset);
        *self = Self {
            tare_n: self.tare_n,
            tare_nm: self.tare_nm,
            axes: self.axes,
            noted: self.noted,
            read: self.read,
            read_torque: self.read_torque,
            frozen: self.frozen,
            cell: self.cell,
            begun_nanos: self.begun_nanos,
            identification,
            ..Self::default()
        };
    }

    fn clear_statistics(&mut self) {
        self.squares = 0.0;
        self.vector_squares = 0.0;
        self.max_abs = 0.0;
        self.samples = 0;
        self.spring = LiveSpring::default();
    }

    /// RMSE and largest |residual| so far, N, if there were comparisons.
    pub(crate) fn statistics(&self) -> Option<(f64, f64)> {
        #[allow(clippy::cast_precision_loss)]
        (self.samples > 0).then(|| ((self.squares / self.samples as f64).sqrt(), self.max_abs))
    }

    /// The twin against a spring so far.
    pub(crate) fn against_spring(&self) -> Option<SoFar> {
        self.spring.so_far()
    }

    /// Whether the load cell has given more than one component.
    fn measures_vectors(&self) -> bool {
        self.read.iter().filter(|read| **read).count() > 1
    }

    /// Root mean square of the vectors' differences so far, N; 0 if only one component is measured.
    #[allow(clippy::cast_precision_loss)]
    fn rmse_vector(&self) -> f64 {
        if self.samples > 0 && self.measures_vectors() {
            (self.vector_squares / self.samples as f64).sqrt()
        } else {
            0.0
        }
    }

    /// The next possible comparison, if any, and the agreement if it is valid.
    pub(crate) fn next(&mut self, frame_id: &str, range_n: f64) -> Option<(ForceComparison, Option<Agreement>)> {
        let (answer, since) = *self.waiting.front()?;
        let stamp = answer.stamp.nanos();
        let newest = self.readings.back().map(|r| r.stamp_nanos);
        if newest.is_none_or(|newest| newest < stamp) && since.elapsed() < PATIENCE {
            return None;
        }
        self.waiting.pop_front();
        Some(self.compare(&answer, stamp, frame_id, range_n))
    }

    fn compare(
        &mut self,
        answer: &Answer,
        stamp: i64,
        frame_id: &str,
        range_n: f64,
    ) -> (ForceComparison, Option<Agreement>) {
        let predicted_n = axial(answer.prediction.force_n, answer.pose.pose.axis);
        let mut message = ForceComparison {
            header: Header { stamp: answer.stamp, frame_id: frame_id.to_owned() },
            depth_m: answer.prediction.depth_m,
            predicted_n,
            model_error_n: answer.prediction.model_error_n(),
            predicted_force_n: answer.prediction.force_n.into(),
            tare_n: self.tare_n.into(),
            load_cell: ForceComparison::LOAD_CELL_MISSING,
            ..ForceComparison::default()
        };
        let mut agreement = None;
        if self.not_finite_nanos.is_some_and(|t| (t - stamp).abs() < MAX_GAP_NANOS) {
            message.load_cell = ForceComparison::LOAD_CELL_NOT_FINITE;
        } else if let Some((reading, nearest)) = self.reading_at(stamp) {
            agreement = self.judge(&mut message, answer, &reading, nearest, range_n);
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
        (message, agreement)
    }

    #[allow(clippy::cast_precision_loss)] // a fraction of a second
    fn judge(
        &mut self,
        message: &mut ForceComparison,
        answer: &Answer,
        reading: &Reading,
        nearest: i64,
        range_n: f64,
    ) -> Option<Agreement> {
        let Reading { stamp_nanos, force_n: force, torque_nm, received } = *reading;
        message.measured_force_n = force.into();
        message.measured_delay_s = (stamp_nanos - nearest) as f64 * 1e-9;
        if range_n > 0.0 && force.iter().any(|f| f.abs() >= range_n) {
            message.load_cell = ForceComparison::LOAD_CELL_SATURATED;
            return None;
        }
        if self.frozen.is_found() {
            message.load_cell = ForceComparison::LOAD_CELL_STUCK;
            return None;
        }
        let net: [f64; 3] = std::array::from_fn(|k| force[k] - self.tare_n[k]);
        message.load_cell = ForceComparison::LOAD_CELL_OK;
        message.valid = true;
        message.measured_n = axial(net, answer.pose.pose.axis);
        message.residual_n = message.predicted_n - message.measured_n;
        self.squares += message.residual_n * message.residual_n;
        self.spring.take(message.depth_m, message.predicted_n, message.measured_n);
        self.max_abs = self.max_abs.max(message.residual_n.abs());
        (0..3).for_each(|k| self.read[k] |= force[k] != 0.0);
        let Prediction { force_n: predicted_n, torque_nm: predicted_nm, .. } = answer.prediction;
        let difference: [f64; 3] = std::array::from_fn(|k| predicted_n[k] - net[k]);
        self.vector_squares += difference.iter().map(|d| d * d).sum::<f64>();
        if self.measures_vectors() {
            message.vector_error_n = length(difference);
        }
        self.samples += 1;
        let torque = self.read_torque.contains(&true);
        let error_nm = length(masked(
            std::array::from_fn(|k| predicted_nm[k] - (torque_nm[k] - self.tare_nm[k])),
            self.read_torque,
        ));
        Some(Agreement {
            pose_received: answer.received,
            reading_received: received,
            error_n: length(masked(difference, self.read)).max(message.residual_n.abs()),
            error_nm: torque.then_some(if error_nm.is_finite() { error_nm } else { f64::MAX }),
            measured_n: length(masked(net, self.read)),
        })
    }

    /// The reading at a time, and the stamp of the nearest reading. An interpolated reading has the time of reception
    /// of the later one.
    #[allow(clippy::cast_precision_loss)] // differences of stamps
    fn reading_at(&self, stamp: i64) -> Option<(Reading, i64)> {
        let after = self.readings.partition_point(|r| r.stamp_nanos < stamp);
        let later = self.readings.get(after);
        let earlier = after.checked_sub(1).and_then(|i| self.readings.get(i));
        match (earlier, later) {
            (_, Some(b)) if b.stamp_nanos == stamp => Some((*b, stamp)),
            (Some(a), Some(b)) if b.stamp_nanos - a.stamp_nanos <= MAX_GAP_NANOS => {
                let t = (stamp - a.stamp_nanos) as f64 / (b.stamp_nanos - a.stamp_nanos) as f64;
                let between = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
                let (force_n, torque_nm) = (between(a.force_n, b.force_n), between(a.torque_nm, b.torque_nm));
                let reading = Reading { stamp_nanos: stamp, force_n, torque_nm, ..*b };
                Some((reading, if t < 0.5 { a.stamp_nanos } else { b.stamp_nanos }))
            }
            (earlier, later) => {
                let distance = |r: &&Reading| (r.stamp_nanos - stamp).abs();
                let nearest = *earlier.into_iter().chain(later).min_by_key(distance)?;
                let reading = Reading { stamp_nanos: stamp, ..nearest };
                (distance(&&nearest) <= MAX_GAP_NANOS / 2).then_some((reading, nearest.stamp_nanos))
            }
        }
    }
}

/// Length of a vector.
fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A vector without the components that are not measured.
fn masked(v: [f64; 3], measured: [bool; 3]) -> [f64; 3] {
    std::array::from_fn(|k| if measured[k] { v[k] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use needle_core::twin::{Health, Phase, Pose, Prediction, StampedPose, Work};
    use ros2_messages::builtin_interfaces::Time;

    /// Takes a reading received at its stamp.
    fn hear(c: &mut Comparator, stamp_nanos: i64, force_n: [f64; 3], range_n: f64) {
        c.measured(Reading { stamp_nanos, received: Instant::now(), force_n, torque_nm: [0.0; 3] }, range_n, 0.0);
    }

    fn next(c: &mut Comparator, range_n: f64) -> Option<ForceComparison> {
        c.next("sample", range_n).map(|(message, _)| message)
    }

    fn answer(nanos: i64, force: f64) -> Answer {
        let now = Instant::now();
        Answer {
            stamp: Time::from_nanos(nanos),
            received: now,
            begun: now,
            done: now,
            pose: StampedPose { time_s: 0.0, pose: Pose { tip: [0.0; 3], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 } },
            prediction: Prediction {
                time_s: 0.0,
                depth_m: 0.001,
                force_n: [0.0, 0.0, force],
                base_force_n: [0.0; 3],
                template_force_n: [0.0; 3],
                torque_nm: [0.0; 3],
                phase: Phase::Indentation,
                event: None,
                steps: 1,
                health: Health::default(),
            },
            work: Work::default(),
            boundaries_m: None,
            bent_tip: None,
        }
    }

    #[test]
    fn a_spring_is_compared_with_and_a_tare_begins_anew() {
        let mut c = Comparator::default();
        for i in 1..60 {
            let mut stiffening = answer(i * 10_000_000, f64::from(i as u8).powi(3));
            stiffening.prediction.depth_m = 1e-4 * f64::from(i as u8);
            hear(&mut c, i * 10_000_000, [0.0, 0.0, f64::from(i as u8).powi(3)], 0.0);
            c.predicted(stiffening);
            next(&mut c, 0.0).unwrap();
        }
        assert!(c.against_spring().unwrap().words().starts_with("better than a spring"));
        c.tare(0.0, 0.0).unwrap();
        assert!(c.against_spring().is_none());
    }

    #[test]
    fn readings_are_interpolated_and_the_sign_is_that_of_the_tissue_on_the_instrument() {
        let mut c = Comparator::default();
        hear(&mut c, 1_000_000_000, [0.0, 0.0, 0.10], 0.0);
        c.predicted(answer(1_005_000_000, 0.25));
        assert!(next(&mut c, 0.0).is_none(), "the later reading is not here");
        hear(&mut c, 1_010_000_000, [0.0, 0.0, 0.20], 0.0);
        let m = next(&mut c, 0.0).unwrap();
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
            hear(&mut c, nanos, force, 0.0);
            c.predicted(answer(nanos, 0.5));
            let m = next(&mut c, 0.0).unwrap();
            [m.vector_error_n, m.rmse_vector_n]
        };
        assert_eq!(said(1_000_000_000, [0.0, 0.0, 0.5]), [0.0, 0.0], "one axis alone so far");
        let [error, rmse] = said(2_000_000_000, [0.3, 0.0, 0.1]);
        assert!((error - 0.5).abs() < 1e-15 && (rmse - 0.125f64.sqrt()).abs() < 1e-15, "{error} {rmse}");
    }

    #[test]
    fn tare_is_the_present_reading() {
        let mut c = Comparator::default();
        assert!(c.tare(0.0, 0.0).is_err());
        hear(&mut c, 1_000_000_000, [0.0, 0.0, 0.5], 0.0);
        assert_eq!(c.tare(0.0, 0.0).unwrap(), [0.0, 0.0, 0.5]);
        c.predicted(answer(1_000_000_000, 0.0));
        let m = next(&mut c, 0.0).unwrap();
        assert!(m.valid && m.measured_n == 0.0 && m.measured_force_n.z == 0.5);
    }

    #[test]
    fn missing_not_finite_and_saturated_are_said_and_left_out() {
        let mut c = Comparator::default();
        hear(&mut c, 900_000_000, [0.0, 0.0, 0.5], 0.0);
        hear(&mut c, 1_000_000_000, [0.0, f64::NAN, 0.5], 0.0);
        hear(&mut c, 1_001_000_000, [0.0, 0.0, 10.0], 0.0);
        c.predicted(answer(1_000_000_000, 0.0));
        assert_eq!(next(&mut c, 0.0).unwrap().load_cell, ForceComparison::LOAD_CELL_NOT_FINITE);
        let mut c = Comparator::default();
        hear(&mut c, 2_000_000_000, [0.0, 0.0, 10.0], 5.0);
        c.predicted(answer(1_000_000_000, 0.0));
        assert_eq!(next(&mut c, 5.0).unwrap().load_cell, ForceComparison::LOAD_CELL_MISSING);
        c.predicted(answer(2_000_000_000, 0.0));
        assert_eq!(next(&mut c, 5.0).unwrap().load_cell, ForceComparison::LOAD_CELL_SATURATED);
        assert_eq!(c.statistics(), None);
    }

    #[test]
    fn a_reading_that_stands_still_while_the_prediction_moves_is_stuck() {
        let mut c = Comparator::default();
        for i in 0..200 {
            let stamp = 1_000_000_000 + i * 10_000_000;
            hear(&mut c, stamp, [0.0, 0.0, 0.1], 0.0);
            c.predicted(answer(stamp, 0.1 + 0.001 * i as f64));
            let m = next(&mut c, 0.0).unwrap();
            assert_eq!(m.load_cell == ForceComparison::LOAD_CELL_STUCK, i > 100, "{i}");
            assert_eq!(c.cell().fault.is_some(), i > 10, "{i}: suspected");
        }
    }

    #[test]
    fn what_is_not_measured_is_no_fault_and_what_was_measured_is_missed() {
        let mut c = Comparator::default();
        for (nanos, x, error_n) in [(1_000_000_000, f64::NAN, 0.0), (2_000_000_000, 0.3, 0.3)] {
            hear(&mut c, nanos, [x, f64::NAN, 0.1], 0.0);
            c.predicted(answer(nanos, 0.1));
            let (m, agreement) = c.next("sample", 0.0).unwrap();
            assert!(m.valid && c.cell().fault.is_none(), "{nanos}");
            assert_eq!(agreement.map(|a| a.error_n), Some(error_n), "{nanos}: across the axis");
        }
        hear(&mut c, 3_000_000_000, [f64::NAN, f64::NAN, 0.1], 0.0);
        assert_eq!(c.cell().fault, Some(ForceComparison::LOAD_CELL_NOT_FINITE), "x was there");
    }

    #[test]
    fn a_torque_counts_once_it_is_measured() {
        let mut c = Comparator::default();
        let mut error_nm = |nanos: i64, torque: f64| {
            let received = Instant::now();
            let reading =
                Reading { stamp_nanos: nanos, received, force_n: [0.0, 0.0, 0.1], torque_nm: [torque, 0.0, 0.0] };
            c.measured(reading, 0.0, 0.0);
            c.predicted(answer(nanos, 0.1));
            c.next("sample", 0.0).unwrap().1.unwrap().error_nm
        };
        assert_eq!((error_nm(1, f64::NAN), error_nm(2, 0.0), error_nm(3, -0.5)), (None, None, Some(0.5)));
        assert_eq!(error_nm(4, f64::NAN), Some(f64::MAX), "it is missed");
    }

    #[test]
    fn zero_is_not_moved_beyond_the_band() {
        let mut c = Comparator::default();
        hear(&mut c, 1_000_000_000, [0.0, 0.0, 50.0], 0.0);
        assert!(c.tare(0.0, 0.02).unwrap_err().contains("force_tare"));
        assert!(c.tare(0.0, 0.0).is_ok());
    }

    #[test]
    fn a_reading_that_no_load_cell_gives_counts_for_nothing() {
        let mut c = Comparator::default();
        hear(&mut c, 1_000_000_000, [0.0, 0.0, 0.10], 0.0);
        hear(&mut c, 1_000_100_000, [0.0, 0.0, 1e200], 0.0);
        hear(&mut c, 1_000_200_000, [0.0, 0.0, 0.10], 0.0);
        c.predicted(answer(1_000_200_000, 0.25));
        let m = next(&mut c, 0.0).unwrap();
        assert!(!m.valid && m.load_cell == ForceComparison::LOAD_CELL_NOT_FINITE);
        hear(&mut c, 1_200_000_000, [0.0, 0.0, 0.10], 0.0);
        c.predicted(answer(1_200_000_000, 0.25));
        let m = next(&mut c, 0.0).unwrap();
        assert!(m.valid && m.rmse_n < 0.2, "{}", m.rmse_n);
        hear(&mut c, 2_000_000_000, [0.0, 0.0, 1e308], 0.0);
        assert!(c.tare(0.0, 0.0).unwrap()[2] < 0.2, "it is of the readings before");
        assert!(c.tare(0.05, 0.0).unwrap_err().contains("unload"));
    }
}
