//! Exceptions. Each message says what is wrong, where, and what to do.

use needle_core::twin::Halt;
use needle_estimate::compare::ensemble::EnsembleError;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;

create_exception!(needle_twin, NeedleTwinError, PyException, "Whatever goes wrong in needle_twin.");
create_exception!(
    needle_twin,
    SceneError,
    NeedleTwinError,
    "A scene, or one of its keys, can't be used. The message names the key, its value, what is allowed and the nearest known key."
);
create_exception!(needle_twin, BuildError, NeedleTwinError, "No model can be made of a scene.");
create_exception!(
    needle_twin,
    RecordingError,
    NeedleTwinError,
    "A bag or table can't be read, or its units, signs or scene look wrong."
);
create_exception!(
    needle_twin,
    PoseRefused,
    NeedleTwinError,
    "A pose can't be used. The twin is as it was: send the next one."
);
create_exception!(
    needle_twin,
    Diverged,
    NeedleTwinError,
    "The solution was lost. The twin is back in its last good state: go on from a shallower pose, or reset it."
);
create_exception!(needle_twin, CalibrationError, NeedleTwinError, "The keys can't be found from the recording.");

/// Adds the exceptions to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("NeedleTwinError", py.get_type::<NeedleTwinError>())?;
    module.add("SceneError", py.get_type::<SceneError>())?;
    module.add("BuildError", py.get_type::<BuildError>())?;
    module.add("RecordingError", py.get_type::<RecordingError>())?;
    module.add("PoseRefused", py.get_type::<PoseRefused>())?;
    module.add("Diverged", py.get_type::<Diverged>())?;
    module.add("CalibrationError", py.get_type::<CalibrationError>())
}

/// A scene's error.
pub(crate) fn scene(error: needle_core::scene::SceneError) -> PyErr {
    SceneError::new_err(error.to_string())
}

/// Why there is no ensemble. What the command line says of a scene without priors is said in Python's words.
pub(crate) fn ensemble(error: EnsembleError) -> PyErr {
    match error {
        EnsembleError::NoUncertainty { scene, key, mean, deviation } => SceneError::new_err(format!(
            "scene {scene} says of no key how uncertain it is: scene[\"uncertainty.{key}\"] = {{\"normal\": [{mean}, {deviation}]}} (mean and standard \
             deviation; lognormal and uniform are there too)"
        )),
        EnsembleError::Count(_) => PyValueError::new_err(error.to_string()),
        _ => SceneError::new_err(error.to_string()),
    }
}

/// Why a pose has no answer.
pub(crate) fn halt(halt: &Halt) -> PyErr {
    match halt {
        Halt::Pose { .. } => PoseRefused::new_err(halt.to_string()),
        _ => Diverged::new_err(halt.to_string()),
    }
}

/// A message of the command line in Python's words: `--position-unit mm` is `position_unit=`, `--set KEY=VALUE` is `changes={...}`.
pub(crate) fn in_python(message: &str) -> String {
    let mut parts = message.split("--");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| !(c.is_ascii_lowercase() || c == '-')).unwrap_or(part.len());
        let (option, rest) = part.split_at(end);
        // a dash in a sentence is none
        let name = option.trim_end_matches('-');
        match name {
            "" => text += "--",
            "set" => text += "changes=",
            "force" => text += "force=True",
            "force-column" | "force-topic" => text += "force=",
            "position-topic" => text += "position=",
            _ => text += &format!("{}=", name.replace('-', "_")),
        }
        text += &option[name.len()..];
        // a value follows its option after a blank
        let given = |rest: &&str| rest.starts_with(|c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '-');
        text += rest.strip_prefix(' ').filter(|_| !name.is_empty()).filter(given).unwrap_or(rest);
    }
    text
}
