//! Calibration from tracked points inside the sample, with or without the force.
//!
//! ```text
//! smallest sum_i |u(X_i, t; keys) - u_measured,i|^2 / s_m^2  +  sum_t (a F(t; keys) + b - F_measured)^2 / s_F^2  +  (a - 1)^2 / e^2
//! ```
//!
//! s_m: noise of one coordinate of a marker; s_F: noise of the load cell, estimated from its own readings; b: the
//! load cell's zero; a: a factor on the force. Its prior standard deviation is e, the relative standard uncertainty
//! of the force (`Task::force_error`), which no number of readings reduces. The force is interpolated at the markers'
//! times. The source paper identifies its deformation coefficient from such points.

use nalgebra::{DMatrix, DVector};

use super::{CalibrateError, Wanted, paths, unknown::Sought};
use crate::compare::least_squares::{self, Problem, Solution, Unknown};
use crate::compare::{Run, Watch};
use needle_core::scene::{Override, Scene};
use needle_recording::MarkerSample;
use needle_recording::{ForceSeries, Reading};

/// Relative change of a key for its finite difference.
const DIFFERENCE: f64 = 0.01;
/// Fewest readings of the load cell from which its noise is estimated.
const LEAST_FORCES: usize = 8;

/// A calibration from markers.
#[derive(Clone, Debug)]
pub struct MarkerTask<'a> {
    /// The scene; its targets are the markers, in their order.
    pub scene: &'a Scene,
    /// The recorded motion.
    pub readings: &'a [Reading],
    /// The recorded positions.
    pub markers: &'a [MarkerSample],
    /// Standard deviation of one coordinate, m.
    pub noise_m: f64,
    /// The recorded force, and the relative standard uncertainty of its size; `None`: markers alone.
    pub force: Option<(&'a ForceSeries, f64)>,
    /// The keys to identify.
    pub wanted: &'a [Wanted],
}

/// An identified key.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerEstimate {
    /// Dotted path.
    pub key: String,
    /// The identified value.
    pub value: f64,
    /// Start of the search.
    pub start: f64,
    /// Standard error from the noise, or from the residual if that is larger; `None` where the data don't determine
    /// it.
    pub standard_error: Option<f64>,
}

/// Residual of one marker.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerResidual {
    /// Name of the target.
    pub name: String,
    /// Its position in the undeformed sample, m.
    pub position: [f64; 3],
    /// Mean of predicted - measured, m.
    pub mean_m: [f64; 3],
    /// Root mean square error of a coordinate, m.
    pub rms_m: f64,
    /// Number of times at which it was seen.
    pub seen: usize,
}

/// Result of a calibration from markers.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerFit {
    /// The scene with the identified values.
    pub scene: Scene,
    /// The keys, in the requested order.
    pub estimates: Vec<MarkerEstimate>,
    /// Residual of each marker.
    pub residuals: Vec<MarkerResidual>,
    /// Root mean square of the force's residual, N, if the force was used.
    pub rmse_n: Option<f64>,
    /// Sum of squares divided by the number of readings minus unknowns: near 1 if the model explains them.
    pub reduced_chi_square: f64,
    /// Number of runs of the twin.
    pub runs: u32,
    /// Whether the search converged.
    pub converged: bool,
}

struct Marked<'a> {
    task: &'a MarkerTask<'a>,
    watch: &'a mut dyn Watch,
    /// Time and measured force at the markers' times, if there is a force, and the load cell's noise.
    forces: Vec<(f64, f64)>,
    noise_n: f64,
    runs: u32,
}

/// Searches for the values.
///
/// # Errors
/// [`CalibrateError`] if a key can't be searched for, the scene can't be run, or its targets are not the markers.
pub fn calibrate_markers(task: &MarkerTask, watch: &mut dyn Watch) -> Result<MarkerFit, CalibrateError> {
    check(task)?;
    let sought: Vec<Sought> = task.wanted.iter().map(|w| Sought::Key(w.key.clone())).collect();
    let mut unknowns = sought.iter().map(|s| s.unknown(task.scene, task.wanted)).collect::<Result<Vec<_>, _>>()?;
    let mut marked = Marked { task, watch, forces: Vec::new(), noise_n: 0.0, runs: 0 };
    let first = marked.run(task.scene)?;
    if let Some(reason) = first.diverged {
        return Err(CalibrateError::Diverged(reason));
    }
    marked.take_forces(&first);
    if !marked.forces.is_empty() {
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        unknowns.push(Unknown { start: 0.0, bounds: free, scale: 1e-6, largest_step: f64::INFINITY });
        unknowns.push(Unknown { start: 1.0, bounds: [0.1, 10.0], scale: 1.0, largest_step: 0.5 });
    }
    let solution = least_squares::solve(&mut marked, &unknowns)?;
    let solution = solution.ok_or_else(|| CalibrateError::Diverged("at the start of the search".to_owned()))?;
    let scene = task.scene.with(&marked.changes(&solution.x))?;
    let run = marked.run(&scene)?;
    Ok(marked.judged(scene, &run, &solution, &unknowns))
}

fn check(task: &MarkerTask) -> Result<(), CalibrateError> {
    let (targets, markers) = (task.scene.targets.len(), task.markers.first().map_or(0, |m| m.positions.len()));
    let readings = task.markers.iter().map(|m| m.positions.iter().filter(|p| seen(p)).count() * 3).sum();
    if targets == 0 || targets != markers || readings <= task.wanted.len() {
        let remedy =
            "the scene needs one [[targets]] for each marker, in their order, with its place in the undeformed sample";
        return Err(CalibrateError::TooFew { readings, unknowns: task.wanted.len(), remedy });
    }
    Ok(())
}

fn seen(position: &[f64; 3]) -> bool {
    position.iter().all(|x| x.is_finite())
}

/// Position of a time between two entries: index and share of the interval, for linear interpolation; `None` outside.
fn between(times: &[f64], at: f64) -> Option<(usize, f64)> {
    let next = times.partition_point(|t| *t < at);
    match next {
        0 => (times.first() == Some(&at)).then_some((0, 0.0)),
        n if n == times.len() => None,
        n => Some((n - 1, (at - times[n - 1]) / (times[n] - times[n - 1]))),
    }
}

impl Marked<'_> {
    fn changes(&self, x: &[f64]) -> Vec<Override> {
        self.task.wanted.iter().zip(x).map(|(w, value)| Override::typed(&w.key, *value, "--fit")).collect()
    }

    fn run(&mut self, scene: &Scene) -> Result<Run, CalibrateError> {
        self.runs += 1;
        let none = ForceSeries::new(Vec::new());
        paths::run(scene, None, self.task.readings, self.task.force.map_or(&none, |(series, _)| series), self.watch)
    }

    /// Start of the run's time in recorded time: that of its first reading.
    fn begin_s(&self) -> f64 {
        self.task.readings.first().map_or(0.0, |r| r.time_s)
    }

    /// Interpolates the measured force at the markers' times, and estimates the load cell's noise from third
    /// differences, which vanish for a smooth force.
    fn take_forces(&mut self, run: &Run) {
        if self.task.force.is_none() {
            return;
        }
        let all: Vec<(f64, f64)> = run.answers.iter().filter_map(|a| Some((a.time_s, a.measured_n?))).collect();
        if all.len() < LEAST_FORCES {
            return;
        }
        // the squares of (1 -3 3 -1) add up to 20
        let third = all.windows(4).map(|w| (w[0].1 - 3.0 * w[1].1 + 3.0 * w[2].1 - w[3].1).powi(2));
        self.noise_n = (third.sum::<f64>() / (20.0 * (all.len() - 3) as f64)).sqrt();
        let times: Vec<f64> = all.iter().map(|a| a.0).collect();
        let begin = self.begin_s();
        let at = |m: &MarkerSample| {
            let (i, share) = between(&times, m.time_s - begin)?;
            let next = all.get(i + 1).unwrap_or(&all[i]);
            Some((m.time_s - begin, all[i].1 + share * (next.1 - all[i].1)))
        };
        self.forces = self.task.markers.iter().filter_map(at).collect();
    }

    /// Predicted - measured of every coordinate that was seen, m, with its marker; `None` where the run does not
    /// cover the time.
    fn marker_residuals(&self, run: &Run) -> Option<Vec<(usize, [f64; 3])>> {
        let times: Vec<f64> = run.targets.iter().map(|row| row.time_s).collect();
        let begin = self.begin_s();
        let mut all = Vec::new();
        for sample in self.task.markers {
            let Some((i, share)) = between(&times, sample.time_s - begin) else { continue };
            let (a, b) = (&run.targets[i], run.targets.get(i + 1).unwrap_or(&run.targets[i]));
            for (k, measured) in sample.positions.iter().enumerate().filter(|(_, p)| seen(p)) {
                let at = |c: usize| a.positions[k][c] + share * (b.positions[k][c] - a.positions[k][c]) - measured[c];
                all.push((k, std::array::from_fn(at)));
            }
        }
        (run.diverged.is_none() && !all.is_empty()).then_some(all)
    }

    /// Predicted + zero - measured force, N, each with its standard deviation.
    fn force_residuals(&self, run: &Run, [zero_n, size]: [f64; 2]) -> Vec<(f64, f64)> {
        let times: Vec<f64> = run.answers.iter().map(|a| a.time_s).collect();
        let peak = self.forces.iter().map(|f| f.1.abs()).fold(0.0, f64::max);
        let one = |&(time_s, measured): &(f64, f64)| {
            let (i, share) = between(&times, time_s)?;
            let next = run.answers.get(i + 1).unwrap_or(&run.answers[i]).predicted_n;
            let predicted = run.answers[i].predicted_n + share * (next - run.answers[i].predicted_n);
            Some((size * predicted + zero_n - measured, self.noise_n.max(1e-6 * peak).max(f64::MIN_POSITIVE)))
        };
        self.forces.iter().filter_map(one).collect()
    }

    /// The load cell's zero, N, and the factor of the measured force over the predicted one.
    fn cell(&self, x: &[f64]) -> [f64; 2] {
        let at = |k: usize, else_: f64| x.get(self.task.wanted.len() + k).copied().unwrap_or(else_);
        [at(0, 0.0), at(1, 1.0)]
    }

    fn scaled(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, CalibrateError> {
        let Ok(scene) = self.task.scene.with(&self.changes(x)) else { return Ok(None) };
        let run = match self.run(&scene) {
            Err(CalibrateError::Build { .. }) => return Ok(None),
            run => run?,
        };
        let Some(markers) = self.marker_residuals(&run) else { return Ok(None) };
        let noise_m = self.task.noise_m;
        let mut all: Vec<f64> = markers.iter().flat_map(|(_, r)| r.map(|r| r / noise_m)).collect();
        let cell = self.cell(x);
        all.extend(self.force_residuals(&run, cell).iter().map(|(r, s)| r / s));
        if let (Some((_, share)), false) = (self.task.force, self.forces.is_empty()) {
            all.push((cell[1] - 1.0) / share.max(1e-6));
        }
        Ok(Some(DVector::from_vec(all)))
    }

    fn judged(&self, scene: Scene, run: &Run, solution: &Solution, unknowns: &[Unknown]) -> MarkerFit {
        let (n, k) = (solution.residuals.len(), solution.x.len());
        let chi = solution.residuals.norm_squared() / n.saturating_sub(k).max(1) as f64;
        let product = solution.jacobian.transpose() * &solution.jacobian;
        let covariance = product.cholesky().map(|c| c.inverse() * chi.max(1.0));
        let error = |k: usize| covariance.as_ref().map(|c| c[(k, k)].sqrt()).filter(|e| e.is_finite());
        let estimates = self.task.wanted.iter().enumerate().map(|(k, w)| MarkerEstimate {
            key: w.key.clone(),
            value: solution.x[k],
            start: unknowns[k].start,
            standard_error: error(k),
        });
        let forces = self.force_residuals(run, self.cell(&solution.x));
        let rmse = (forces.iter().map(|(r, _)| r * r).sum::<f64>() / forces.len().max(1) as f64).sqrt();
        MarkerFit {
            estimates: estimates.collect(),
            residuals: self.map(&scene, &self.marker_residuals(run).unwrap_or_default()),
            rmse_n: (!forces.is_empty()).then_some(rmse),
            reduced_chi_square: chi,
            runs: self.runs,
            converged: solution.converged,
            scene,
        }
    }

    /// The residual of each marker.
    fn map(&self, scene: &Scene, all: &[(usize, [f64; 3])]) -> Vec<MarkerResidual> {
        let one = |(k, target): (usize, &needle_core::scene::Target)| {
            let of: Vec<&[f64; 3]> = all.iter().filter(|(m, _)| *m == k).map(|(_, r)| r).collect();
            let n = of.len().max(1) as f64;
            let squares: f64 = of.iter().flat_map(|r| r.iter()).map(|r| r * r).sum();
            MarkerResidual {
                name: target.name.clone(),
                position: target.position,
                mean_m: std::array::from_fn(|c| of.iter().map(|r| r[c]).sum::<f64>() / n),
                rms_m: (squares / (3.0 * n)).sqrt(),
                seen: of.len(),
            }
        };
        scene.targets.iter().enumerate().map(one).collect()
    }
}

impl Problem for Marked<'_> {
    type Error = CalibrateError;

    fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, CalibrateError> {
        self.scaled(x)
    }

    fn jacobian(&mut self, x: &[f64], r: &DVector<f64>) -> Result<Option<DMatrix<f64>>, CalibrateError> {
        let mut jacobian = DMatrix::zeros(r.len(), x.len());
        for k in 0..x.len() {
            let size = if x[k] == 0.0 { DIFFERENCE } else { DIFFERENCE * x[k].abs() };
            let mut column = None;
            for change in [size, -size] {
                let mut beside = x.to_vec();
                beside[k] += change;
                if let Some(other) = self.scaled(&beside)?.filter(|other| other.len() == r.len()) {
                    column = Some((other - r) / change);
                    break;
                }
            }
            let Some(column) = column else { return Ok(None) };
            jacobian.set_column(k, &column);
        }
        Ok(Some(jacobian))
    }
}
