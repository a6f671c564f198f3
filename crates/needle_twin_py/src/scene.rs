//! Scenes: what is modelled.

use needle_core::scene::{self, Override, Value};
use pyo3::IntoPyObjectExt as _;
use pyo3::exceptions::{PyKeyError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};

use crate::{array, error};

/// What messages call a change that was made here.
const PLACE: &str = "Python";

/// Names of the scenes that are compiled in, each with one line on what it is.
#[pyfunction]
pub(crate) fn presets() -> Vec<(&'static str, String)> {
    let line = |p: &scene::Preset| p.scene().map(|s| s.description).unwrap_or_default();
    scene::PRESETS.iter().map(|p| (p.name, line(p))).collect()
}

/// What is modelled: sample, material, instrument, discretisation, motion, targets.
///
/// A scene is a preset's name (`needle_twin.presets()`) or the path of a TOML file. Keys are read and changed by their dotted paths, in SI
/// units, with the same ranges and messages as the command line's `--set`:
///
/// >>> scene = needle_twin.Scene("needle_insertion")
/// >>> scene["material.shear_modulus_pa"] = 2000
/// >>> scene["instrument.diameter_m"]
/// 0.001
/// >>> scene["uncertainty.material.shear_modulus_pa"] = {"normal": [2000, 200]}    # mean, standard deviation
#[pyclass(module = "needle_twin")]
pub(crate) struct Scene {
    pub scene: scene::Scene,
}

#[pymethods]
impl Scene {
    /// Reads a scene and changes some of its keys, all at once.
    #[new]
    #[pyo3(signature = (name_or_path, changes = None))]
    fn new(name_or_path: &str, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let scene = scene::file::load(name_or_path).map_err(error::scene)?;
        Self { scene }.changed(changes)
    }

    /// Reads a scene from the text of a TOML file; `origin` is what messages call it.
    #[staticmethod]
    #[pyo3(signature = (text, origin = "text"))]
    fn from_toml(text: &str, origin: &str) -> PyResult<Self> {
        scene::file::from_text(text, origin).map(|scene| Self { scene }).map_err(error::scene)
    }

    /// A copy with some keys changed, all at once, so that their order doesn't matter: `{"material.poisson_ratio": 0.48}`.
    #[pyo3(signature = (changes = None))]
    pub(crate) fn changed(&self, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let Some(changes) = changes else { return Ok(Self { scene: self.scene.clone() }) };
        let of = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| -> PyResult<Override> {
            change(&key.extract::<String>()?, &value)
        };
        let changes = changes.iter().map(of).collect::<PyResult<Vec<_>>>()?;
        self.scene.with(&changes).map(|scene| Self { scene }).map_err(error::scene)
    }

    /// Short name.
    #[getter]
    fn name(&self) -> &str {
        &self.scene.name
    }

    /// What the scene is and what it assumes.
    #[getter]
    fn description(&self) -> &str {
        &self.scene.description
    }

    /// The scene as a file, every key that applies written out.
    fn to_toml(&self) -> String {
        self.scene.to_toml()
    }

    /// Every key that applies, defaults included, with its value.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (path, value) in self.scene.entries() {
            dict.set_item(path, to_python(py, value)?)?;
        }
        Ok(dict)
    }

    /// Dotted paths of every key that applies.
    fn keys(&self) -> Vec<String> {
        self.scene.paths()
    }

    /// The scene's own motion, as `solve` makes it: time in s and depth in m, each of shape (n,); `None` without one.
    fn motion<'py>(&self, py: Python<'py>) -> Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (times, depths) = self.scene.motion?.poses().unzip();
        Some((array::numbers::<f64>(py, times).into_any(), array::numbers::<f64>(py, depths).into_any()))
    }

    fn __getitem__<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyAny>> {
        let absent = || {
            let hint =
                scene::keys::nearest(key).map_or(String::new(), |k| format!("; the nearest known key is {}", k.path));
            PyKeyError::new_err(format!("{key} is not a key of scene {}{hint}", self.scene.name))
        };
        to_python(py, self.scene.get(key).ok_or_else(absent)?)
    }

    fn __setitem__(&mut self, key: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.scene = self.scene.with(&[change(key, value)?]).map_err(error::scene)?;
        Ok(())
    }

    fn __contains__(&self, key: &str) -> bool {
        self.scene.get(key).is_some()
    }

    /// As text, so that `copy`, `pickle` and worker processes can have it.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String, &'static str))> {
        Ok((slf.get_type().getattr("from_toml")?, (slf.borrow().scene.to_toml(), "pickle")))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.scene == other.scene
    }

    fn __repr__(&self) -> String {
        format!("<Scene {}: {} keys>", self.scene.name, self.scene.paths().len())
    }
}

/// A scene from what a user gave: a [`Scene`], a preset's name or a path.
pub(crate) fn of(given: &Bound<'_, PyAny>) -> PyResult<scene::Scene> {
    if let Ok(scene) = given.cast::<Scene>() {
        return Ok(scene.borrow().scene.clone());
    }
    let path = given.str()?;
    scene::file::load(path.to_str()?).map_err(error::scene)
}

fn to_python(py: Python<'_>, value: Value) -> PyResult<Bound<'_, PyAny>> {
    match value {
        Value::Text(text) => text.into_bound_py_any(py),
        Value::Real(x) => x.into_bound_py_any(py),
        Value::Integer(i) => i.into_bound_py_any(py),
        Value::Boolean(b) => b.into_bound_py_any(py),
        Value::Point(point) => point.to_vec().into_bound_py_any(py),
        Value::List(numbers) => numbers.into_bound_py_any(py),
    }
}

/// A key's new value, or its prior: `{"normal": [2000, 200]}` of `uncertainty.material.shear_modulus_pa`, with `"correlation": {"OTHER KEY": 0.6}` in it
/// where it goes with another.
fn change(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Override> {
    let prior = value.cast::<PyDict>().ok().filter(|_| key.starts_with("uncertainty."));
    let Some(prior) = prior else { return Ok(Override::typed(key, from_python(key, value)?, PLACE)) };
    let of = |(kind, numbers): (Bound<'_, PyAny>, Bound<'_, PyAny>)| -> PyResult<String> {
        if let Ok(others) = numbers.cast::<PyDict>() {
            let pair = |(other, r): (Bound<'_, PyAny>, Bound<'_, PyAny>)| -> PyResult<String> {
                Ok(format!("\"{other}\" = {:?}", r.extract::<f64>()?))
            };
            let pairs = others.iter().map(pair).collect::<PyResult<Vec<_>>>()?.join(", ");
            return Ok(format!("{kind} = {{ {pairs} }}"));
        }
        Ok(format!("{kind} = {:?}", numbers.extract::<Vec<f64>>()?))
    };
    let written = prior.iter().map(of).collect::<PyResult<Vec<_>>>()?.join(", ");
    Ok(Override::text(key, &format!("{{ {written} }}"), PLACE))
}

fn from_python(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::Text(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return Ok(Value::Integer(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Real(value.extract()?));
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(Value::Real(number)); // numpy's scalars
    }
    let numbers: Vec<f64> = value.extract().map_err(|_| {
        let kind = value.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!(
            "{key}: {kind} is no value of a key: text, a number, a truth value, or a list of numbers"
        ))
    })?;
    Ok(Value::of_numbers(numbers))
}
