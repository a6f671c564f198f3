//! Applies the values identified on one recording to another.

use super::{CalibrateError, Calibration, carried, paths, rmse};
use crate::compare::{Run, Watch};
use needle_core::scene::Scene;
use needle_core::twin::Phase;
use needle_recording::{ForceSeries, Reading};

/// Another recording, predicted with the identified values and without them.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Source of the measurement.
    pub source: String,
    /// Name of its scene.
    pub scene: String,
    /// Identified keys that its scene has.
    pub carried: Vec<String>,
    /// Identified keys that it does not have.
    pub left: Vec<String>,
    /// The load cell's zero in this recording: mean of its readings before the first contact, N. 0 without such
    /// readings.
    pub offset_n: f64,
    /// Largest measured force minus the zero, N.
    pub peak_n: f64,
    /// Root mean square of predicted - measured with the identified values, N.
    pub rmse_n: f64,
    /// The same with the scene's own values, N.
    pub rmse_before_n: f64,
}

/// Runs another scene over its recording, with the identified values and without. Only the load cell's zero is fitted
/// to that recording.
///
/// # Errors
/// [`CalibrateError`] if the scene can't be run, or the recording has no force.
pub fn predict(
    calibration: &Calibration,
    scene: &Scene,
    readings: &[Reading],
    measured: &ForceSeries,
    source: &str,
    watch: &mut dyn Watch,
) -> Result<Prediction, CalibrateError> {
    let changes = carried(calibration, scene);
    let before = whole(scene, readings, measured, watch)?;
    let after = whole(&scene.with(&changes)?, readings, measured, watch)?;
    let first_contact = before.answers.iter().position(|a| a.phase != Phase::Approach).unwrap_or(0);
    let idle: Vec<f64> = before.answers[..first_contact].iter().filter_map(|a| a.measured_n).collect();
    let offset_n = if idle.is_empty() { 0.0 } else { idle.iter().sum::<f64>() / idle.len() as f64 };
    let error = |run: &Run| {
        let both = run.answers.iter().filter_map(|a| a.measured_n.map(|m| (m - offset_n, a.predicted_n)));
        let (measured, predicted): (Vec<f64>, Vec<f64>) = both.unzip();
        rmse(&measured, &predicted)
    };
    let forces = before.answers.iter().filter_map(|a| a.measured_n);
    let peak_n = forces.map(|m| (m - offset_n).abs()).fold(0.0, f64::max);
    let keys = calibration.estimates[..calibration.keys].iter().map(|e| e.name.clone());
    let (carried, left) = keys.partition(|key| changes.iter().any(|change| change.path == *key));
    Ok(Prediction {
        source: source.to_owned(),
        scene: scene.name.clone(),
        carried,
        left,
        offset_n,
        peak_n,
        rmse_n: error(&after),
        rmse_before_n: error(&before),
    })
}

fn whole(
    scene: &Scene,
    readings: &[Reading],
    measured: &ForceSeries,
    watch: &mut dyn Watch,
) -> Result<Run, CalibrateError> {
    let run = paths::run(scene, None, readings, measured, watch)?;
    if let Some(reason) = run.diverged {
        return Err(CalibrateError::Diverged(reason));
    }
    let readings = run.answers.iter().filter(|a| a.residual_n().is_some()).count();
    if readings == 0 {
        let remedy = "the recording that is to be predicted has no load cell whose stamps overlap the motion's";
        return Err(CalibrateError::TooFew { readings, unknowns: 0, remedy });
    }
    Ok(run)
}
