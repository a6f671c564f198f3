//! A scene that is as coarse as a tolerance allows and as fast as a stream of poses asks.

use needle_studies::accuracy::StudyError;
use needle_studies::progress::Progress;
use needle_studies::reference_solution::ReferenceSolution;
use needle_studies::tune::{self as tuning, Goal};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{BuildError, NeedleTwinError, in_python};
use crate::scene;
use crate::watch::detached;
use needle_estimate::compare::Cancel;

/// Finds the coarsest cloud and the fewest steps with which a scene meets a tolerance and a rate of poses on this machine.
///
/// `tolerance`: largest relative error of the force, from a fifth of the scene's path on; `pose_hz`: poses per second that have to be answered.
/// Takes half a minute or more; Ctrl-C ends it, at the latest when the present cloud is built. Returns the scene, and a dict of what was measured: `max_force_error`, `cost_per_pose_s` (of processor time), `nodes`,
/// `integration_points`, and `against` (what the force was compared with). Raises BuildError where no cloud meets both, naming the nearest.
#[pyfunction]
#[pyo3(signature = (scene, *, tolerance = 0.02, pose_hz = 1000.0, changes = None, threads = 0))]
pub(crate) fn tune<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    tolerance: f64,
    pose_hz: f64,
    changes: Option<&Bound<'py, PyDict>>,
    threads: usize,
) -> PyResult<(scene::Scene, Bound<'py, PyDict>)> {
    if !(tolerance > 0.0 && tolerance < 1.0) {
        return Err(PyValueError::new_err(format!("tolerance = {tolerance}: between 0 and 1, as 0.02 for 2 %")));
    }
    if !(0.1..=1e6).contains(&pose_hz) {
        return Err(PyValueError::new_err(format!("pose_hz = {pose_hz}: from 0.1 to 1e6 Hz")));
    }
    let scene = scene::Scene { scene: scene::of(scene)? }.changed(changes)?.scene;
    let motion = scene.motion.ok_or_else(|| failed(StudyError::NoMotion(scene.name.clone())))?;
    let work = |cancel: &mut Cancel| -> Result<_, StudyError> {
        let progress = Progress::of(cancel);
        let Some(against) = ReferenceSolution::of_force(&scene, motion.depth.get(), &progress)? else {
            return Ok(None);
        };
        let tuned = tuning::tune(&scene, &against, Goal { tolerance, pose_hz }, &progress)?;
        Ok(tuned.map(|tuned| (tuned, against.source)))
    };
    let found = detached(py, threads, work)?.map_err(failed)?;
    let (tuned, against) = found.ok_or_else(|| NeedleTwinError::new_err("interrupted"))?;
    let measured = PyDict::new(py);
    measured.set_item("max_force_error", tuned.row.max_force_error())?;
    measured.set_item("cost_per_pose_s", tuned.row.cost_per_pose_s())?;
    measured.set_item("nodes", tuned.row.nodes)?;
    measured.set_item("integration_points", tuned.row.integration_points)?;
    measured.set_item("against", against)?;
    Ok((scene::Scene { scene: tuned.scene }, measured))
}

fn failed(error: StudyError) -> PyErr {
    BuildError::new_err(in_python(&error.to_string()))
}
