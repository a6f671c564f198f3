//! Calibration: finds the values of scene keys that minimise the difference of the twin's force and a recorded one.
//!
//! ```text
//! smallest sum_i (F(d_1..i; keys) + offset + drift t_i - F_measured,i)^2
//! ```
//!
//! If the load cell measured the force as a vector and the model is three-dimensional, the components across the axis
//! are fitted as well. Each has its own noise, zero and drift (`compare::components`). Every F is a complete run of
//! the twin over the recorded motion, the same as in `replay`. Offset and drift of the load cell are estimated too.
//! So are the depth of first contact and the offset between the clocks of force and position, if the recording shows
//! that they are wrong (`compare::alignment`). Otherwise they stay as recorded.
//!
//! A model that does not explain the readings is rejected. What the data can't determine has no interval
//! (`judgement`).

mod alternatives;
mod calibration;
mod common;
mod components;
mod curve_table;
mod error;
mod forces;
mod hold;
mod joint;
mod judgement;
mod markers;
mod paths;
mod prediction;
mod problem;
mod runs;
mod search;
mod spikes;
mod split;
mod start;
mod task;
mod tie;
mod unknown;
mod wanted;

use crate::compare::Watch;
use needle_core::scene::{Align, Metres, Override, Scene, Seconds};

pub use alternatives::{Assumption, alternatives};
pub(crate) use calibration::INTERVAL_95;
pub use calibration::{Alternative, Calibration, Estimate};
pub use curve_table::CurveTable;
pub use error::CalibrateError;
pub use forces::Forces;
pub(crate) use forces::rmse;
pub use joint::JointKey;
pub(crate) use joint::calibrate_together;
pub use joint::{Joint, Own};
pub use markers::MarkerEstimate;
pub use markers::{MarkerFit, MarkerResidual, MarkerTask, calibrate_markers};
pub use prediction::{Prediction, predict};
use problem::Recorded;
use search::{Searched, aligned, search};
pub use split::{HoldOut, Parts};
pub use task::{LoadCell, Task};
pub(crate) use unknown::SCALE_KEY;
use unknown::Sought;
pub use wanted::Wanted;

/// Runs the search.
///
/// # Errors
/// [`CalibrateError`] if a key can't be searched for, the scene can't be run with its own values, or there are too
/// few readings.
pub fn calibrate(
    task: &Task,
    watch: &mut dyn Watch,
    tell: &mut dyn FnMut(&str),
) -> Result<Calibration, CalibrateError> {
    let begun = start::begun(task);
    let task = &Task { scene: begun.as_ref().unwrap_or(task.scene), ..task.clone() };
    let held = hold::begun(task);
    let task = &Task { scene: held.as_ref().map_or(task.scene, |held| &held.scene), ..task.clone() };
    let mut found = found(task, watch, tell)?;
    held.iter().for_each(|held| held.withhold(&mut found.estimates));
    Ok(found)
}

/// Searches, and again without the load cell's drift where it can't be told from a key ([`LoadCell::Auto`]). On a way in alone the
/// model's error in the curve's bend passes for a drift: one that no load cell has is left out if the model explains the readings so.
fn found(task: &Task, watch: &mut dyn Watch, tell: &mut dyn FnMut(&str)) -> Result<Calibration, CalibrateError> {
    let found = searched(task, watch, tell)?;
    let drifts = |group: &Vec<String>| group.iter().any(|name| name == unknown::DRIFT_KEY);
    let group = found.indistinguishable.iter().find(|g| drifts(g)).cloned();
    let bent = || found.rejected() && found.estimate(unknown::DRIFT_KEY).is_some() && found.only_goes_in();
    if task.load_cell != LoadCell::Auto || (group.is_none() && !bent()) {
        return Ok(found);
    }
    tell("without the load cell's drift");
    let again = searched(&Task { load_cell: LoadCell::Offset, ..task.clone() }, watch, tell)?;
    if group.is_none() && again.rejected() {
        return Ok(Calibration { runs: found.runs + again.runs, ..found });
    }
    let all = || found.estimates[..found.keys].iter().map(|e| e.name.clone()).collect();
    let others: Vec<String> = group.unwrap_or_else(all).into_iter().filter(|name| name != unknown::DRIFT_KEY).collect();
    Ok(Calibration { runs: found.runs + again.runs, drift_left_out_for: others, ..again })
}

/// Runs the search with exactly the load cell parameters that the task requests.
fn searched(task: &Task, watch: &mut dyn Watch, tell: &mut dyn FnMut(&str)) -> Result<Calibration, CalibrateError> {
    let sought = Sought::all(task.wanted, task.load_cell);
    let mut problem = Recorded::new(task, sought, watch, tell);
    let Searched { mut unknowns, begun, solution, realigned, left_out } = search(&mut problem, task)?;
    unknowns.iter_mut().zip(begun).for_each(|(u, start)| u.start = start);
    let changes = problem.changes(&solution.x);
    // keep the step count of these runs, or a replay would give another force
    let mut scene = problem.common.posed(&task.scene.with(&changes)?);
    scene.align = align(&problem, task.scene, &solution.x);
    let forces = problem.forces(&solution.x)?;
    let found = Calibration {
        left_out,
        realigned,
        ..judgement::judged(task, scene, &solution, &unknowns, forces, &mut problem)?
    };
    let seen = aligned(&mut problem, &solution.x)?;
    Ok(found.with_alignment(seen).of_recording(&problem.sought, task.scene))
}

/// Alignment of the recording with the model at the values x: the scene's own correction plus what the search found.
fn align(problem: &Recorded, scene: &Scene, x: &[f64]) -> Option<Align> {
    let of = |wanted: fn(&Sought) -> bool| problem.sought.iter().position(wanted).map_or(0.0, |k| x[k]);
    let found = Align {
        contact_depth: Metres(of(|s| *s == Sought::Contact)),
        time_offset: Seconds(of(|s| *s == Sought::Clock)),
        zero_n: of(|s| matches!(s, Sought::Zero { .. })),
        drift_n_per_s: of(|s| *s == Sought::Drift),
    };
    Some(scene.align.unwrap_or(Align::NONE).then(found)).filter(|align| *align != Align::NONE)
}

/// The identified keys that a scene has, with their values: to transfer them to another scene.
#[must_use]
pub(crate) fn carried(calibration: &Calibration, scene: &Scene) -> Vec<Override> {
    let keys = calibration.estimates[..calibration.keys].iter();
    let tied =
        calibration.tied.iter().filter_map(|(key, other)| Some((key.as_str(), calibration.estimate(other)?.value)));
    let all = keys.map(|e| (e.name.as_str(), e.value)).chain(tied).filter(|(key, _)| scene.get(key).is_some());
    // the alignment belongs to the fitted recording alone
    let all = all.filter(|(key, _)| !key.starts_with("align."));
    all.map(|(key, value)| Override::typed(key, value, "calibrate")).collect()
}
