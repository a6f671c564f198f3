//! Python module `needle_twin`: scenes, the twin pose by pose, recordings, replay and calibration.
//!
//! The module is thin: every function calls the library of the same name and turns its numbers into numpy arrays, which take
//! over the library's memory instead of copying it. Whatever takes long runs without Python's lock, and Ctrl-C is heard.
//! What a user reads (`help`) stands in the documentation comments, with shapes and units; `python/needle_twin/_needle_twin.pyi`
//! has the types.
#![forbid(unsafe_op_in_unsafe_fn)]

mod array;
mod calibration;
mod ensemble;
mod error;
mod memory;
mod plan;
mod recording;
mod run;
mod scene;
mod tune;
mod twin;
mod watch;

use pyo3::prelude::*;

/// The compiled part of the package `needle_twin`; import that.
#[pymodule]
fn _needle_twin(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<twin::Twin>()?;
    module.add_class::<twin::Prediction>()?;
    module.add_class::<ensemble::Ensemble>()?;
    module.add_class::<ensemble::ForceBand>()?;
    module.add_class::<recording::Recording>()?;
    module.add_class::<run::Run>()?;
    module.add_class::<calibration::Calibration>()?;
    module.add_function(wrap_pyfunction!(scene::presets, module)?)?;
    module.add_function(wrap_pyfunction!(run::solve, module)?)?;
    module.add_function(wrap_pyfunction!(run::replay, module)?)?;
    module.add_function(wrap_pyfunction!(calibration::calibrate, module)?)?;
    module.add_function(wrap_pyfunction!(calibration::layers, module)?)?;
    module.add_function(wrap_pyfunction!(plan::plan, module)?)?;
    module.add_function(wrap_pyfunction!(tune::tune, module)?)?;
    error::register(module)
}
