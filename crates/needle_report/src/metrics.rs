//! `metrics.json`: the figures of merit of a run, for programs.

use needle_core::scene::Uncertain;
use needle_core::twin::Event;
use needle_estimate::baseline::{Against, Baseline, Standing};
use needle_estimate::compare::alignment::{Alignment, Found};
use needle_estimate::compare::crossing::{self, Crossing};
use needle_estimate::compare::ensemble::assimilate::{Forecast, HORIZON_S};
use needle_estimate::compare::ensemble::{Band, Ensemble, Spread};
use needle_estimate::compare::{ForceMetrics, Occurrence, Run, Verdict};
use serde_json::{Map, Value, json};

/// Content of `metrics.json`: counts, force, timing, stability, checksum. Keys are only ever added.
///
/// A figure that is not available is `null`, and `null_because` states the reason under its dotted key. A number that
/// is not finite is never written.
#[must_use]
pub fn metrics_json(run: &Run) -> String {
    let mut nulls = Nulls { run, because: Map::new() };
    let standing = run.standing();
    if standing.is_none() {
        let because = "too little was measured before and after half of the insertion";
        nulls.because.insert("baselines".to_owned(), Value::from(because));
    }
    let mut body = json!({
        "scene": run.scene,
        "method": run.method,
        "dimension": run.dimension,
        "dimension_because": run.dimension_because,
        "nodes": run.nodes,
        "integration_points": run.integration_points,
        "poses": run.answers.len(),
        "steps": run.steps,
        "steps_per_pose": nulls.steps_per_pose(),
        "force": nulls.force(),
        "model_error": nulls.model_error(),
        "timing": nulls.timing(),
        "stability": nulls.stability(),
        "effective_radius_m":
            nulls.number("effective_radius_m", run.effective_radius_m, "the instrument is no needle"),
        "needle": needle(run),
        "puncture_depth_m": nulls.puncture_depth(),
        "events": events(run),
        "measured_events": measured_events(run),
        "measured_source": run.measured_source,
        "losses": run.losses,
        "verdict": verdict_json(&run.verdict(), standing.as_ref()),
        "baselines": baselines_json(standing.as_ref()),
        "alignment": alignment_json(run.alignment().as_ref()),
        "checksum": run.checksum,
        "null_because": nulls.because,
    });
    if let (Some(ensemble), Some(entries)) = (&run.ensemble, body.as_object_mut()) {
        entries.insert("ensemble".to_owned(), ensemble_json(run, ensemble));
    }
    let mut text = format!("{body:#}");
    text.push('\n');
    text
}

/// A needle that bends where its driver was deepest, and how far its tip was from that of the straight needle at most; null for another
/// instrument.
fn needle(run: &Run) -> Value {
    let Some(deepest) = run.needle.iter().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m)) else { return Value::Null };
    let aside = run.needle.iter().map(|row| row.aside_m).fold(0.0, f64::max);
    json!({
        "deepest": {
            "depth_m": deepest.depth_m,
            "tip_m": deepest.tip,
            "aside_m": deepest.aside_m,
            "force_n": deepest.force_n,
            "torque_nm": deepest.torque_nm,
        },
        "largest_aside_m": aside,
    })
}

/// Converts figures to JSON and records the reason of each null.
struct Nulls<'a> {
    run: &'a Run,
    because: Map<String, Value>,
}

impl Nulls<'_> {
    fn number(&mut self, key: &str, value: Option<f64>, because: &str) -> Value {
        let number = value.and_then(serde_json::Number::from_f64);
        if number.is_none() {
            let reason = if value.is_some() { "not a finite number" } else { because };
            self.because.insert(key.to_owned(), Value::from(reason));
        }
        number.map_or(Value::Null, Value::Number)
    }

    fn force(&mut self) -> Value {
        let m: ForceMetrics = self.run.force_metrics();
        let unmeasured = "no measured force at the time of a prediction";
        let one_axis = "the load cell measured no more than one component";
        let peak = self.run.has_peak();
        json!({
            "peak_predicted_n": self.number(
                "force.peak_predicted_n",
                m.peak_predicted_n.filter(|_| peak),
                if peak { "no finite prediction" } else { "the run fails: its largest force is no peak (largest_predicted_n)" },
            ),
            "largest_predicted_n": self.number("force.largest_predicted_n", m.peak_predicted_n, "no finite prediction"),
            "peak_measured_n": self.number("force.peak_measured_n", m.peak_measured_n, unmeasured),
            "rmse_n": self.number("force.rmse_n", m.rmse_n, unmeasured),
            "nrmse": self.number("force.nrmse", m.nrmse, "no measured force that differs from zero"),
            "max_abs_error_n": self.number("force.max_abs_error_n", m.max_abs_error_n, unmeasured),
            "rmse_vector_n": self.number("force.rmse_vector_n", m.rmse_vector_n, one_axis),
            "max_vector_error_n": self.number("force.max_vector_error_n", m.max_vector_error_n, one_axis),
        })
    }

    /// Estimated error of force and targets, over all poses.
    fn model_error(&mut self) -> Value {
        let error = self.run.model_error();
        let unknown = "no pose was answered by a twin";
        json!({
            "force_rms_n": self.number("model_error.force_rms_n", error.map(|e| e.force_rms_n), unknown),
            "force_max_n": self.number("model_error.force_max_n", error.map(|e| e.force_max_n), unknown),
            "targets_rms_m":
                self.number("model_error.targets_rms_m", error.and_then(|e| e.targets_rms_m), "the scene has no targets"),
        })
    }

    fn timing(&mut self) -> Value {
        let run = self.run;
        let latency = run.latency_ms();
        let unstepped = "no step was taken";
        let unanswered = "no pose was answered";
        json!({
            "build_s": self.number("timing.build_s", Some(run.build_s), ""),
            "wall_s": self.number("timing.wall_s", Some(run.wall_s), ""),
            "simulated_s": self.number("timing.simulated_s", Some(run.simulated_s), ""),
            "real_time_factor": self.number("timing.real_time_factor", run.real_time_factor(), unstepped),
            "step_us": self.number("timing.step_us", run.step_us(), unstepped),
            "pose_latency_ms": {
                "p50": self.number("timing.pose_latency_ms.p50", latency.map(|l| l.p50), unanswered),
                "p99": self.number("timing.pose_latency_ms.p99", latency.map(|l| l.p99), unanswered),
                "max": self.number("timing.pose_latency_ms.max", latency.map(|l| l.max), unanswered),
            },
            "missed_deadlines": run.missed_deadlines,
            "coalesced_poses": run.coalesced_poses,
        })
    }

    fn stability(&mut self) -> Value {
        let run = self.run;
        json!({
            "diverged": run.diverged.is_some(),
            "divergence": run.diverged,
            "recoveries": run.recoveries,
            "repaired_supports": run.repaired_supports,
            "min_jacobian": self.number("stability.min_jacobian", Some(run.min_jacobian), ""),
            "max_kinetic_to_strain_energy":
                self.number("stability.max_kinetic_to_strain_energy", Some(run.max_kinetic_to_strain_energy), ""),
            "force_imbalance": self.number("stability.force_imbalance", Some(run.force_imbalance), ""),
            "force_imbalance_rms": self.number("stability.force_imbalance_rms", Some(run.force_imbalance_rms), ""),
            "step_error_rms": self.number("stability.step_error_rms", run.step_error_rms, "the run is known by its messages alone"),
            "folded_energy": self.number("stability.folded_energy", Some(run.folded_energy), ""),
            "folded_from_m": run.folded_from_m.filter(|d| d.is_finite()),
            "constraint_error_m": self.number("stability.constraint_error_m", Some(run.constraint_error_m), ""),
        })
    }

    fn steps_per_pose(&mut self) -> Value {
        json!({
            "mean": self.number("steps_per_pose.mean", self.run.steps_per_pose(), "no pose was answered"),
            "max": self.run.answers.iter().map(|a| a.steps).max(),
        })
    }

    fn puncture_depth(&mut self) -> Value {
        let depth = self.run.answers.iter().find_map(|a| a.event.and_then(Event::puncture_depth));
        self.number("puncture_depth_m", depth, "the surface was not punctured")
    }
}

/// Events in the tissue: kind, location, and the predicted force before and after.
fn events(run: &Run) -> Value {
    let finite = |x: f64| Some(x).filter(|x| x.is_finite());
    let event = |e: &Occurrence| {
        json!({
            "kind": e.kind,
            "region": e.region,
            "depth_m": finite(e.depth_m),
            "time_s": finite(e.time_s),
            "force_before_n": finite(e.force_before_n),
            "force_after_n": finite(e.force_after_n),
        })
    };
    run.events.iter().map(event).collect()
}

/// Ruptures of membranes, detected from the measured force alone.
fn measured_events(run: &Run) -> Value {
    let event = |c: &Crossing| {
        json!({
            "kind": "puncture",
            "depth_m": c.depth_m,
            "time_s": c.time_s,
            "seen_s": c.seen_s,
            "force_before_n": c.force_before_n,
            "force_after_n": c.force_after_n,
        })
    };
    crossing::in_run(run).iter().map(event).collect()
}

/// Results of the ensemble, for runs that have one.
fn ensemble_json(run: &Run, ensemble: &Ensemble) -> Value {
    let finite = |x: Option<f64>| x.filter(|x| x.is_finite());
    let key = |one: &Uncertain| {
        json!({
            "key": one.key,
            "prior": one.prior.word(),
            "mean": one.prior.mean(),
            "standard_deviation": one.prior.standard_deviation(),
        })
    };
    let target = |(name, spread): (&String, &Spread)| {
        let deviation: [f64; 3] = std::array::from_fn(|k| spread.covariance_m2[k][k].sqrt());
        json!({ "name": name, "mean_m": spread.mean_m, "standard_deviation_m": deviation })
    };
    json!({
        "members": ensemble.members,
        "left_out": ensemble.members - ensemble.used,
        "runs": ensemble.runs,
        "seed": ensemble.seed,
        "keys": ensemble.keys.iter().map(key).collect::<Vec<_>>(),
        "band_shares": Band::SHARES,
        "band_mean_width_n": finite(ensemble.mean_width_n()),
        "measured_share_inside": finite(run.share_inside()),
        "target_depth_m": ensemble.target_depth_m,
        "targets": run.target_names.iter().zip(&ensemble.targets).map(target).collect::<Vec<_>>(),
        "assimilated": assimilated_json(run, ensemble),
        "wall_s": ensemble.wall_s,
    })
}

/// Result of the data assimilation for the keys, and the quality of its forecasts; null without a measured force.
fn assimilated_json(run: &Run, ensemble: &Ensemble) -> Value {
    let Some((answers, found)) = &ensemble.assimilated else { return Value::Null };
    let finite = |x: f64| Some(x).filter(|x| x.is_finite());
    let key = |(one, [mean, deviation]): (&Uncertain, &[f64; 2])| json!({ "key": one.key, "mean": finite(*mean), "standard_deviation": finite(*deviation) });
    let held = |(i, forecast): (&usize, &Option<Forecast>)| {
        let (measured, band) = (run.answers[*i].measured_n?, (*forecast)?.band());
        Some([f64::from(u8::from(band.holds(measured))), band.high_n - band.low_n])
    };
    let held: Vec<[f64; 2]> = answers.iter().zip(&found.forecasts).filter_map(held).collect();
    let mean = |k: usize| finite(held.iter().map(|row| row[k]).sum::<f64>() / held.len() as f64);
    json!({
        "horizon_s": HORIZON_S,
        "readings": answers.len(),
        "forecast_share_inside": mean(0),
        "forecast_mean_width_n": mean(1),
        "blocks": found.blocks,
        "rejected_blocks": found.rejected_blocks,
        "tracked_blocks": found.tracked_blocks,
        "rejected_tracked_blocks": found.rejected_tracked_blocks,
        "keys": ensemble.keys.iter().zip(&found.keys).map(key).collect::<Vec<_>>(),
    })
}

/// The verdict in the format of `metrics.json` and `calibration.json`.
pub(super) fn verdict_json(verdict: &Verdict, standing: Option<&Standing>) -> Value {
    let finite = |x: Option<f64>| x.filter(|x| x.is_finite());
    let shares: Vec<f64> = verdict.share_over_depth.iter().copied().filter(|s| s.is_finite()).collect();
    json!({
        "explains": verdict.explains.as_str(),
        "reasons": verdict.reasons,
        "reduced_chi_square": finite(verdict.reduced_chi_square),
        "residual_autocorrelation": finite(verdict.autocorrelation),
        "noise_n": finite(verdict.noise_n),
        "residual_share_over_depth": shares,
        "against_baselines": standing.map_or(Against::NoMeasurement, Standing::against).as_str(),
    })
}

/// Errors of the baselines, each with that of the twin over the same readings.
pub(super) fn baselines_json(standing: Option<&Standing>) -> Value {
    let entry = |standing: &Standing, baseline: &Baseline| {
        json!({
            "name": baseline.name,
            "fitted_to": standing.fitted_to,
            "predicted": standing.predicted,
            "readings": standing.readings,
            "rmse_n": baseline.rmse_n,
            "twin_rmse_n": standing.twin_rmse_n,
            "twin_scaled_rmse_n": standing.scaled_rmse_n,
        })
    };
    let all = |standing: &Standing| standing.baselines.iter().map(|b| entry(standing, b)).collect::<Vec<Value>>();
    Value::from(standing.map(all).unwrap_or_default())
}

/// Alignment of the recording with the model; null if it is not available.
pub(super) fn alignment_json(alignment: Option<&Alignment>) -> Value {
    let mut entries = Map::new();
    let mut add = |name: &str, found: Option<Found>| {
        let finite = |x: Option<f64>| x.filter(|x| x.is_finite());
        entries.insert(name.to_owned(), json!(finite(found.map(|f| f.value))));
        entries.insert(format!("{name}_standard_error"), json!(finite(found.and_then(|f| f.error))));
    };
    add("contact_depth_m", alignment.map(|a| a.contact_depth_m));
    add("time_offset_s", alignment.map(|a| a.time_offset_s));
    add("force_zero_n", alignment.map(|a| a.force_zero_n));
    Value::Object(entries)
}
