//! Where a needle has to enter to meet a target that moves with the tissue.

use needle_estimate::compare::Cancel;
use needle_estimate::plan::{self as planning, Direction, PlanError, Wanted};
use needle_report::plan_json;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{BuildError, NeedleTwinError, in_python};
use crate::scene;
use crate::watch::detached;

/// Plans an insertion: entry point, direction and depth that bring the needle's tip to a target which moves with the tissue.
///
/// `target`: its name in the scene. `tilt_rad`, `azimuth_rad`, `roll_rad`: directions to try, every combination; by default the scene's own. The needle
/// stays `clearance_m` away from the regions in `avoid`. `members` twins with values of the scene's `[uncertainty]` say how often the plan misses
/// by more than `radius_m`; the search ends within `tolerance_m`. A whole insertion is run two to eight times per direction; Ctrl-C ends it.
///
/// Returns the scene of the plan, and a dict: `plan` and `straight` (how that and a straight aim end: `entry_m`, `depth_m`, `tip_m`, `target_m`, `miss_m`,
/// `clearance_m`, `peak_n`), `met`, `runs`, the angles, and `risk` of the members. Raises BuildError where there is no plan, saying why.
#[pyfunction]
#[pyo3(signature = (
    scene, target, *, tilt_rad = Vec::new(), azimuth_rad = Vec::new(), roll_rad = Vec::new(), avoid = Vec::new(), clearance_m = 0.0,
    radius_m = 5e-4, tolerance_m = 5e-5, members = 0, changes = None, threads = 0
))]
#[allow(clippy::too_many_arguments, reason = "Python names them")]
pub(crate) fn plan<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    target: String,
    tilt_rad: Vec<f64>,
    azimuth_rad: Vec<f64>,
    roll_rad: Vec<f64>,
    avoid: Vec<String>,
    clearance_m: f64,
    radius_m: f64,
    tolerance_m: f64,
    members: usize,
    changes: Option<&Bound<'py, PyDict>>,
    threads: usize,
) -> PyResult<(scene::Scene, Bound<'py, PyAny>)> {
    for (name, length) in [("clearance_m", clearance_m), ("radius_m", radius_m), ("tolerance_m", tolerance_m)] {
        if !(0.0..=10.0).contains(&length) {
            return Err(PyValueError::new_err(format!("{name} = {length}: a length in m from 0 to 10")));
        }
    }
    let scene = scene::Scene { scene: scene::of(scene)? }.changed(changes)?.scene;
    let wanted = Wanted { target, avoid, clearance_m, radius_m, tolerance_m: tolerance_m.max(1e-9), members };
    planning::check(&scene, &wanted).map_err(failed)?;
    let directions = Direction::all(&scene, [&tilt_rad, &azimuth_rad, &roll_rad]);
    let work = |cancel: &mut Cancel| planning::plan(&scene, &wanted, &directions, cancel, |_, _, _| ());
    let found = detached(py, threads, work)?.map_err(failed)?;
    let told = py.import("json")?.call_method1("loads", (plan_json(&found, &wanted).to_string(),))?;
    Ok((scene::Scene { scene: found.scene }, told))
}

fn failed(error: PlanError) -> PyErr {
    match error {
        PlanError::Interrupted => NeedleTwinError::new_err("interrupted"),
        error => BuildError::new_err(in_python(&error.to_string())),
    }
}
