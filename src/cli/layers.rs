//! `needle_twin calibrate --layers`: what a double insertion says of layers.

use std::path::PathBuf;

use super::summary::{screen, written};
use needle_estimate::layers::{Found, Known, Part};

/// What the force at a depth consists of.
fn sum(part: &Part) -> String {
    format!(
        "at {:.2} mm friction {:.1} and at the tip {:.1} mN, {:.1} measured",
        1e3 * part.depth_m,
        1e3 * part.friction_n,
        1e3 * part.at_the_tip_n(),
        1e3 * part.measured_n
    )
}

/// Why what was found is not believed: its parts exceed the force.
pub(super) fn doubt(found: &Found) -> Option<String> {
    let part = found.beyond()?;
    Some(format!(
        "rejected: what was found does not add up to the measured force ({}): on the way out something else than friction acts (tissue that sticks \
         and springs back, a wrong zero, a surface elsewhere than at depth 0, other layers)",
        sum(part)
    ))
}

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
    lines.extend(found.parts.last().map(|p| ("parts", sum(p))));
    lines.push(("residual", format!("rmse {:.6} N of the friction's lines", found.rmse_n)));
    lines.extend(files.and_then(|files| Some(("files", written(files.first()?, files)))));
    screen(&lines)
}
