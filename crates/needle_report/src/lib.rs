//! Reports of a run: figures, curves, plots and the deformed sample.
//!
//! [`write_all`] writes all files of one [`Run`]; each file has its own function as well. Everything is rendered
//! before the first file is written, and files appear under their names only when they are complete. Nothing here
//! computes mechanics, and no file contains a number that is not finite.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod batch_page;
mod batch_table;
mod calibration_json;
mod calibration_plot;
mod cost_marks;
mod cost_page;
mod cost_plot;
mod csv;
mod deformation_plot;
mod embed;
mod error;
mod files;
mod fonts;
mod force_plot;
mod forecast;
mod layers_json;
mod line_plot;
mod marker_fit;
mod metrics;
mod page;
mod phases;
mod picture;
mod place;
mod plan_json;
mod plot;
#[cfg(feature = "plots")]
mod raster;
mod regions;
mod reliability_plot;
mod rest_plot;
mod scene_section;
mod section;
mod settings;
mod speed_plot;
mod stability_map;
mod strain;
mod svg;
mod tables;
mod thin;
mod unit;
mod verification_plot;
mod vtu;

pub use batch_table::{batch_json, sample_path, write_batch, write_row, write_sample};
pub use calibration_json::calibration_json;
pub use csv::{force_csv, targets_csv};
pub use error::ReportError;
pub use files::prepare;
pub use forecast::{Forecasted, forecast_json, forecast_lines, write_forecast, write_prediction};
pub use layers_json::{layers_json, write_layers};
pub use marker_fit::{marker_fit_json, write_marker_fit};
pub use metrics::metrics_json;
pub use page::report_html;
pub use plan_json::plan_json;
pub use regions::colour as region_colour;
pub use vtu::{clear_series, final_vtu, write_series};

use files::Rendered;
use needle_core::scene::Scene;
use needle_core::twin::Body;
use needle_estimate::calibrate::Calibration;
use needle_estimate::compare::Run;
use needle_studies::accuracy::{Row, Steps};
use needle_studies::bounds::Bounds;
use needle_studies::verification::{self, Verification};
use needle_studies::{speed, stability};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Pixels of `force.png` per px of the picture: 1920 pixels wide.
#[cfg(feature = "plots")]
const PNG_SCALE: f32 = 2.0;

/// Writes the files of a run into a folder, which is created if necessary, and returns their paths:
///
/// - `metrics.json`, `force.csv`, `targets.csv`, `final.vtu`, `force.png`, `force.svg` and `report.html`;
/// - with an ensemble and a measured force `forecast.csv`, `keys.csv` and `reliability.svg`;
/// - with friction `deformation.csv` and `.svg`;
/// - with a needle that bends `needle.csv`, `shape.csv` and `needle.vtu`.
///
/// # Errors
/// [`ReportError`] naming the file and the reason. No file has then been replaced by an incomplete one.
pub fn write_all(out: &Path, run: &Run) -> Result<Vec<PathBuf>, ReportError> {
    let mut rendered = vec![
        Rendered::new("metrics.json", metrics_json(run)),
        Rendered::new("force.csv", force_csv(run)),
        Rendered::new("targets.csv", targets_csv(run)),
        Rendered::new("final.vtu", final_vtu(run)?),
        Rendered::new("report.html", report_html(run)?),
    ];
    push_picture(&mut rendered, "force", &force_plot::force_plot(run))?;
    let forecasts = [
        ("forecast.csv", csv::forecast_csv(run)),
        ("keys.csv", csv::keys_csv(run)),
        ("deformation.csv", csv::deformation_csv(run)),
        ("needle.csv", csv::needle_csv(run)),
        ("shape.csv", csv::shape_csv(run)),
        ("needle.vtu", vtu::needle_vtu(run)),
        ("deformation.svg", deformation_plot::deformation_plot(run).map(|picture| picture.to_svg())),
        ("reliability.svg", reliability_plot::reliability_plot(run).map(|picture| picture.to_svg())),
    ];
    for (name, text) in forecasts {
        match text {
            Some(text) => rendered.push(Rendered::new(name, text)),
            // a file of an earlier run does not belong to the new files
            None => files::remove_file(&out.join(name))?,
        }
    }
    files::write(out, &rendered)
}

/// Content of `force.svg`: predicted and measured force over depth, with the residual below.
#[must_use]
pub fn force_svg(run: &Run) -> String {
    force_plot::force_plot(run).to_svg()
}

/// Content of `force.png`: the same plot as [`force_svg`], 1920 pixels wide.
///
/// # Errors
/// [`ReportError::Picture`] if it can't be drawn.
#[cfg(feature = "plots")]
pub fn force_png(run: &Run) -> Result<Vec<u8>, ReportError> {
    force_plot::force_plot(run).to_png("force.png", PNG_SCALE)
}

/// Plots the rows of an accuracy study and returns the files' paths. For each scene: `accuracy_SCENE.svg` and `.png`,
/// error against cost; and for the runs to equilibrium `at_rest_SCENE.svg` and `.png`. For all scenes:
/// `accuracy.html`.
///
/// # Errors
/// As [`write_all`].
pub fn write_accuracy(out: &Path, rows: &[Row]) -> Result<Vec<PathBuf>, ReportError> {
    let mut rendered = Vec::new();
    let mut charted = Vec::new();
    let scenes: BTreeSet<&str> = rows.iter().map(|r| r.scene.as_str()).collect();
    for scene in scenes {
        let (at_rest, moving): (Vec<&Row>, Vec<&Row>) =
            rows.iter().filter(|r| r.scene == scene).partition(|r| r.case.steps == Steps::Rest);
        if !at_rest.is_empty() {
            push_picture(&mut rendered, &format!("at_rest_{scene}"), &rest_plot::rest_plot(scene, &at_rest))?;
        }
        if !moving.is_empty() {
            push_picture(&mut rendered, &format!("accuracy_{scene}"), &cost_plot::cost_plot(scene, &moving))?;
            charted.push((scene, moving));
        }
    }
    if !charted.is_empty() {
        rendered.push(Rendered::new("accuracy.html", cost_page::cost_page(&charted)));
    }
    files::write(out, &rendered)
}

fn push_picture(rendered: &mut Vec<Rendered>, name: &str, picture: &picture::Picture) -> Result<(), ReportError> {
    rendered.push(Rendered::new(format!("{name}.svg"), picture.to_svg()));
    #[cfg(feature = "plots")]
    rendered.push(Rendered::new(format!("{name}.png"), picture.to_png("the PNG", PNG_SCALE)?));
    Ok(())
}

/// Writes a section of a scene's body along its instrument, as PNG if the path ends in `.png`, and otherwise as SVG.
///
/// # Errors
/// As [`write_all`].
pub fn write_section(path: &Path, scene: &Scene, body: &Body) -> Result<(), ReportError> {
    let picture = scene_section::scene_section(scene, body);
    match path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        #[cfg(feature = "plots")]
        true => write_file(path, &picture.to_png("the PNG", PNG_SCALE)?),
        #[cfg(not(feature = "plots"))]
        true => Err(ReportError::NoPng { path: path.to_path_buf() }),
        false => write_file(path, picture.to_svg().as_bytes()),
    }
}

/// Writes one file such that no incomplete file ever exists under its name.
///
/// # Errors
/// [`ReportError`] naming the file and the reason.
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), ReportError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    files::write(folder, &[Rendered::new(name, content)]).map(drop)
}

/// Writes `stability.csv` and `stability.svg` and `.png`; returns their paths.
///
/// # Errors
/// As [`write_all`].
pub fn write_stability(out: &Path, rows: &[stability::Row]) -> Result<Vec<PathBuf>, ReportError> {
    let map = stability_map::stability_map(rows);
    let mut rendered = vec![Rendered::new("stability.csv", stability::csv(rows))];
    push_picture(&mut rendered, "stability", &map)?;
    files::write(out, &rendered)
}

/// Writes `verification.csv` and, for each scene, `verification_SCENE.svg` and `.png`; returns their paths.
///
/// # Errors
/// As [`write_all`].
pub fn write_verification(out: &Path, all: &[Verification]) -> Result<Vec<PathBuf>, ReportError> {
    let mut rendered = vec![Rendered::new("verification.csv", verification::csv(all))];
    for one in all {
        let name = format!("verification_{}", one.scene);
        push_picture(&mut rendered, &name, &verification_plot::verification_plot(one))?;
    }
    files::write(out, &rendered)
}

/// Writes `calibration.json`, `calibration.csv`, `calibration.svg` and `.png`, and the scene with the identified
/// values, `scene.toml`. Returns their paths. `source` is the source of the measurement, and `json` is the result of
/// [`calibration_json`]. Without a scene, the `scene.toml` of an earlier calibration is removed, since it does not
/// belong to the new files.
///
/// # Errors
/// As [`write_all`].
pub fn write_calibration(
    out: &Path,
    calibration: &Calibration,
    source: &str,
    json: &str,
    scene_toml: Option<&str>,
) -> Result<Vec<PathBuf>, ReportError> {
    let mut rendered = vec![
        Rendered::new("calibration.json", json),
        Rendered::new("calibration.csv", csv::calibration_csv(&calibration.forces)),
    ];
    match scene_toml {
        Some(text) => rendered.push(Rendered::new("scene.toml", text)),
        None => files::remove_file(&out.join("scene.toml"))?,
    }
    push_picture(&mut rendered, "calibration", &calibration_plot::calibration_plot(calibration, source))?;
    files::write(out, &rendered)
}

/// Writes `speed.csv`, `speed.svg` and `speed.png`; returns their paths.
///
/// # Errors
/// As [`write_all`].
pub fn write_speed(
    out: &Path,
    processor: &str,
    bounds: Bounds,
    rows: &[speed::Row],
) -> Result<Vec<PathBuf>, ReportError> {
    let picture = speed_plot::speed_plot(processor, bounds, rows);
    let mut rendered = vec![Rendered::new("speed.csv", speed::csv(rows))];
    push_picture(&mut rendered, "speed", &picture)?;
    files::write(out, &rendered)
}
