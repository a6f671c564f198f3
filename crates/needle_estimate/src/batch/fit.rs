//! Converts the result of a replay or a calibration to a fit of a row.

use super::{Candidate, Fit, HeldOut, Key};
use crate::calibrate::Calibration;
use crate::compare::{self, Curve, Run};
use needle_recording::{At, Reading};

/// Number of readings at the end of the predicted part. Their mean is the force there.
const AT_THE_END: usize = 5;

pub(super) fn replayed(candidate: &Candidate, run: &Run) -> Fit {
    let verdict = run.verdict();
    let aligned = run.alignment().unwrap_or_default();
    let rows = compare::rows::Rows::of(run);
    Fit {
        candidate: candidate.name.clone(),
        scene: run.scene.clone(),
        failed: run.diverged.clone(),
        explains: verdict.explains.as_str().to_owned(),
        reduced_chi_square: verdict.reduced_chi_square,
        reasons: verdict.reasons,
        keys: Vec::new(),
        contact_depth_m: aligned.contact_depth_m.value,
        force_zero_n: rows.zero_n,
        peak_n: rows.measured_n.iter().map(|f| f.abs()).fold(0.0, f64::max),
        rmse_n: run.force_metrics().rmse_n,
        forward_error: None,
        runs: 1,
        held_out: None,
        standing: run.standing(),
        curve: Curve::of(&rows.depth_m, &rows.measured_n, &rows.predicted_n),
    }
}

/// Recorded depth at a time since the first reading, m. The depths of a calibration can't be used: they contain the
/// contact shift that was found.
fn recorded_depth(readings: &[Reading], time_s: f64) -> f64 {
    let begin = readings.first().map_or(0.0, |r| r.time_s);
    let depth = |r: &Reading| if let At::Depth(depth_m) = r.at { depth_m } else { 0.0 };
    let next = readings.partition_point(|r| r.time_s - begin < time_s).clamp(1, readings.len().max(2) - 1);
    let (Some(a), Some(b)) = (readings.get(next - 1), readings.get(next)) else { return 0.0 };
    let share = ((time_s - (a.time_s - begin)) / (b.time_s - a.time_s)).clamp(0.0, 1.0);
    depth(a) + share * (depth(b) - depth(a))
}

pub(super) fn calibrated(candidate: &Candidate, found: &Calibration, readings: &[Reading]) -> Fit {
    let keys = found.estimates[..found.keys].iter().map(|e| Key {
        key: e.name.clone(),
        value: e.value,
        standard_error: e.standard_error(),
        noise_error: e.noise_error,
    });
    let aligned = found.alignment.unwrap_or_default();
    // subtract the contact depth only if the calibration corrected the recording for it
    let contact = if found.realigned[0] { aligned.contact_depth_m.value } else { 0.0 };
    let forces = &found.forces;
    // measured force without the estimated zero and drift of the load cell
    let less_zero: Vec<f64> =
        (0..forces.model_n.len()).map(|i| forces.measured_n[i] - (forces.fitted_n[i] - forces.model_n[i])).collect();
    let recorded: Vec<f64> = forces.time_s.iter().map(|t| recorded_depth(readings, *t)).collect();
    let depth: Vec<f64> = recorded.iter().map(|d| d - contact).collect();
    let peak_n = less_zero[found.parts.fitted.clone()].iter().map(|f| f.abs()).fold(0.0, f64::max);
    let mean = |of: &[f64], end: usize| {
        let from = end.saturating_sub(AT_THE_END);
        of[from..end].iter().sum::<f64>() / (end - from).max(1) as f64
    };
    let held_out = found.parts.held_out.clone().filter(|held| !held.is_empty()).map(|held| HeldOut {
        rmse_n: found.held_out_rmse_n().unwrap_or(0.0),
        end_depth_m: mean(&recorded, held.end),
        end_measured_n: mean(&less_zero, held.end),
        end_predicted_n: mean(&forces.model_n, held.end),
    });
    Fit {
        candidate: candidate.name.clone(),
        scene: found.scene.name.clone(),
        failed: None,
        explains: found.verdict.explains.as_str().to_owned(),
        reduced_chi_square: found.verdict.reduced_chi_square,
        reasons: found.verdict.reasons.clone(),
        keys: keys.collect(),
        contact_depth_m: contact,
        force_zero_n: less_zero.first().map_or(0.0, |f| forces.measured_n[0] - f),
        peak_n,
        rmse_n: Some(found.rmse_n()),
        forward_error: None,
        runs: found.runs,
        held_out,
        standing: found.standing(),
        curve: Curve::of(&depth, &less_zero, &forces.model_n),
    }
}
