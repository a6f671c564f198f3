//! Figures and tables of the page.

use super::{
    svg::escaped,
    unit::{Scale, count, significant},
};
use needle_core::twin::Event;
use needle_estimate::compare::{Explains, Run, StabilityRow, Verdict};
use std::fmt::Write as _;

/// Largest distance between contact and puncture for which the surface counts as punctured at first contact, m.
const FIRST_CONTACT_M: f64 = 5e-6;

/// A figure of the stability table in the page's format.
fn shown(row: &StabilityRow) -> String {
    let figures = if row.name.starts_with("Smallest") { 3 } else { 2 };
    format!("{}{}", significant(row.value, figures), row.unit)
}

/// The verdict on the measurement, then whether the run itself is reliable, with reasons: a bad fit comes before late
/// poses.
pub(super) fn verdict(html: &mut String, run: &Run) {
    let fit = run.verdict();
    let mut reasons: Vec<String> = fit.reasons.clone();
    reasons.extend(run.losses.iter().cloned());
    let poses = |n: u64| if n == 1 { "1 pose was".to_owned() } else { format!("{} poses were", count(n)) };
    // late poses don't matter offline
    let blameless = reasons.is_empty() && !(run.live && run.missed_deadlines + run.coalesced_poses > 0);
    if run.missed_deadlines > 0 {
        let late = if run.live {
            "answered after the next one had come"
        } else {
            "computed for longer than the time to the next one"
        };
        reasons.push(format!("{} {late}", poses(run.missed_deadlines)));
    }
    if run.coalesced_poses > 0 {
        reasons.push(format!("{} skipped for a newer one", poses(run.coalesced_poses)));
    }
    let unstable = !run.unstable().is_empty();
    let (class, text) = match (&run.diverged, fit.explains) {
        (Some(_), _) => ("bad", "The model diverged.".to_owned()),
        (None, _) if run.answers.is_empty() => ("bad", "No pose was answered.".to_owned()),
        (None, _) if unstable => {
            ("bad", "The stability table does not hold: the forces are not to be trusted.".to_owned())
        }
        (None, Explains::No) => ("bad", sentence(&fit)),
        (None, Explains::InPart) => ("warn", sentence(&fit)),
        (None, Explains::Yes) => (if blameless { "good" } else { "warn" }, sentence(&fit)),
        (None, Explains::NoMeasurement) if blameless => ("good", "Finished; every check passed.".to_owned()),
        (None, Explains::NoMeasurement) => ("warn", "Finished, with remarks.".to_owned()),
    };
    let _ = writeln!(html, "<div class=\"verdict {class}\"><strong>{}</strong>", escaped(&text));
    if !reasons.is_empty() {
        let items: String = reasons.iter().map(|r| format!("<li>{}</li>", escaped(r))).collect();
        let _ = writeln!(html, "<ul>{items}</ul>");
    }
    html.push_str("</div>\n");
}

/// The verdict's line as a sentence.
fn sentence(verdict: &Verdict) -> String {
    let line = verdict.line();
    let mut letters = line.chars();
    letters.next().map_or_else(String::new, |first| format!("{}{}.", first.to_uppercase(), letters.as_str()))
}

/// The most important figures.
pub(super) fn cards(html: &mut String, run: &Run) {
    let force = Scale::of_force(run);
    let m = run.force_metrics();
    let newton = |f: Option<f64>| f.map(|f| significant(force.factor * f, 3));
    let with_unit = |f: Option<f64>| newton(f).map(|f| format!("{f} {}", force.unit)).unwrap_or_default();
    html.push_str("<div class=\"cards\">\n");
    let measured = m.peak_measured_n.map(|_| format!("measured {}", with_unit(m.peak_measured_n)));
    let name = if run.has_peak() { "Predicted peak" } else { "Largest predicted force (no peak: it fails)" };
    card(html, name, newton(m.peak_predicted_n), force.unit, measured);
    if let Some(nrmse) = m.nrmse {
        let largest = format!("{}; at most {}", with_unit(m.rmse_n), with_unit(m.max_abs_error_n));
        card(html, "Relative RMSE", Some(significant(100.0 * nrmse, 2)), "%", Some(largest));
    }
    if let Some(rmse) = newton(m.rmse_vector_n) {
        let largest = format!("at most {}, with the components across the axis", with_unit(m.max_vector_error_n));
        card(html, "RMSE of the vector", Some(rmse), force.unit, Some(largest));
    }
    let seconds = format!("{} s for {} s of motion", significant(run.wall_s, 3), significant(run.simulated_s, 3));
    card(html, "Times real time", run.real_time_factor().map(|f| significant(f, 3)), "×", Some(seconds));
    if let Some(latency) = run.latency_ms() {
        let (factor, unit) = if latency.max > 5000.0 { (1e-3, "s") } else { (1.0, "ms") };
        let shown = |ms: f64| significant(factor * ms, 2);
        let rest = format!("median {}, most {} {unit}", shown(latency.p50), shown(latency.max));
        card(html, "Latency (p99)", Some(shown(latency.p99)), unit, Some(rest));
    }
    if let Some(mean) = run.steps_per_pose() {
        let step = run.step_us().map(|us| format!(", {} µs each", significant(us, 3))).unwrap_or_default();
        let rest = format!("{} in all{step}", count(run.steps));
        card(html, "Steps per pose", Some(significant(mean, 3)), "", Some(rest));
    }
    let kind = [run.method.as_str(), run.dimension.as_str()].into_iter().filter(|word| !word.is_empty());
    let kind = kind.collect::<Vec<_>>().join(", ");
    let points = format!("{kind}, {} integration points", count(run.integration_points as u64));
    card(html, "Nodes", Some(count(run.nodes as u64)), "", Some(points));
    if let Some(radius_m) = run.effective_radius_m {
        let below = "radius that the cloud gives the needle".to_owned();
        card(html, "Effective radius", Some(significant(1e3 * radius_m, 3)), "mm", Some(below));
    }
    let puncture =
        run.answers.iter().find_map(|a| a.event.and_then(Event::puncture_depth).map(|depth_m| (depth_m, a.time_s)));
    if let Some((depth_m, time_s)) = puncture.filter(|(depth_m, _)| depth_m.is_finite()) {
        let at_once = if depth_m < FIRST_CONTACT_M { "deep, at first contact, " } else { "deep, " };
        let when = format!("{at_once}{} s after the first pose", significant(time_s, 3));
        // resolution of a micrometre, as a displacement sensor has
        card(html, "Puncture", Some(format!("{:.3}", 1e3 * depth_m)), "mm", Some(when));
    }
    html.push_str("</div>\n");
}

fn card(html: &mut String, name: &str, figure: Option<String>, unit: &str, below: Option<String>) {
    let figure = figure.unwrap_or_else(|| "–".to_owned());
    let below = below.map(|b| format!("<p>{}</p>", escaped(&b))).unwrap_or_default();
    let _ = writeln!(
        html,
        "<div class=\"card\"><h3>{name}</h3><div class=\"figure\">{figure} <small>{unit}</small></div>{below}</div>"
    );
}

/// Errors of the twin and of the baselines over the readings after half of the insertion; nothing if too little was
/// measured.
pub(super) fn baselines(html: &mut String, run: &Run) {
    let Some(standing) = run.standing() else { return };
    let force = Scale::of_force(run);
    html.push_str(
        "<section id=\"baselines\">\n<h2>Against simple formulas</h2>\n<div class=\"wide\"><table class=\"stack\">\n<thead><tr><th>Model</th>\
         <th class=\"number\">Error</th></tr></thead>\n<tbody>\n",
    );
    let rows = std::iter::once(("twin", standing.twin_rmse_n));
    for (name, rmse_n) in rows.chain(standing.baselines.iter().map(|b| (b.name.as_str(), b.rmse_n))) {
        let error = significant(force.factor * rmse_n, 3);
        let _ = writeln!(html, "<tr><th>{name}</th><td class=\"number\">{error} {}</td></tr>", force.unit);
    }
    let _ = writeln!(
        html,
        "</tbody></table></div>\n<p>Root mean square over the {} readings after half of the insertion. The formulas are fitted to {}; \
         nothing of the twin is.</p>\n</section>",
        standing.readings,
        escaped(&standing.fitted_to)
    );
}

/// The stability table: each figure with its bound.
pub(super) fn stability(html: &mut String, run: &Run) {
    html.push_str(
        "<section id=\"stability\">\n<h2>Stability</h2>\n<div class=\"wide\"><table class=\"stack\">\n<thead><tr><th>Figure</th>\
         <th class=\"number\">Value</th><th>Should be</th><th></th><th>What it says</th></tr></thead>\n<tbody>\n",
    );
    for g in run.stability() {
        let (class, word) = match (g.holds, g.value.is_finite()) {
            (true, _) => ("good", "✓ holds"),
            (false, true) => ("bad", "✗ does not hold"),
            (false, false) => ("bad", "✗ not finite"),
        };
        let _ = writeln!(
            html,
            "<tr><th>{}</th><td class=\"number\">{}</td><td>{}</td><td><span class=\"state {class}\">{word}</span></td>\
             <td>{}</td></tr>",
            g.name,
            shown(&g),
            g.bound,
            g.about
        );
    }
    html.push_str("</tbody></table></div>\n</section>\n");
}

/// Names of the targets with the colours of their curves.
pub(super) fn target_legend(run: &Run) -> String {
    let entry = |(k, name): (usize, &String)| {
        let style = ["solid", "dashed", "dotted", "double", "dashed", "dotted"][k % 6];
        format!("<li><i style=\"border-color:var(--t{});border-style:{style}\"></i>{}</li>", k % 6, escaped(name))
    };
    format!("<ul class=\"legend\">{}</ul>", run.target_names.iter().enumerate().map(entry).collect::<String>())
}

/// Start position of each target, position at the deepest point, and displacement, mm.
pub(super) fn targets(run: &Run) -> String {
    let deepest = run.targets.iter().filter(|t| t.depth_m.is_finite()).max_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
    let depth = deepest.map_or_else(String::new, |t| format!("At {} mm deep", significant(1e3 * t.depth_m, 3)));
    let mut html = format!(
        "<div class=\"wide\"><table class=\"scroll named\">\n<thead><tr><th>x, y, z in mm</th><th class=\"number\">At the start</th>\
         <th class=\"number\">{depth}</th><th class=\"number\">Farthest by</th></tr></thead>\n<tbody>\n"
    );
    let place = |p: [f64; 3]| p.map(|c| format!("{:.2}", 1e3 * c + 0.0).replace('-', "−")).join(", ");
    for (k, name) in run.target_names.iter().enumerate() {
        let finite = |p: &[f64; 3]| p.iter().all(|c| c.is_finite());
        let path = || run.targets.iter().filter_map(|row| row.positions.get(k).copied().filter(finite));
        let Some(start) = path().next() else { continue };
        let moved = |p: [f64; 3]| (0..3).map(|c| (p[c] - start[c]).powi(2)).sum::<f64>().sqrt();
        let there = deepest.and_then(|row| row.positions.get(k).copied()).filter(finite);
        let _ = writeln!(
            html,
            "<tr><th>{}</th><td class=\"number\" data-name=\"At the start, mm\">{}</td><td class=\"number\" data-name=\"{depth}, mm\">{}</td>\
             <td class=\"number\" data-name=\"Farthest by\">{} mm</td></tr>",
            escaped(name),
            place(start),
            there.map_or_else(|| "–".to_owned(), place),
            significant(1e3 * path().map(moved).fold(0.0, f64::max), 3)
        );
    }
    html + "</tbody></table></div>"
}
