//! `needle_twin calibrate --layers`: what a double insertion says of layers.

use std::path::PathBuf;

use super::summary::{screen, written};
use crate::compare::{At, ForceSeries, Reading};
use crate::scene::Scene;
use crate::study::layers::{Found, Known, LayersError, layers};

/// Straight from the readings.
pub(super) fn found(
    scene: &Scene,
    readings: &[Reading],
    measured: &ForceSeries,
    number: usize,
) -> Result<Found, LayersError> {
    let diameter = scene.instrument.and_then(|i| i.needle_diameter_m()).ok_or(LayersError::NoNeedle)?;
    let top = scene.sample.shape.height().map_or(0.0, |h| h.get());
    let force = |r: &Reading| {
        let force = measured.at(r.time_s)?;
        Some(match r.at {
            At::Depth(depth) => [r.time_s, depth, force[2]],
            At::Pose(pose) => {
                let against = -(0..3).map(|k| force[k] * pose.axis[k]).sum::<f64>();
                [r.time_s, top - pose.tip[2], against]
            }
        })
    };
    layers(&readings.iter().filter_map(force).collect::<Vec<_>>(), diameter, number)
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
    lines.push(("residual", format!("rmse {:.6} N of the friction's lines", found.rmse_n)));
    lines.extend(files.and_then(|files| Some(("files", written(files.first()?, files)))));
    screen(&lines)
}
