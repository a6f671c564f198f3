//! The files of `batch`: the file of one row, the files of all rows, and the page.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::files::{self, Rendered};
use super::{ReportError, batch_page::batch_html};
use needle_estimate::baseline::{Against, Standing};
use needle_estimate::batch::{Fit, HeldOut, Merged, ROWS, Row, SAMPLES, SampleRow, sealed};

/// Writes the row of one recording, completely or not at all.
///
/// # Errors
/// [`ReportError`].
pub fn write_row(out: &Path, row: &Row) -> Result<PathBuf, ReportError> {
    let name = format!("{ROWS}/{}.json", row.name);
    files::write(out, &[Rendered::new(name, sealed(row))]).map(|mut paths| paths.remove(0))
}

fn sample_name(sample: &str) -> String {
    format!("{SAMPLES}/{}.json", sample.replace(['/', '\\'], "_"))
}

/// File of a sample's row.
#[must_use]
pub fn sample_path(out: &Path, sample: &str) -> PathBuf {
    out.join(sample_name(sample))
}

/// Writes the row of one sample, completely or not at all.
///
/// # Errors
/// [`ReportError`].
pub fn write_sample(out: &Path, row: &SampleRow) -> Result<PathBuf, ReportError> {
    let name = sample_name(&row.name);
    files::write(out, &[Rendered::new(name, sealed(row))]).map(|mut paths| paths.remove(0))
}

/// Writes `batch.json`, `table.csv`, `candidates.csv` and `report.html`.
///
/// # Errors
/// [`ReportError`].
pub fn write_batch(out: &Path, merged: &Merged) -> Result<Vec<PathBuf>, ReportError> {
    let rendered = [
        Rendered::new("batch.json", batch_json(merged)),
        Rendered::new("table.csv", table(merged, false)),
        Rendered::new("candidates.csv", table(merged, true)),
        Rendered::new("report.html", batch_html(merged)),
    ];
    files::write(out, &rendered)
}

/// The pooled results, for programs.
#[must_use]
pub fn batch_json(merged: &Merged) -> String {
    let count = |word: &str| {
        let explained = |row: &&Row| merged.chosen(row).is_some_and(|fit| fit.explains == word);
        merged.rows.iter().filter(explained).count()
    };
    let body = json!({
        "recordings": merged.rows.len(),
        "failed": merged.failed(),
        "missing": merged.missing,
        "explained": { "yes": count("yes"), "in part": count("in part"), "no": count("no") },
        "against_baselines": {
            "better": merged.standing(Against::Better),
            "as good": merged.standing(Against::AsGood),
            "worse": merged.standing(Against::Worse),
        },
        "groups": merged.groups,
        "samples": merged.samples,
    });
    format!("{body:#}\n")
}

/// A line per recording, with the chosen model or with all models.
fn table(merged: &Merged, all: bool) -> String {
    let mut keys: Vec<&str> =
        merged.rows.iter().flat_map(|r| &r.fits).flat_map(|f| &f.keys).map(|k| k.key.as_str()).collect();
    keys.sort_unstable();
    keys.dedup();
    let fixed = [
        "name",
        "sample",
        "group",
        "model",
        "failed",
        "explains",
        "reduced_chi_square",
        "peak_n",
        "rmse_n",
        "forward_error",
        "runs",
        "contact_depth_m",
        "force_zero_n",
        "held_out_rmse_n",
        "end_depth_m",
        "end_measured_n",
        "end_predicted_n",
        "end_error",
        "against_baselines",
        "best_baseline",
        "best_baseline_rmse_n",
    ];
    let of_keys = keys.iter().flat_map(|k| [(*k).to_owned(), format!("{k}_standard_error")]);
    let header = fixed.iter().map(|s| (*s).to_owned()).chain(of_keys);
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |cells: Vec<String>| writer.write_record(cells).unwrap_or_default(); // writing to memory can't fail
    write(header.collect());
    for row in &merged.rows {
        let chosen = merged.chosen(row);
        let fits: Vec<Option<&Fit>> = if all { row.fits.iter().map(Some).collect() } else { vec![chosen] };
        for fit in fits {
            write(line(row, fit, &keys));
        }
    }
    writer.into_inner().map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default()
}

fn line(row: &Row, fit: Option<&Fit>, keys: &[&str]) -> Vec<String> {
    let number = |x: Option<f64>| x.filter(|x| x.is_finite()).map_or_else(String::new, |x| x.to_string());
    let held = fit.and_then(|f| f.held_out.as_ref());
    let failed = row.failed.as_ref().or_else(|| fit?.failed.as_ref());
    let text = |of: fn(&Fit) -> &String| fit.map(|f| of(f).clone()).unwrap_or_default();
    let mut cells = vec![row.name.clone(), row.sample.clone(), row.group.clone()];
    cells.extend([text(|f| &f.candidate), failed.cloned().unwrap_or_default(), text(|f| &f.explains)]);
    cells.extend(
        [fit.and_then(|f| f.reduced_chi_square), fit.map(|f| f.peak_n), fit.and_then(|f| f.rmse_n)].map(number),
    );
    cells.extend([fit.and_then(|f| f.forward_error), fit.map(|f| f64::from(f.runs))].map(number));
    cells.extend([fit.map(|f| f.contact_depth_m), fit.map(|f| f.force_zero_n), held.map(|h| h.rmse_n)].map(number));
    cells.extend(
        [held.map(|h| h.end_depth_m), held.map(|h| h.end_measured_n), held.map(|h| h.end_predicted_n)].map(number),
    );
    cells.push(number(held.map(HeldOut::end_error)));
    let standing = fit.and_then(|f| f.standing.as_ref());
    let best = standing.and_then(Standing::best);
    cells.push(standing.map_or_else(String::new, |s| s.against().as_str().to_owned()));
    cells.extend([best.map_or_else(String::new, |b| b.name.clone()), number(best.map(|b| b.rmse_n))]);
    for key in keys {
        let found = fit.and_then(|f| f.keys.iter().find(|k| k.key == *key));
        cells.extend([found.map(|k| k.value), found.and_then(|k| k.standard_error)].map(number));
    }
    cells
}
