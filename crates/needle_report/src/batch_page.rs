//! The page of `batch`: pooled results of the samples, and one small plot per recording, the worst first.

use std::fmt::Write as _;

use super::svg::escaped;
use needle_estimate::batch::{Fit, Group, Merged, Row, Sample};

/// Size of a small plot, px.
const SIZE: [f64; 2] = [220.0, 120.0];
const MARGIN: f64 = 8.0;

const STYLE: &str = "body{font:15px/1.5 Inter,'Helvetica Neue',Arial,sans-serif;max-width:1200px;margin:2rem auto;padding:0 1rem;\
color:#1a1a1a;background:#fff}table{border-collapse:collapse;font-size:13px}td,th{padding:.25rem .6rem;text-align:left;\
border-bottom:1px solid #ddd}td.n{text-align:right;font-variant-numeric:tabular-nums}.grid{display:grid;\
grid-template-columns:repeat(auto-fill,minmax(220px,1fr));gap:1rem}.card{border:1px solid #ddd;border-radius:6px;padding:.5rem;\
font-size:12px}.card b{font-size:13px}.bad{color:#b00020}.m{fill:none;stroke:#888;stroke-width:3}.p{fill:none;stroke:#0b62a4;\
stroke-width:1.5}@media(prefers-color-scheme:dark){body{color:#e8e8e8;background:#161616}td,th,.card{border-color:#444}\
.p{stroke:#5ab0f0}.bad{color:#ff7b8a}}";

/// Sort key of a row: failures first, then by the error of its prediction, or else of its fit, over the peak.
fn badness(merged: &Merged, row: &Row) -> (u8, f64) {
    let Some(fit) = merged.chosen(row).filter(|_| row.failed.is_none()) else { return (0, 0.0) };
    let predicted = fit.held_out.as_ref().map(|h| h.end_error().abs()).filter(|e| e.is_finite());
    (1, -predicted.or_else(|| fit.nrmse()).unwrap_or(f64::INFINITY))
}

fn percent(x: Option<f64>) -> String {
    x.filter(|x| x.is_finite()).map_or_else(|| "-".to_owned(), |x| format!("{:.1} %", 100.0 * x))
}

/// A number with four significant digits.
fn figure(x: f64) -> String {
    let digits = (3.0 - x.abs().max(1e-300).log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{x:.digits$}")
}

/// Content of the page.
#[must_use]
pub(crate) fn batch_html(merged: &Merged) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>Recordings</title><style>{STYLE}</style><h1>{} recordings</h1>\n",
        merged.rows.len()
    );
    let (failed, missing) = (merged.failed(), merged.missing);
    if failed + missing > 0 {
        let _ = writeln!(page, "<p class=\"bad\">{failed} failed, {missing} have no row yet.</p>");
    }
    groups(&mut page, &merged.groups);
    samples(&mut page, &merged.samples);
    page.push_str("<h2>Recordings, the worst first</h2><p>Measured force (grey) and predicted (blue) over the depth since contact.</p>\
                   <div class=\"grid\">\n");
    let mut rows: Vec<&Row> = merged.rows.iter().collect();
    rows.sort_by(|a, b| {
        let (x, y) = (badness(merged, a), badness(merged, b));
        x.0.cmp(&y.0).then(x.1.total_cmp(&y.1))
    });
    rows.iter().for_each(|row| card(&mut page, row, merged.chosen(row)));
    page.push_str("</div></html>\n");
    page
}

fn groups(page: &mut String, groups: &[Group]) {
    page.push_str("<h2>Kinds of samples</h2><table><tr><th>kind<th>model<th>error by which it was chosen<th>keys: mean, within, between samples\
                   <th>predicted within 5 %<th>mean and largest error at the end</tr>\n");
    for g in groups {
        let left = g.candidates.iter().find(|(name, _)| *name == g.candidate).and_then(|(_, left)| *left);
        let key = |(key, mean, within, between): &(String, f64, Option<f64>, Option<f64>)| {
            let spread = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), figure);
            format!("{} {}, {}, {}", escaped(key), figure(*mean), spread(*within), spread(*between))
        };
        let keys: Vec<String> = g.keys.iter().map(key).collect();
        let _ = writeln!(
            page,
            "<tr><td>{}<td>{}<td class=\"n\">{}<td>{}<td class=\"n\">{} of {}<td class=\"n\">{}, {}</tr>",
            escaped(&g.name),
            escaped(&g.candidate),
            percent(left),
            keys.join("<br>"),
            g.within_5_percent,
            g.predicted,
            percent(g.mean_end_error),
            percent(g.largest_end_error)
        );
    }
    page.push_str("</table>\n");
}

fn samples(page: &mut String, samples: &[Sample]) {
    page.push_str(
        "<h2>Samples</h2><table><tr><th>sample<th>keys: joint estimate ± standard error (spread of the recordings)\
                   <th>recordings<th>each predicted by the others: largest error</tr>\n",
    );
    for s in samples {
        let key = |k: &needle_estimate::batch::Pooled| {
            let or = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), figure);
            format!("{} {} ± {} ({})", escaped(&k.key), figure(k.value), or(k.standard_error), or(k.spread))
        };
        let keys: Vec<String> = s.keys.iter().map(key).collect();
        let worst = s.left_one_out.iter().map(|(_, e)| *e).reduce(f64::max);
        let count = s.keys.first().map_or(s.left_one_out.len(), |k| k.count);
        let _ = writeln!(
            page,
            "<tr><td>{}<td>{}<td class=\"n\">{count}<td class=\"n\">{}</tr>",
            escaped(&s.name),
            keys.join("<br>"),
            percent(worst)
        );
    }
    page.push_str("</table>\n");
}

fn card(page: &mut String, row: &Row, fit: Option<&Fit>) {
    let _ = write!(page, "<div class=\"card\"><b>{}</b><br>", escaped(&row.name));
    match (fit, &row.failed) {
        (Some(fit), None) => {
            picture(page, fit);
            let end = fit.held_out.as_ref().map(|h| format!(", at the end {:+.1} %", 100.0 * h.end_error()));
            let _ = write!(
                page,
                "explained: {}<br>left of the fit {}{}",
                escaped(&fit.explains),
                percent(fit.nrmse()),
                end.unwrap_or_default()
            );
        }
        (_, reason) => {
            let reason = reason.as_deref().unwrap_or("the chosen model failed on it");
            let _ = write!(page, "<span class=\"bad\">{}</span>", escaped(reason));
        }
    }
    page.push_str("</div>\n");
}

fn picture(page: &mut String, fit: &Fit) {
    let curve = &fit.curve;
    let both = || curve.measured_n.iter().chain(&curve.predicted_n).copied().filter(|f| f.is_finite());
    let (low, high) = (both().fold(0.0, f64::min), both().fold(0.0, f64::max));
    let deepest = curve.depth_m.last().copied().unwrap_or(0.0);
    let [w, h] = SIZE;
    let x = |d: f64| MARGIN + (w - 2.0 * MARGIN) * d / deepest.max(f64::MIN_POSITIVE);
    let y = |f: f64| h - MARGIN - (h - 2.0 * MARGIN) * (f - low) / (high - low).max(f64::MIN_POSITIVE);
    let line = |forces: &[f64], class: &str| {
        let points: String =
            curve.depth_m.iter().zip(forces).map(|(d, f)| format!("{:.1},{:.1} ", x(*d), y(*f))).collect();
        format!("<polyline class=\"{class}\" points=\"{}\"/>", points.trim_end())
    };
    let _ = write!(
        page,
        "<svg viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"force over depth\">{}{}</svg>",
        line(&curve.measured_n, "m"),
        line(&curve.predicted_n, "p")
    );
    let _ = write!(page, "to {:.1} mm, {} N<br>", 1e3 * deepest, figure(high));
}
