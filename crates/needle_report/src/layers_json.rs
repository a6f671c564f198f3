//! `layers.json`: the layers estimated from a double insertion, for programs.

use super::files::Rendered;
use super::{ReportError, files};
use needle_estimate::layers::{Found, Known, Part};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Content of `layers.json`, as `calibrate --layers --json` prints it. What is not determined is `null`.
#[must_use]
pub fn layers_json(found: &Found, source: &str) -> String {
    let known = |k: Option<Known>| -> Value {
        k.filter(|k| k.value.is_finite() && k.standard_error.is_finite())
            .map_or(Value::Null, |k| json!({ "value": k.value, "standard_error": k.standard_error }))
    };
    let layers: Vec<Value> = found
        .layers
        .iter()
        .map(|layer| {
            json!({
                "from_depth_m": known(layer.from_depth_m),
                "friction_n_per_m": known(Some(layer.friction_n_per_m)),
                "cutting_force_n": known(layer.cutting_force_n),
                "puncture_force_n": known(layer.puncture_force_n),
            })
        })
        .collect();
    let part = |p: &Part| {
        json!({
            "depth_m": p.depth_m, "measured_n": p.measured_n, "friction_n": p.friction_n, "at_the_tip_n": p.at_the_tip_n(),
        })
    };
    let body = json!({
        "measured_source": source,
        "layers": layers,
        "cannot_tell": found.cannot_tell,
        "cannot_tell_from_one_insertion": found.alone,
        "drops_m": found.drops_m,
        "adds_up": found.beyond().is_none(),
        "parts": found.parts.iter().map(part).collect::<Vec<Value>>(),
        "rmse_n": found.rmse_n,
    });
    let mut text = format!("{body:#}");
    text.push('\n');
    text
}

/// Writes it into a folder, which is created if necessary.
///
/// # Errors
/// If it can't be written.
pub fn write_layers(out: &Path, json: &str) -> Result<Vec<PathBuf>, ReportError> {
    files::write(out, &[Rendered::new("layers.json", json)])
}
