//! Whole runs: a scene's own motion, or a recording.

use std::path::PathBuf;

use needle_core::scene::Scene;
use needle_estimate::compare::ensemble::{self, Band, Crew, Driven, Size};
use needle_estimate::compare::{self, Cancel, Finished, Keep, Session, scale};
use needle_recording::{At, ForceSeries, Reading};
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyArray3, PyArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{self, BuildError, NeedleTwinError, RecordingError, SceneError, in_python};
use crate::watch::detached;
use crate::{array, recording, scene};

/// Scene of a recording that doesn't say which it was made for, as on the command line.
pub(crate) const DEFAULT_SCENE: &str = "needle_insertion";

/// Everything that one run of the twin produced.
#[pyclass(module = "needle_twin", frozen)]
pub(crate) struct Run {
    run: compare::Run,
}

#[pymethods]
impl Run {
    /// Times of the poses, s since the first, shape (n,).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.run.answers.iter().map(|a| a.time_s).collect())
    }

    /// Depths of the tip, m, shape (n,).
    #[getter]
    fn depth_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.run.answers.iter().map(|a| a.depth_m).collect())
    }

    /// Predicted force against the instrument's axis, N (positive resists insertion), shape (n,).
    #[getter]
    fn predicted_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.run.answers.iter().map(|a| a.predicted_n).collect())
    }

    /// Measured force with the same sign, N, shape (n,); NaN where there is none.
    #[getter]
    fn measured_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.run.answers.iter().map(|a| a.measured_n.unwrap_or(f64::NAN)).collect())
    }

    /// Predicted force of the tissue on the instrument in frame `sample`, N, shape (n, 3).
    #[getter]
    fn predicted_vector_n<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array::rows(py, self.run.answers.iter().map(|a| a.predicted_vector_n).collect())
    }

    /// Measured force in the same frame, N, shape (n, 3); NaN where there is none.
    #[getter]
    fn measured_vector_n<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array::rows(py, self.run.answers.iter().map(|a| a.measured_vector_n.unwrap_or([f64::NAN; 3])).collect())
    }

    /// Force below which 2.5 % of the members are, N, shape (n,); `None` without members, NaN where none has an answer.
    #[getter]
    fn predicted_low_n<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.band(py, |band| band.low_n)
    }

    /// Force below which 97.5 % of the members are, N, shape (n,); `None` without members, NaN where none has an answer.
    #[getter]
    fn predicted_high_n<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.band(py, |band| band.high_n)
    }

    /// Phase of each pose.
    #[getter]
    fn phase(&self) -> Vec<&'static str> {
        self.run.answers.iter().map(|a| a.phase.as_str()).collect()
    }

    /// Names of the scene's targets.
    #[getter]
    fn target_names(&self) -> Vec<String> {
        self.run.target_names.clone()
    }

    /// Their positions over time, m, shape (n, k, 3).
    #[getter]
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (n, k) = (self.run.targets.len(), self.run.target_names.len());
        let all: Vec<f64> = self.run.targets.iter().flat_map(|row| row.positions.iter().flatten().copied()).collect();
        all.into_pyarray(py).reshape([n, k, 3])
    }

    /// What `metrics.json` says: force, timing, stability, verdict, alignment, checksum, as a dict.
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array::json(py, &needle_report::metrics_json(&self.run))
    }

    /// Whether the model explains the measurement, in one line.
    #[getter]
    fn verdict(&self) -> String {
        self.run.verdict().line()
    }

    /// Hash over every predicted force and the final displacements.
    #[getter]
    fn checksum(&self) -> &str {
        &self.run.checksum
    }

    /// What was lost on the way.
    #[getter]
    fn losses(&self) -> Vec<String> {
        self.run.losses.clone()
    }

    /// Why the model diverged, if it did.
    #[getter]
    fn diverged(&self) -> Option<&str> {
        self.run.diverged.as_deref()
    }

    /// Writes metrics.json, force.csv, targets.csv, final.vtu, force.svg and report.html, as `--out` does, and returns their paths.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<Vec<PathBuf>> {
        let run = &self.run;
        let write = || needle_report::prepare(&folder).and_then(|()| needle_report::write_all(&folder, run));
        py.detach(write).map_err(|e| NeedleTwinError::new_err(e.to_string()))
    }

    fn __repr__(&self) -> String {
        let peak = self.run.answers.iter().map(|a| a.predicted_n).fold(0.0, f64::max);
        format!("<Run of {}: {} poses, peak {peak:.6} N, {}>", self.run.scene, self.run.answers.len(), self.verdict())
    }
}

impl Run {
    fn band<'py>(&self, py: Python<'py>, of: fn(&Band) -> f64) -> Option<Bound<'py, PyArray1<f64>>> {
        let bands = &self.run.ensemble.as_ref()?.bands;
        Some(array::numbers(py, bands.iter().map(|band| band.as_ref().map_or(f64::NAN, of)).collect()))
    }
}

/// Runs a scene's own motion: a stream of poses, each answered as the live node would.
///
/// `scene`: a Scene, a preset's name or a path. `depth_m`, `speed_m_per_s`, `pose_hz` take the place of the scene's own; `changes`: further keys. `threads` = 0: one per core. With `members` = N twins
/// with values drawn from the scene's `[uncertainty]` run as well (`seed`: of the draws), for `Run.predicted_low_n` and `predicted_high_n`.
#[pyfunction]
#[pyo3(signature = (scene, *, depth_m = None, speed_m_per_s = None, pose_hz = None, changes = None, threads = 0, members = 0, seed = 0))]
#[allow(clippy::too_many_arguments)] // of a Python function, by name
pub(crate) fn solve(
    py: Python<'_>,
    scene: &Bound<'_, PyAny>,
    depth_m: Option<f64>,
    speed_m_per_s: Option<f64>,
    pose_hz: Option<f64>,
    changes: Option<&Bound<'_, PyDict>>,
    threads: usize,
    members: usize,
    seed: u64,
) -> PyResult<Run> {
    let all = changes.map_or_else(|| Ok(PyDict::new(py)), |changes| changes.copy())?;
    for (key, value) in [("depth_m", depth_m), ("speed_m_per_s", speed_m_per_s), ("pose_hz", pose_hz)] {
        if let Some(value) = value {
            all.set_item(format!("motion.{key}"), value)?;
        }
    }
    let scene = scene::Scene { scene: scene::of(scene)? }.changed(Some(&all))?.scene;
    let none = || {
        SceneError::new_err(format!(
            "scene {} has no motion of its own: replay a recording, or add [motion]",
            scene.name
        ))
    };
    let motion = scene.motion.ok_or_else(none)?;
    let readings = motion.poses().map(|(time_s, depth)| Reading { time_s, at: At::Depth(depth) }).collect();
    let asked = Asked { threads, size: Size { members, seed }, command: "solve" };
    drive(py, &scene, asked, readings, None, |_, _| Ok(()))
}

/// Runs a recording's motion through the twin, offline and deterministic, and compares with its load cell.
///
/// `recording`: a Recording, or the path of a bag or table. `scene`: a Scene, a preset's name or a path; the one that the recording names if absent. `force`: go on where
/// units, signs or scene of the recording look wrong. `members` and `seed` as for `solve`; with a load cell `Run.metrics["ensemble"]` says what it tells of the
/// uncertain keys.
#[pyfunction]
#[pyo3(signature = (recording, scene = None, *, changes = None, threads = 0, force = false, members = 0, seed = 0))]
#[allow(clippy::too_many_arguments)] // of a Python function, by name
pub(crate) fn replay(
    py: Python<'_>,
    recording: &Bound<'_, PyAny>,
    scene: Option<&Bound<'_, PyAny>>,
    changes: Option<&Bound<'_, PyDict>>,
    threads: usize,
    force: bool,
    members: usize,
    seed: u64,
) -> PyResult<Run> {
    recording::with(recording, |given| {
        let scene = scene_of(given.recording.scene.as_deref(), scene, changes)?;
        let recorded = given.recording.aligned(&scene);
        let measured = recorded.measured();
        let readings = recorded.readings(given.pose_wanted);
        let look = |twin: &needle_core::twin::Twin, readings: &[Reading]| {
            let found = scale::mistaken(twin, readings, &measured, Some(&*recorded))
                .or_else(|| scale::untared(twin, readings, &measured));
            found.filter(|_| !force).map_or(Ok(()), |what| Err(RecordingError::new_err(in_python(&what))))
        };
        let asked = Asked { threads, size: Size { members, seed }, command: "replay" };
        drive(py, &scene, asked, readings, Some((&recorded, &measured)), look)
    })
}

/// The scene of a recording: what the user gave, or what it names, with changes.
pub(crate) fn scene_of(
    named: Option<&str>,
    given: Option<&Bound<'_, PyAny>>,
    changes: Option<&Bound<'_, PyDict>>,
) -> PyResult<Scene> {
    let scene = match given {
        Some(given) => scene::of(given)?,
        None => needle_core::scene::file::load(named.unwrap_or(DEFAULT_SCENE)).map_err(error::scene)?,
    };
    Ok(scene::Scene { scene }.changed(changes)?.scene)
}

/// How a run is made.
struct Asked {
    threads: usize,
    /// No members: no ensemble.
    size: Size,
    command: &'static str,
}

/// What `needle_twin solve` and `replay` do: build, look at the readings, drive, collect, and run the members.
fn drive(
    py: Python<'_>,
    scene: &Scene,
    asked: Asked,
    readings: Vec<Reading>,
    recorded: Option<(&needle_recording::Recording, &ForceSeries)>,
    look: impl FnOnce(&needle_core::twin::Twin, &[Reading]) -> PyResult<()> + Send,
) -> PyResult<Run> {
    if readings.is_empty() {
        return Err(PyValueError::new_err("there is no reading of the instrument's place: nothing to run"));
    }
    let Asked { threads, size, command } = asked;
    let members = if size.members > 0 { ensemble::members(scene, size).map_err(error::ensemble)? } else { Vec::new() };
    let work = |cancel: &mut Cancel| -> PyResult<compare::Run> {
        let session = Session::new(scene, command, Keep::fields_of(&readings));
        let session = session.map_err(|e| BuildError::new_err(format!("scene {}: {e}", scene.name)))?;
        look(session.twin(), &readings)?;
        let session = match recorded {
            Some((recording, measured)) => session.of_recording(recording, measured),
            None => session,
        };
        let Finished { mut run, answered, twin } = session.run(readings.iter().copied(), cancel);
        if !members.is_empty() {
            let crew = Crew { threads: rayon::current_num_threads(), cancel: cancel.clone(), done: &|| {} };
            let sightings = recorded.map_or(&[][..], |(recording, _)| &recording.markers);
            let driven = Driven { readings: &readings, at: &answered, sightings, twin: Some(&twin) };
            ensemble::add(&mut run, scene, &members, driven, size, &crew).map_err(error::ensemble)?;
        }
        Ok(run)
    };
    detached(py, threads, work)?.map(|run| Run { run })
}
