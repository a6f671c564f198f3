//! `calibration.json`: the result of a calibration, for programs.

use super::metrics::{alignment_json, baselines_json, verdict_json};
use needle_estimate::calibrate::{Alternative, Calibration, Estimate, Prediction};
use serde_json::{Map, Value, json};

/// Content of `calibration.json`, as `calibrate --json` prints it. Keys are only ever added. A number that the data
/// don't determine is `null`; a number that is not finite is never written.
#[must_use]
pub fn calibration_json(calibration: &Calibration, source: &str, prediction: Option<&Prediction>) -> String {
    let (keys, beside) = calibration.estimates.split_at(calibration.keys);
    let group = |estimates: &[Estimate], prefix: &str| -> Map<String, Value> {
        let own = estimates.iter().filter(|e| e.name.starts_with(prefix));
        own.map(|e| (e.name.replacen(prefix, "", 1), estimate(e))).collect()
    };
    let names: Vec<&str> = calibration.estimates.iter().map(|e| e.name.as_str()).collect();
    let standing = calibration.standing();
    let no_effect: Vec<&str> = keys.iter().filter(|e| !e.has_effect).map(|e| e.name.as_str()).collect();
    let body = json!({
        "scene": calibration.scene.name,
        "measured_source": source,
        "fit": fit(calibration, group(keys, "")),
        "alternatives": calibration.alternatives.iter().map(alternative).collect::<Vec<Value>>(),
        "load_cell": group(beside, "load_cell."),
        "verdict": verdict_json(&calibration.verdict, standing.as_ref()),
        "baselines": baselines_json(standing.as_ref()),
        "rejected": calibration.rejected(),
        "alignment": alignment_json(calibration.alignment.as_ref()),
        "align": calibration.scene.align.map(|align| json!({
            "contact_depth_m": align.contact_depth.get(),
            "time_offset_s": align.time_offset.get(),
            "force_zero_n": align.zero_n,
            "force_drift_n_per_s": align.drift_n_per_s,
        })),
        "realigned": { "contact_depth_m": calibration.realigned[0], "time_offset_s": calibration.realigned[1] },
        "poses_refused": calibration.refused,
        "tied": calibration.tied.iter().cloned().collect::<std::collections::BTreeMap<_, _>>(),
        "rmse_n": calibration.rmse_n(),
        "readings": calibration.parts.fitted.len(),
        "left_out": calibration.left_out,
        "correlation": { "names": names, "matrix": calibration.correlation },
        "indistinguishable": calibration.indistinguishable,
        "drift_left_out_for": calibration.drift_left_out_for,
        "without_effect": no_effect,
        "hold_out": hold_out(calibration),
        "prediction": prediction.map(predicted),
        "converged": calibration.converged,
        "iterations": calibration.iterations,
        "runs": calibration.runs,
    });
    let mut text = format!("{body:#}");
    text.push('\n');
    text
}

/// The keys with intervals that hold what other assumptions give, too.
fn fit(calibration: &Calibration, mut keys: Map<String, Value>) -> Map<String, Value> {
    for (k, e) in calibration.estimates[..calibration.keys].iter().enumerate() {
        if let Some(Value::Object(key)) = keys.get_mut(&e.name) {
            key.insert("interval_95".to_owned(), json!(calibration.interval_95(k)));
            key.insert("interval_95_as_assumed".to_owned(), json!(e.interval_95()));
        }
    }
    keys
}

fn alternative(a: &Alternative) -> Value {
    json!({
        "assumed": a.what,
        "explains": a.verdict.explains.as_str(),
        "reduced_chi_square": a.verdict.reduced_chi_square.filter(|c| c.is_finite()),
        "fit": a.estimates.iter().map(|e| (e.name.clone(), estimate(e))).collect::<Map<String, Value>>(),
        "rmse_n": a.rmse_n,
        "runs": a.runs,
    })
}

fn estimate(e: &Estimate) -> Value {
    json!({
        "value": e.value,
        "standard_error": e.standard_error(),
        "interval_95": e.interval_95(),
        "noise_standard_error": e.noise_error.filter(|_| e.withheld.is_none()),
        "systematic_standard_error": e.systematic_error.filter(|_| e.withheld.is_none()),
        "no_interval_because": e.withheld,
        "start": e.start,
        // serde_json writes an infinite bound as null
        "bounds": e.bounds,
        "at_bound": e.at_bound(),
    })
}

fn hold_out(calibration: &Calibration) -> Option<Value> {
    let held = calibration.parts.held_out.clone()?;
    let peak = calibration.forces.measured_n[held.clone()].iter().map(|f| f.abs()).fold(0.0, f64::max);
    let rmse_n = calibration.held_out_rmse_n()?;
    Some(json!({
        "fitted_readings": calibration.parts.fitted.len(),
        "fitted_rmse_n": calibration.rmse_n(),
        "predicted_readings": held.len(),
        "predicted_rmse_n": rmse_n,
        "predicted_nrmse": ratio(rmse_n, peak),
    }))
}

fn predicted(p: &Prediction) -> Value {
    json!({
        "measured_source": p.source,
        "scene": p.scene,
        "carried": p.carried,
        "left": p.left,
        "offset_n": p.offset_n,
        "rmse_n": p.rmse_n,
        "nrmse": ratio(p.rmse_n, p.peak_n),
        "rmse_before_n": p.rmse_before_n,
        "nrmse_before": ratio(p.rmse_before_n, p.peak_n),
    })
}

fn ratio(a: f64, b: f64) -> Option<f64> {
    (b > 0.0).then(|| a / b)
}
