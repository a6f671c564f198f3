//! Calibration: the values of scene keys with which the twin's force comes nearest to a recorded one.
//!
//! ```text
//! smallest sum_i (F(d_1..i; keys) + offset + drift t_i - F_measured,i)^2
//! ```
//!
//! Every F is a whole run of the twin over the recorded motion, the same as `replay` makes. Offset and drift are those of the
//! load cell, estimated alongside.

mod forces;
mod prediction;
mod problem;
mod split;

use std::ops::Range;

use crate::compare::uncertainty::{Uncertainty, correlation};
use crate::compare::{ForceSeries, Reading, Watch, least_squares};
use crate::scene::{Override, Scene, SceneError, keys};
use crate::twin::BuildError;

pub use forces::{Forces, rmse};
pub use prediction::{Prediction, predict};
use problem::{LoadCellTerm, Recorded};
pub use split::{HoldOut, Parts};

/// Bounds of a 95% interval over the standard error.
pub const INTERVAL_95: f64 = 1.96;
/// Where a key's range has an end that isn't allowed, the search keeps this share of the start away from it.
const OFF_THE_END: f64 = 1e-3;
/// Largest change of a key in one step, as a share of it.
const LARGEST_STEP: f64 = 0.5;
/// Size of a key that starts at zero, over its bounds' distance.
const SIZE_AT_ZERO: f64 = 0.1;

/// A key that is to be found, and between which values.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Dotted path.
    pub key: String,
    /// Least and largest value, in the key's unit; `None`: the key's own range.
    pub bounds: Option<[f64; 2]>,
}

/// What of the load cell is estimated alongside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadCell {
    /// Nothing: its readings are taken as they are.
    Exact,
    /// Reading without load.
    Offset,
    /// The same, and its change with time.
    Drift,
}

/// What is to be found from what.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// The scene; its own values are where the search begins.
    pub scene: &'a Scene,
    /// The recorded motion.
    pub readings: &'a [Reading],
    /// The recorded force.
    pub measured: &'a ForceSeries,
    /// The keys.
    pub wanted: &'a [Wanted],
    /// What of the load cell is estimated.
    pub load_cell: LoadCell,
    /// Relative standard uncertainty of the force, from errors of discretisation and load cell that no number of readings
    /// reduces.
    pub force_error: f64,
    /// Which part of the recording is fitted.
    pub part: HoldOut,
}

/// One estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The scene's key, or `load_cell.offset_n`, `load_cell.drift_n_per_s`.
    pub name: String,
    /// The value found.
    pub value: f64,
    /// Where the search began.
    pub start: f64,
    /// Between these.
    pub bounds: [f64; 2],
    /// Standard error by noise; `None` where the data don't determine the value.
    pub noise_error: Option<f64>,
    /// Standard error by [`Task::force_error`].
    pub systematic_error: Option<f64>,
    /// Whether the data say anything about it at all.
    pub has_effect: bool,
}

impl Estimate {
    /// Standard error by both, in the unit of the value; `None` where the data don't determine it.
    #[must_use]
    pub fn standard_error(&self) -> Option<f64> {
        self.noise_error.zip(self.systematic_error).map(|(a, b)| a.hypot(b))
    }

    /// The 95% interval, cut to the bounds.
    #[must_use]
    pub fn interval_95(&self) -> Option<[f64; 2]> {
        let half = INTERVAL_95 * self.standard_error()?;
        let [low, high] = self.bounds;
        Some([(self.value - half).max(low), (self.value + half).min(high)])
    }

    /// Whether the search ended at a bound.
    #[must_use]
    pub fn at_bound(&self) -> bool {
        self.value <= self.bounds[0] || self.value >= self.bounds[1]
    }
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The scene with the values found.
    pub scene: Scene,
    /// The keys, in the order in which they were asked for, then the load cell's.
    pub estimates: Vec<Estimate>,
    /// How many of the estimates are keys.
    pub keys: usize,
    /// Keys that took the value of a wanted one, with it: the scene had them equal.
    pub tied: Vec<(String, String)>,
    /// Correlation of the estimates' errors; `None` where one of the two is not determined.
    pub correlation: Vec<Vec<Option<f64>>>,
    /// Names of those that the data can't tell apart.
    pub indistinguishable: Vec<Vec<String>>,
    /// Measured force and the twin's, before and after.
    pub forces: Forces,
    /// Readings that were fitted, and those that were held out, as indices into `forces`.
    pub parts: Parts,
    /// Readings of the fitted part that were left out as spikes.
    pub left_out: usize,
    /// Steps of the search.
    pub iterations: usize,
    /// Runs of the twin.
    pub runs: u32,
    /// Whether the search arrived; else it ran out of steps.
    pub converged: bool,
}

impl Calibration {
    /// Root mean square of what is left over the part that was fitted, spikes included, N.
    #[must_use]
    pub fn rmse_n(&self) -> f64 {
        self.rmse_of(&self.parts.fitted)
    }

    /// The same over the readings that were held out, if any, N.
    #[must_use]
    pub fn held_out_rmse_n(&self) -> Option<f64> {
        self.parts.held_out.as_ref().map(|range| self.rmse_of(range))
    }

    fn rmse_of(&self, range: &Range<usize>) -> f64 {
        rmse(&self.forces.measured_n[range.clone()], &self.forces.fitted_n[range.clone()])
    }

    /// The estimate of a name.
    #[must_use]
    pub fn estimate(&self, name: &str) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.name == name)
    }
}

/// Why nothing was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A key isn't one, or a value isn't allowed.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A key that can't be searched for.
    #[error("--fit {key}: {reason}")]
    Key {
        /// The key.
        key: String,
        /// What is wrong with it, and what to do.
        reason: String,
    },
    /// The scene as it is can't be built.
    #[error("scene {scene} can't be discretised: {source}")]
    Build {
        /// Its name.
        scene: String,
        /// Why.
        source: BuildError,
    },
    /// The scene as it is can't be run over the recorded motion.
    #[error("the scene diverges over the recorded motion: {0}. Start from other values with --set")]
    Diverged(String),
    /// Too little to fit.
    #[error("{readings} readings of the load cell fall on the motion, and {unknowns} unknowns need more: {remedy}")]
    TooFew {
        /// Readings with a measured force.
        readings: usize,
        /// Keys, offset and drift.
        unknowns: usize,
        /// What to do.
        remedy: &'static str,
    },
    /// The instrument never touches the sample.
    #[error("the part of the recording that is fitted has no contact: the force says nothing about the scene")]
    NoContact,
    /// The user ended it.
    #[error("interrupted: nothing is written")]
    Interrupted,
}

/// Searches for the values.
///
/// # Errors
/// [`CalibrateError`] if a key can't be searched for, the scene can't be run as it is, or there is too little to fit.
pub fn calibrate(
    task: &Task,
    watch: &mut dyn Watch,
    tell: &mut dyn FnMut(&str),
) -> Result<Calibration, CalibrateError> {
    let mut unknowns = task.wanted.iter().map(|w| unknown(task.scene, w)).collect::<Result<Vec<_>, _>>()?;
    let terms = LoadCellTerm::of(task.load_cell);
    unknowns.extend(terms.iter().map(|_| least_squares::Unknown {
        start: 0.0,
        bounds: [f64::NEG_INFINITY, f64::INFINITY],
        scale: 1e-6,
        largest_step: f64::INFINITY,
    }));
    let mut problem = Recorded::new(task, terms, watch, tell)?;
    let mut solution = least_squares::solve(&mut problem, &unknowns)?.ok_or_else(|| problem.beyond_start())?;
    let left_out = problem.leave_out(solution.residuals.as_slice());
    if left_out > 0 {
        let from: Vec<_> =
            unknowns.iter().zip(&solution.x).map(|(u, x)| least_squares::Unknown { start: *x, ..*u }).collect();
        let first = solution.iterations;
        solution = least_squares::solve(&mut problem, &from)?.ok_or_else(|| problem.beyond_start())?;
        solution.iterations += first;
    }
    let changes = problem.changes(&solution.x);
    let scene = task.scene.with(&changes)?;
    let forces = problem.forces(&solution.x)?;
    Ok(Calibration { left_out, ..judged(task, scene, &solution, &unknowns, forces, &problem) })
}

/// Bounds and start of a key.
fn unknown(scene: &Scene, wanted: &Wanted) -> Result<least_squares::Unknown, CalibrateError> {
    let refuse = |reason: String| CalibrateError::Key { key: wanted.key.clone(), reason };
    let key = keys::require(&wanted.key, "to be found", "--fit")?;
    let crate::scene::Kind::Real(range) = key.kind else {
        return Err(refuse(format!("only a single number can be searched for; this is: {}", key.allowed())));
    };
    let start = scene.get(&wanted.key).and_then(|v| v.as_real());
    let start = start.ok_or_else(|| refuse(format!("scene {} has no such key", scene.name)))?;
    let off = OFF_THE_END * start.abs().max(f64::MIN_POSITIVE);
    let own = [
        if range.low_allowed { range.low } else { range.low + off.min(0.5 * (start - range.low)) },
        if range.high_allowed { range.high } else { range.high - off.min(0.5 * (range.high - start)) },
    ];
    let bounds = wanted.bounds.unwrap_or(own);
    for bound in bounds {
        if !range.contains(bound) {
            return Err(refuse(format!("the bound {bound} is out of range; allowed: {}", key.allowed())));
        }
    }
    if bounds[0] >= bounds[1] {
        return Err(refuse(format!("the bounds {} to {} hold nothing between them", bounds[0], bounds[1])));
    }
    let scale = if start == 0.0 { SIZE_AT_ZERO * (bounds[1] - bounds[0]) } else { 0.01 * start.abs() };
    Ok(least_squares::Unknown { start: start.clamp(bounds[0], bounds[1]), bounds, scale, largest_step: LARGEST_STEP })
}

fn judged(
    task: &Task,
    scene: Scene,
    solution: &least_squares::Solution,
    unknowns: &[least_squares::Unknown],
    forces: Forces,
    problem: &Recorded,
) -> Calibration {
    let parts = problem.parts().clone();
    let about = Uncertainty::new(&solution.jacobian);
    let noise = about.noise(&solution.jacobian, solution.residuals.as_slice());
    let of = |column: &[f64]| -> Vec<f64> { problem.fitted().iter().map(|&i| column[i]).collect() };
    let (force, depth) = (of(&forces.model_n), of(&forces.depth_m));
    let systematic = about.systematic(&solution.jacobian, &force, &depth, task.force_error);
    let names = problem.names();
    let error = |covariance: &nalgebra::DMatrix<f64>, k: usize| {
        Some(covariance[(k, k)].max(0.0).sqrt()).filter(|e| about.is_determined(k) && e.is_finite())
    };
    let estimates = (0..names.len()).map(|k| Estimate {
        name: names[k].clone(),
        value: solution.x[k],
        start: unknowns[k].start,
        bounds: unknowns[k].bounds,
        noise_error: error(&noise, k),
        systematic_error: error(&systematic, k),
        has_effect: about.has_effect(k),
    });
    let both = &noise + &systematic;
    let determined = |a, b| about.is_determined(a) && about.is_determined(b);
    let correlated = |a, b| correlation(&both, a, b).filter(|_| determined(a, b));
    let group = |g: Vec<usize>| g.into_iter().map(|k| names[k].clone()).collect();
    Calibration {
        scene,
        estimates: estimates.collect(),
        keys: task.wanted.len(),
        tied: problem.tied(),
        correlation: (0..names.len()).map(|a| (0..names.len()).map(|b| correlated(a, b)).collect()).collect(),
        indistinguishable: about.indistinguishable().into_iter().map(group).collect(),
        forces,
        parts,
        left_out: 0,
        iterations: solution.iterations,
        runs: problem.runs(),
        converged: solution.converged,
    }
}

/// The fitted keys that a scene has, with their values: to carry them over to another scene.
#[must_use]
pub fn carried(calibration: &Calibration, scene: &Scene) -> Vec<Override> {
    let keys = calibration.estimates[..calibration.keys].iter();
    let tied =
        calibration.tied.iter().filter_map(|(key, other)| Some((key.as_str(), calibration.estimate(other)?.value)));
    let all = keys.map(|e| (e.name.as_str(), e.value)).chain(tied).filter(|(key, _)| scene.get(key).is_some());
    all.map(|(key, value)| Override::typed(key, value, "calibrate")).collect()
}
