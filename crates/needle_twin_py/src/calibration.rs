//! Values of scene keys from a recording.

use needle_core::scene::Scene;
use needle_estimate::calibrate::{self as fitting, HoldOut, LoadCell, Task, Wanted};
use needle_estimate::compare::uncertainty::FORCE_ERROR;
use needle_estimate::compare::{Cancel, scale};
use needle_estimate::layers::of_recording;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{BuildError, CalibrationError, RecordingError, in_python};
use crate::run::scene_of;
use crate::watch::detached;
use crate::{array, recording, scene};

/// What a calibration found, and how sure it is.
#[pyclass(module = "needle_twin", frozen)]
pub(crate) struct Calibration {
    found: fitting::Calibration,
    source: String,
    prediction: Option<fitting::Prediction>,
}

#[pymethods]
impl Calibration {
    /// What `calibration.json` says, as a dict: `fit` has value and standard error of each key; `verdict` says whether to believe them.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array::json(py, &needle_report::calibration_json(&self.found, &self.source, self.prediction.as_ref()))
    }

    /// Value of each key that was asked for.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for e in &self.found.estimates[..self.found.keys] {
            dict.set_item(&e.name, e.value)?;
        }
        Ok(dict)
    }

    /// Interval that holds each key with 95 %, as (low, high); `None` where the data give none.
    #[getter]
    fn interval_95<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for e in &self.found.estimates[..self.found.keys] {
            dict.set_item(&e.name, e.interval_95().map(|[low, high]| (low, high)))?;
        }
        Ok(dict)
    }

    /// The scene with the values found.
    #[getter]
    fn scene(&self) -> scene::Scene {
        scene::Scene { scene: self.found.scene.clone() }
    }

    /// Whether no value of the keys explains the recording: then the values mean nothing.
    #[getter]
    fn rejected(&self) -> bool {
        self.found.rejected()
    }

    /// Whether the model explains the measurement, in one line.
    #[getter]
    fn verdict(&self) -> String {
        self.found.verdict.line()
    }

    /// Root mean square of the residual, N.
    #[getter]
    fn rmse_n(&self) -> f64 {
        self.found.rmse_n()
    }

    fn __repr__(&self) -> String {
        let of = |e: &fitting::Estimate| {
            let error = e.standard_error().map_or("no interval".to_owned(), |error| format!("± {error:.4}"));
            format!("{} = {:.6} {error}", e.name, e.value)
        };
        let keys: Vec<String> = self.found.estimates[..self.found.keys].iter().map(of).collect();
        format!("<Calibration {}; {}>", keys.join(", "), self.verdict())
    }
}

/// Finds the values of scene keys with which the twin's force comes nearest to the recorded one.
///
/// `fit`: keys as on the command line, "material.shear_modulus_pa" or with bounds "instrument.deformation_coefficient=0.2..0.8". `load_cell`: what of it is
/// estimated alongside: "auto" (zero and, where the recording can tell it, drift), "drift" (both), "offset" (zero) or "exact" (nothing). `hold_out`: what is not fitted: "none", "retraction" or "half".
/// `predict`: another recording, to be predicted with the values found in `predict_scene` (or the scene that it names, or else the fitted one);
/// `to_dict()["prediction"]` says how well. `recording`, `scene`, `changes`, `threads`, `force` as for `replay`.
#[pyfunction]
#[pyo3(signature = (recording, fit, scene = None, *, changes = None, load_cell = "auto", hold_out = "none",
    force_error = FORCE_ERROR, threads = 0, force = false, predict = None, predict_scene = None))]
#[allow(clippy::too_many_arguments)] // keywords of a Python function
pub(crate) fn calibrate(
    py: Python<'_>,
    recording: &Bound<'_, PyAny>,
    fit: Vec<String>,
    scene: Option<&Bound<'_, PyAny>>,
    changes: Option<&Bound<'_, PyDict>>,
    load_cell: &str,
    hold_out: &str,
    force_error: f64,
    threads: usize,
    force: bool,
    predict: Option<&Bound<'_, PyAny>>,
    predict_scene: Option<&Bound<'_, PyAny>>,
) -> PyResult<Calibration> {
    let wanted = wanted(&fit)?;
    let (load_cell, part) = (cell(load_cell)?, part(hold_out)?);
    if !(0.0..1.0).contains(&force_error) {
        return Err(PyValueError::new_err(format!(
            "force_error = {force_error}: a share from 0 to 1, as 0.01 for 1 %"
        )));
    }
    recording::with(recording, |given| {
        let scene = scene_of(given.recording.scene.as_deref(), scene, changes)?;
        let recorded = given.recording.aligned(&scene);
        let (readings, measured) = (recorded.readings(given.pose_wanted), recorded.measured());
        let task = Task {
            scene: &scene,
            readings: &readings,
            measured: &measured,
            wanted: &wanted,
            load_cell,
            force_error,
            part,
            table: None,
        };
        let work = |cancel: &mut Cancel| -> PyResult<_> {
            let built = needle_core::twin::Twin::new(&scene);
            let twin = built.map_err(|e| BuildError::new_err(format!("scene {}: {e}", scene.name)))?;
            if let Some(what) = scale::mistaken(&twin, &readings, &measured, Some(&*recorded)).filter(|_| !force) {
                return Err(RecordingError::new_err(in_python(&what)));
            }
            fitting::calibrate(&task, cancel, &mut |_| {}).map_err(failed)
        };
        let found = detached(py, threads, work)??;
        let other = predict.map(|other| predicted(py, &found, &scene, other, predict_scene, threads));
        Ok(Calibration { prediction: other.transpose()?, found, source: recorded.source.clone() })
    })
}

fn failed(error: fitting::CalibrateError) -> PyErr {
    CalibrationError::new_err(in_python(&error.to_string()))
}

/// Another recording with the values found.
fn predicted(
    py: Python<'_>,
    found: &fitting::Calibration,
    fitted: &Scene,
    other: &Bound<'_, PyAny>,
    given: Option<&Bound<'_, PyAny>>,
    threads: usize,
) -> PyResult<fitting::Prediction> {
    recording::with(other, |other| {
        let named = other.recording.scene.as_deref();
        // the fitted recording's alignment is its own
        let scene = match (given, named) {
            (None, None) => Scene { align: None, ..fitted.clone() },
            _ => scene_of(named, given, None)?,
        };
        let recorded = other.recording.aligned(&scene);
        let (readings, measured) = (recorded.readings(other.pose_wanted), recorded.measured());
        let work =
            |cancel: &mut Cancel| fitting::predict(found, &scene, &readings, &measured, &recorded.source, cancel);
        detached(py, threads, work)?.map_err(failed)
    })
}

/// Friction, cutting and puncture forces of so many layers and where they begin, from a recording of an insertion, the way out and a second
/// insertion that goes as deep: no run of the twin. Depth 0 is the surface; the needle is that of `scene`.
///
/// Returns a dict, as `needle_twin calibrate --layers` prints it.
#[pyfunction]
#[pyo3(signature = (recording, number, scene = None, *, changes = None))]
pub(crate) fn layers<'py>(
    py: Python<'py>,
    recording: &Bound<'py, PyAny>,
    number: usize,
    scene: Option<&Bound<'py, PyAny>>,
    changes: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    if !(1..=16).contains(&number) {
        return Err(PyValueError::new_err(format!("number = {number}: from 1 to 16 layers")));
    }
    recording::with(recording, |given| {
        let scene = scene_of(given.recording.scene.as_deref(), scene, changes)?;
        let recorded = given.recording.aligned(&scene);
        let readings = recorded.readings(given.pose_wanted);
        let found = of_recording(&scene, &readings, &recorded.measured(), number);
        let found = found.map_err(|e| CalibrationError::new_err(in_python(&e.to_string())))?;
        array::json(py, &needle_report::layers_json(&found, &recorded.source))
    })
}

fn wanted(fit: &[String]) -> PyResult<Vec<Wanted>> {
    let read = |text: &String| Wanted::parse(text).map_err(|e| PyValueError::new_err(format!("fit = {text}: {e}")));
    let wanted = fit.iter().map(read).collect::<PyResult<Vec<_>>>()?;
    let twice = (1..wanted.len()).find(|&i| wanted[..i].iter().any(|w| w.key == wanted[i].key));
    match (wanted.is_empty(), twice) {
        (true, _) => Err(PyValueError::new_err("fit is empty: name at least one key")),
        (_, Some(i)) => Err(PyValueError::new_err(format!("fit: {} is named twice; name it once", wanted[i].key))),
        _ => Ok(wanted),
    }
}

fn cell(word: &str) -> PyResult<LoadCell> {
    match word {
        "auto" => Ok(LoadCell::Auto),
        "drift" => Ok(LoadCell::Drift),
        "offset" => Ok(LoadCell::Offset),
        "exact" => Ok(LoadCell::Exact),
        _ => {
            Err(PyValueError::new_err(format!("load_cell = \"{word}\": \"auto\", \"drift\", \"offset\" or \"exact\"")))
        }
    }
}

fn part(word: &str) -> PyResult<HoldOut> {
    match word {
        "none" => Ok(HoldOut::Nothing),
        "retraction" => Ok(HoldOut::Retraction),
        "half" => Ok(HoldOut::Half),
        _ => Err(PyValueError::new_err(format!("hold_out = \"{word}\": \"none\", \"retraction\" or \"half\""))),
    }
}
