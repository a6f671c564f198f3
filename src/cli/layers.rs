//! `needle_twin calibrate --layers`: what a double insertion says of layers.

use std::path::PathBuf;

use super::summary::{screen, written};
use needle_estimate::layers::{Found, Known};

/// Screen of what was found.
pub(super) fn summary(found: &Found, files: Option<&[PathBuf]>) -> String {
    let said = |known: Option<Known>, scale: f64, unit: &str| {
        known.map_or_else(
            || "not told".to_owned(),
            |k| format!("{:.2} ± {:.2} {unit}", scale * k.value, scale * k.standard_error),
        )
    };
    let mut lines = Vec::new();
    for (i, layer) in found.layers.iter().enumerate() {
        lines.push((
            "layer",
            format!(
                "{}: from {}, friction {}, cutting {}, puncture {}",
                i + 1,
                said(layer.from_depth_m, 1e3, "mm"),
                said(Some(layer.friction_n_per_m), 1.0, "N/m"),
                said(layer.cutting_force_n, 1e3, "mN"),
                said(layer.puncture_force_n, 1e3, "mN"),
            ),
        ));
    }
    lines.extend(found.cannot_tell.iter().map(|what| ("not told", what.clone())));
    lines.extend(found.alone.iter().map(|what| ("from one insertion alone not told", what.clone())));
    let drops: Vec<String> = found.drops_m.iter().map(|d| format!("{:.2}", 1e3 * d)).collect();
    lines.push(("drops", format!("{} mm", drops.join(", "))));
    lines.push(("residual", format!("rmse {:.6} N of the friction's lines", found.rmse_n)));
    lines.extend(files.and_then(|files| Some(("files", written(files.first()?, files)))));
    screen(&lines)
}
