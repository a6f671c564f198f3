//! A run on one screen.

use std::fmt::Write as _;
use std::path::PathBuf;

use super::progress::{hundredths, newtons};
use needle_core::scene::Uncertain;
use needle_core::twin::Event;
use needle_estimate::compare::alignment::{Alignment, Found};
use needle_estimate::compare::ensemble::Ensemble;
use needle_estimate::compare::{Run, Verdict};

/// What a user wants to know of a run, at most one screen.
pub(super) fn summary(run: &Run, files: &[PathBuf]) -> String {
    let verdict = run.verdict();
    let mut lines = vec![
        ("verdict", verdict_line(run, &verdict)),
        (
            "scene",
            format!(
                "{}: {}, {} nodes, {} integration points",
                run.scene, run.method, run.nodes, run.integration_points
            ),
        ),
        ("poses", poses(run)),
        ("force", force(run)),
    ];
    if !run.dimension.is_empty() {
        lines.insert(2, ("model", format!("{}: {}", run.dimension, run.dimension_because)));
    }
    if let Some(error) = error(run) {
        lines.push(("error", error));
    }
    lines.extend(run.standing().map(|standing| ("baselines", standing.sentence())));
    lines.extend(run.alignment().map(|found| ("alignment", aligned(&found, [false; 3]))));
    lines.extend(run.ensemble.as_ref().map(|members| ("members", ensemble(run, members))));
    lines.extend(run.ensemble.as_ref().and_then(learnt).map(|keys| ("learnt", keys)));
    if let Some(radius_m) = run.effective_radius_m {
        lines.push(("needle", format!("effective radius {:.3} mm", 1e3 * radius_m)));
    }
    if let Some(deepest) = run.needle.iter().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m)) {
        let [x, y, z] = deepest.tip.map(|c| 1e3 * c);
        let aside = 1e3 * deepest.aside_m;
        lines.push(("tip", format!("{aside:.3} mm beside the straight needle's, at ({x:.3}, {y:.3}, {z:.3}) mm")));
    }
    if let Some(depth_m) = run.answers.iter().find_map(|a| a.event.and_then(Event::puncture_depth)) {
        lines.push(("puncture", format!("at {:.3} mm", 1e3 * depth_m)));
    }
    lines.extend(targets(run).map(|moved| ("targets", moved)));
    lines.push(("speed", speed(run)));
    lines.push(("health", health(run)));
    lines.push(("checksum", run.checksum.clone()));
    lines.extend(files.first().map(|first| ("files", written(first, files))));
    screen(&lines)
}

/// Labels and texts, a line each.
pub(super) fn screen(lines: &[(&str, String)]) -> String {
    let mut out = String::new();
    for (label, text) in lines {
        let _ = writeln!(out, "{label:>9}  {}", terminal::line(text)); // writing to a String can't fail
    }
    out
}

/// What a user must know first.
fn verdict_line(run: &Run, verdict: &Verdict) -> String {
    if run.diverged.is_some() {
        return "the model diverged".to_owned();
    }
    if run.answers.is_empty() {
        return "no pose was answered".to_owned();
    }
    let unstable = if run.unstable().is_empty() { "" } else { "; the stability table does not hold" };
    format!("{}{unstable}", verdict.line())
}

fn poses(run: &Run) -> String {
    let count = run.answers.len();
    let deepest = run.answers.iter().map(|a| a.depth_m).fold(0.0, f64::max);
    let mean = run.steps_per_pose().unwrap_or_default();
    let most = run.answers.iter().map(|a| a.steps).max().unwrap_or(0);
    format!("{count} answered, {mean:.1} steps each and at most {most}, to {:.3} mm", 1e3 * deepest)
}

fn force(run: &Run) -> String {
    let metrics = run.force_metrics();
    let newtons = |peak: Option<f64>| peak.map_or_else(|| "none".to_owned(), newtons);
    let word = if run.has_peak() { "peak predicted" } else { "no peak, since the run fails; largest predicted" };
    let error = run.model_error().map_or_else(String::new, |error| format!(" +- {:.4} N", error.force_max_n));
    let predicted = format!("{word} {}{error}", newtons(metrics.peak_predicted_n));
    match metrics.peak_measured_n {
        Some(_) => format!("{predicted}, measured {} ({})", newtons(metrics.peak_measured_n), run.measured_source),
        None => predicted,
    }
}

fn error(run: &Run) -> Option<String> {
    let metrics = run.force_metrics();
    let relative = metrics.nrmse.map_or_else(String::new, |n| format!(" ({:.1}% of the measured peak)", 1e2 * n));
    let vector = metrics.rmse_vector_n.zip(metrics.max_vector_error_n);
    let vector = vector
        .map_or_else(String::new, |(rmse, largest)| format!("; as a vector rmse {rmse:.4} N, largest {largest:.4} N"));
    Some(format!("rmse {:.4} N{relative}, largest {:.4} N{vector}", metrics.rmse_n?, metrics.max_abs_error_n?))
}

/// How far each target went from where it was at first: the farthest, since a retracted instrument leaves it there.
fn targets(run: &Run) -> Option<String> {
    let first = run.targets.first()?;
    let distance = |from: &[f64; 3], to: &[f64; 3]| -> f64 {
        from.iter().zip(to).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt()
    };
    let moved = run.target_names.iter().enumerate().map(|(i, name)| {
        let farthest =
            run.targets.iter().map(|row| distance(&first.positions[i], &row.positions[i])).fold(0.0, f64::max);
        format!("{name} moved {:.3} mm", 1e3 * farthest)
    });
    Some(moved.collect::<Vec<_>>().join(", ")).filter(|text| !text.is_empty())
}

/// What the measured force says of the keys.
fn learnt(ensemble: &Ensemble) -> Option<String> {
    let (_, found) = ensemble.assimilated.as_ref()?;
    let key = |(one, [mean, deviation]): (&Uncertain, &[f64; 2])| format!("{} {mean:.4e} ± {deviation:.1e}", one.key);
    let rejected = match found.rejected_blocks {
        0 => String::new(),
        n => format!("; {n} of {} blocks of readings rejected", found.blocks),
    };
    Some(ensemble.keys.iter().zip(&found.keys).map(key).collect::<Vec<_>>().join(", ") + &rejected)
}

/// What the members say.
fn ensemble(run: &Run, ensemble: &Ensemble) -> String {
    let width =
        ensemble.mean_width_n().map_or_else(|| "no band".to_owned(), |n| format!("95 % of them within {}", newtons(n)));
    let measured = run.share_inside();
    let inside =
        measured.map_or_else(String::new, |share| format!(", which holds {:.1} % of what was measured", 1e2 * share));
    let (used, members, runs) = (ensemble.used, ensemble.members, ensemble.runs);
    let of = if used == members { format!("{members}") } else { format!("{used} of {members}") };
    format!(
        "{of}, {width} on average{inside} ({} in {:.2} s)",
        if runs == 1 { "1 run".to_owned() } else { format!("{runs} runs") },
        ensemble.wall_s
    )
}

fn speed(run: &Run) -> String {
    let factor = run.real_time_factor().map_or_else(|| "-".to_owned(), hundredths);
    let step = run.step_us().map_or_else(String::new, |us| format!(", {us:.1} us per step"));
    format!(
        "real-time factor {factor} ({:.2} s in {:.2} s{step}, built in {:.2} s)",
        run.simulated_s, run.wall_s, run.build_s
    )
}

fn health(run: &Run) -> String {
    let verdict = if run.diverged.is_some() { "DIVERGED, " } else { "" };
    let repaired = match run.repaired_supports {
        0 => String::new(),
        n => format!(", {n} supports enlarged"),
    };
    format!(
        "{verdict}smallest J {:.3}, kinetic/strain energy {:.1e}, force imbalance {:.1}%{repaired}",
        run.min_jacobian,
        run.max_kinetic_to_strain_energy,
        1e2 * run.force_imbalance
    )
}

/// How the recording lies to the model, and which of contact, clock and zero were taken out.
pub(super) fn aligned(found: &Alignment, taken_out: [bool; 3]) -> String {
    let one = |what: &str, found: Found, unit: &str, taken: bool| {
        let error = found.error.map_or_else(|| "not known".to_owned(), |e| format!("{:.3}", 1e3 * e));
        let taken = if taken { ", taken out" } else { "" };
        format!("{what} {:.3} ± {error} {unit}{taken}", 1e3 * found.value + 0.0)
    };
    [
        one("contact at a recorded depth of", found.contact_depth_m, "mm", taken_out[0]),
        one("force late by", found.time_offset_s, "ms", taken_out[1]),
        one("load cell's zero", found.force_zero_n, "mN", taken_out[2]),
    ]
    .join("; ")
}

/// The folder of the first file, and the names of all.
pub(super) fn written(first: &std::path::Path, files: &[PathBuf]) -> String {
    let folder = first.parent().map(|p| p.display().to_string()).unwrap_or_default();
    let names: Vec<_> = files.iter().filter_map(|f| f.file_name()).map(|n| n.to_string_lossy()).collect();
    format!("{folder}: {}", names.join(", "))
}
