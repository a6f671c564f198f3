//! The force along a run: against the instrument's axis, and across it where the load cell measured a vector.

use super::CalibrateError;
use crate::compare::components::Component;
use crate::compare::path::ForcePath;
use crate::compare::{Answer, Keep, Run, Session, Watch};
use needle_core::scene::{Region, Scene};
use needle_recording::{ForceSeries, Reading};

/// Share of the poses that must have an answer.
const ANSWERED: f64 = 0.9;

/// Whether enough poses have an answer.
pub(super) fn answered(run: &Run, readings: &[Reading]) -> bool {
    run.answers.len() as f64 >= ANSWERED * readings.len() as f64
}

/// Runs a scene over a recording, on its own cloud or on the cloud for other regions.
pub(super) fn run(
    scene: &Scene,
    regions: Option<&[Region]>,
    readings: &[Reading],
    measured: &ForceSeries,
    watch: &mut dyn Watch,
) -> Result<Run, CalibrateError> {
    let session = match regions {
        None => Session::new(scene, "calibrate", Keep::ANSWERS),
        Some(regions) => Session::on_cloud_of(scene, regions, "calibrate", Keep::ANSWERS),
    };
    let session = session.map_err(|source| CalibrateError::Build { scene: scene.name.clone(), source })?;
    let run = session.compared_with(measured).run(readings.iter().copied(), watch).run;
    if watch.cancel().is_cancelled() { Err(CalibrateError::Interrupted) } else { Ok(run) }
}

/// The force along a run; `None` if the instrument does not enter the sample.
pub(super) fn path_of(run: &Run) -> Option<ForcePath> {
    let column = |of: fn(&Answer) -> f64| run.answers.iter().map(of).collect();
    ForcePath::new(column(|a| a.time_s), column(|a| a.depth_m), column(|a| a.predicted_n))
}

/// The same, and its components across the axis.
pub(super) fn paths_of(run: &Run, across: &[Component]) -> Option<Vec<ForcePath>> {
    std::iter::once(path_of(run)).chain(across.iter().map(|c| c.path(run))).collect()
}
