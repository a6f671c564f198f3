//! The result of a calibration from tracked points, for programs: `calibration.json`, `markers.csv`, `scene.toml`.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::ReportError;
use super::files::{self, Rendered};
use needle_estimate::calibrate::{MarkerFit, MarkerResidual};

/// Content of `calibration.json`, with the residuals of the markers.
#[must_use]
pub fn marker_fit_json(fit: &MarkerFit, source: &str) -> String {
    let estimates = fit
        .estimates
        .iter()
        .map(|e| (e.key.clone(), json!({ "value": e.value, "standard_error": e.standard_error, "start": e.start })));
    let marker = |m: &MarkerResidual| json!({ "name": m.name, "position_m": m.position, "mean_m": m.mean_m, "rms_m": m.rms_m, "seen": m.seen });
    let body = json!({
        "scene": fit.scene.name,
        "measured_source": source,
        "fit": Value::Object(estimates.collect::<Map<String, Value>>()),
        "rmse_n": fit.rmse_n,
        "markers": fit.residuals.iter().map(marker).collect::<Vec<_>>(),
        "reduced_chi_square": fit.reduced_chi_square,
        "converged": fit.converged,
        "runs": fit.runs,
    });
    format!("{body:#}\n")
}

/// Writes the files.
///
/// # Errors
/// [`ReportError`].
pub fn write_marker_fit(out: &Path, fit: &MarkerFit, source: &str) -> Result<Vec<PathBuf>, ReportError> {
    let row = |m: &MarkerResidual| {
        let cells = m.position.iter().chain(&m.mean_m).chain([&m.rms_m]).map(f64::to_string).collect::<Vec<_>>();
        format!("\"{}\",{},{}\n", m.name.replace('"', "\"\""), cells.join(","), m.seen)
    };
    let head = "name,x_m,y_m,z_m,residual_x_m,residual_y_m,residual_z_m,rms_m,seen\n";
    let rendered = [
        Rendered::new("calibration.json", marker_fit_json(fit, source)),
        Rendered::new("markers.csv", head.to_owned() + &fit.residuals.iter().map(row).collect::<String>()),
        Rendered::new("scene.toml", fit.scene.to_toml()),
    ];
    files::write(out, &rendered)
}
