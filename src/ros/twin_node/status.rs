//! The node's reports: `status`, `/diagnostics`, and the lines about missing inputs.

use std::time::Instant;

use super::answer::Model;
use super::declared::Settings;
use super::judgement::{Around, Judgement, load_cell_problem};
use super::shared::{Identified, Live, Shared};
use super::solver::LOST_ANSWERS;
use needle_core::twin::Phase;
use ros2_guarded::Health;
use ros2_messages::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use ros2_messages::needle_twin::{ForceComparison, TwinStatus};
use ros2_messages::std_msgs::Header;
use ros2_node::environment::Reach;
use ros2_node::lifecycle::State;
use ros2_node::participant::Wish;

fn phase(phase: Phase) -> u8 {
    match phase {
        Phase::Approach => TwinStatus::PHASE_APPROACH,
        Phase::Indentation => TwinStatus::PHASE_INDENTATION,
        Phase::Penetration => TwinStatus::PHASE_PENETRATION,
        Phase::Retraction => TwinStatus::PHASE_RETRACTION,
    }
}

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

#[allow(clippy::cast_precision_loss)] // counts of one second
pub(super) fn status(
    live: &Live,
    judgement: &Judgement,
    model: Option<&Model>,
    frame_id: &str,
    instance: &str,
) -> TwinStatus {
    let window = &live.last_window;
    let mut message = TwinStatus {
        header: Header { stamp: live.last.map(|a| a.stamp).unwrap_or_default(), frame_id: frame_id.to_owned() },
        scene: model.map(|m| m.scene.clone()).unwrap_or_default(),
        model_id: model.map_or(0, |m| m.id),
        prediction_valid: judgement.vouches(),
        health: judgement.health,
        reasons: judgement.reasons.clone(),
        punctured: live.puncture_depth_m.is_some(),
        puncture_depth_m: live.puncture_depth_m.unwrap_or(0.0),
        poses_received: live.received,
        poses_answered: live.answered,
        poses_rejected: live.rejected,
        poses_coalesced: live.coalesced,
        missed_deadlines: live.missed,
        steps: live.steps,
        steps_per_pose: ratio(window.steps as f64, window.answered as f64),
        step_s: ratio(window.stepping_s, window.steps as f64),
        pose_rate_hz: ratio(window.received as f64, window.seconds),
        real_time_factor: ratio(window.input_s, window.stepping_s),
        latency_p50_s: live.total.quantile(0.5),
        latency_p99_s: live.total.quantile(0.99),
        latency_max_s: live.total.max(),
        instance: instance.to_owned(),
        region: live.region().to_owned(),
        model: model.map_or_else(String::new, |model| model.dimension.clone()),
        model_error: model.map_or(0.0, |model| model.error),
        ..TwinStatus::default()
    };
    let predicted = live.last.as_ref().and_then(|a| a.boundaries_m);
    message.region_depths_predicted = predicted.is_some();
    for (i, (name, depth_m)) in live.along.stretches().enumerate() {
        let now = predicted.and_then(|depths| depths.get(i).copied()).filter(|d| d.is_finite());
        message.region_names.push(name.to_owned());
        message.region_depths_m.push(now.unwrap_or(depth_m));
    }
    if let Some(answer) = &live.last {
        let p = &answer.prediction;
        message.phase = phase(p.phase);
        message.depth_m = p.depth_m;
        message.predicted_n = answer.predicted_n();
        message.min_jacobian = p.health.min_jacobian;
        message.kinetic_to_strain_energy = p.health.kinetic_to_strain_energy;
        message.force_imbalance = p.health.force_imbalance;
        message.constraint_error_m = p.health.constraint_error_m;
        message.folded_energy = p.health.folded_energy;
        if p.health.discretisation_error > 0.0 {
            message.model_error = p.health.discretisation_error;
        }
    }
    message
}

pub(super) fn diagnostics(
    shared: &Shared,
    judgement: &Judgement,
    model: Option<&Model>,
    node: &str,
    wishes: &[Wish],
    around: &Around,
    middleware: &Health,
) -> DiagnosticArray {
    let settings = shared.settings();
    let live = shared.lock();
    let level = match judgement.health {
        TwinStatus::HEALTH_OK => DiagnosticStatus::OK,
        TwinStatus::HEALTH_WARN => DiagnosticStatus::WARN,
        TwinStatus::HEALTH_STALE => DiagnosticStatus::STALE,
        _ => DiagnosticStatus::ERROR,
    };
    let name = node.trim_start_matches('/');
    let one = |what: &str, level, message: String, values: Vec<KeyValue>| DiagnosticStatus {
        level,
        name: format!("{name}: {what}"),
        message,
        hardware_id: settings.hardware_id.clone(),
        values,
    };
    let message = if judgement.reasons.is_empty() { "OK".to_owned() } else { judgement.reasons.join("; ") };
    let cell = load_cell_problem(&live);
    let mut status = vec![
        one("prediction", level, message, prediction_values(&live, model)),
        one("input", input_level(&live, shared, &settings, around), input_message(&live, wishes), input_values(&live)),
        one(
            "load cell",
            if cell.is_some() { DiagnosticStatus::WARN } else { DiagnosticStatus::OK },
            cell.unwrap_or(if live.measured == 0 { "none heard (it is optional)" } else { "OK" }).to_owned(),
            load_cell_values(&live),
        ),
    ];
    status.push(middleware.diagnostic(name, &settings.hardware_id));
    if let Some(identified) = &live.identified {
        let frozen = identified.state == ForceComparison::IDENTIFICATION_FROZEN;
        let level = if frozen { DiagnosticStatus::WARN } else { DiagnosticStatus::OK };
        status.push(one("identification", level, identification_message(identified), identified_values(identified)));
    }
    DiagnosticArray { header: Header { stamp: shared.clock.stamp(), frame_id: String::new() }, status }
}

fn value(key: &str, value: impl std::fmt::Display) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}

fn milliseconds(key: &str, seconds: f64) -> KeyValue {
    value(key, format!("{:.3}", seconds * 1e3))
}

fn prediction_values(live: &Live, model: Option<&Model>) -> Vec<KeyValue> {
    let mut values = vec![
        value("answered", live.answered),
        value("missed deadlines", live.missed),
        value("coalesced poses", live.coalesced),
        value("withheld", live.withheld),
        value("not finite", live.not_finite),
        value("lost answers", LOST_ANSWERS.load(std::sync::atomic::Ordering::Relaxed)),
        milliseconds("latency p50 (ms)", live.total.quantile(0.5)),
        milliseconds("latency p95 (ms)", live.total.quantile(0.95)),
        milliseconds("latency p99 (ms)", live.total.quantile(0.99)),
        milliseconds("latency max (ms)", live.total.max()),
        value("stepping in all (s)", format!("{:.6}", live.stepping_s)),
        milliseconds("queue p99 (ms)", live.queue.quantile(0.99)),
        milliseconds("stepping p50 (ms)", live.stepping.quantile(0.5)),
        milliseconds("stepping p99 (ms)", live.stepping.quantile(0.99)),
    ];
    if let Some(answer) = &live.last {
        values.push(value("region", live.region()));
        values.push(value("displacements computed", answer.work.displacements));
        values.push(value("targets computed", answer.work.targets));
        values.push(value("volume ratios computed", answer.work.volume_ratios));
        values.push(value("stresses computed", answer.work.stresses));
    }
    if let Some(model) = model {
        values.push(value("scene", &model.scene));
        values.push(value("model", &model.dimension));
        values.push(value("nodes", model.nodes));
        values.push(value("integration points", model.integration_points));
        values.push(value("build (s)", format!("{:.3}", model.build.as_secs_f64())));
        values.extend(model.effective_radius.map(|r| value("effective radius (m)", format!("{r:.6e}"))));
    }
    values
}

fn input_level(live: &Live, shared: &Shared, settings: &Settings, around: &Around) -> u8 {
    match live.silence_s(&shared.clock, around.clock_gone) {
        Some(silent) if silent <= settings.input_timeout_s => {
            if live.last_window.rejected > 0 {
                DiagnosticStatus::WARN
            } else {
                DiagnosticStatus::OK
            }
        }
        _ => DiagnosticStatus::STALE,
    }
}

#[allow(clippy::cast_precision_loss)]
fn input_message(live: &Live, wishes: &[Wish]) -> String {
    let window = &live.last_window;
    if live.last_pose.is_none() {
        return format!(
            "waiting for {}",
            wishes.iter().take(2).map(|w| w.topic.as_str()).collect::<Vec<_>>().join(" or ")
        );
    }
    format!("{:.1} poses per second", ratio(window.received as f64, window.seconds))
}

fn input_values(live: &Live) -> Vec<KeyValue> {
    let mut values = vec![
        value("received", live.received),
        value("rejected", live.rejected),
        milliseconds("input age p50 (ms)", live.input_age.quantile(0.5)),
        milliseconds("input age p99 (ms)", live.input_age.quantile(0.99)),
    ];
    values.push(value("times without a pose", live.gaps.count));
    values.push(value("longest of them (s)", format!("{:.3}", live.gaps.longest_s)));
    values.push(value("way not seen (m)", format!("{:.6}", live.gaps.unseen_m)));
    values.extend(live.rejects.iter().map(|(why, n)| value(&format!("rejected: {}", why.word()), n)));
    values
}

fn load_cell_values(live: &Live) -> Vec<KeyValue> {
    let mut values = vec![value("readings", live.measured)];
    values.push(value("verdict", live.verdict.line()));
    if let Some((residual, rmse, max)) = live.residual {
        values.push(value("residual (N)", format!("{residual:.6}")));
        values.push(value("rmse (N)", format!("{rmse:.6}")));
        values.push(value("largest error (N)", format!("{max:.6}")));
    }
    if let Some(so_far) = &live.against_spring {
        values.push(value("against a spring", so_far.words()));
    }
    values
}

fn identification_message(identified: &Identified) -> String {
    match identified.state {
        ForceComparison::IDENTIFICATION_FROZEN => format!("stopped: {}", identified.reason),
        ForceComparison::IDENTIFICATION_CONVERGED => "OK".to_owned(),
        _ => "learning".to_owned(),
    }
}

fn identified_values(identified: &Identified) -> Vec<KeyValue> {
    let both = |(name, v, e): &(String, f64, f64)| {
        [value(name, format!("{v:.6}")), value(&format!("{name}: standard error"), format!("{e:.6}"))]
    };
    identified.values.iter().flat_map(both).collect()
}

/// The missing inputs, if any: topics, types, QoS and numbers of publishers.
pub(super) fn waiting(
    live: &Live,
    shared: &Shared,
    wishes: &[Wish; 4],
    since: Instant,
    reach: Reach,
) -> Option<String> {
    let clock = &shared.clock;
    if shared.state() != State::Active {
        let state = shared.state().label();
        return (shared.state() != State::Configuring)
            .then(|| format!("{state}: waiting for a lifecycle manager (~/change_state)"));
    }
    let [joint, pose, _, time] = wishes;
    let describe = |w: &Wish| {
        let who = match w.publishers() {
            0 => "nobody publishes it".to_owned(),
            1 => "1 publisher".to_owned(),
            n => format!("{n} publishers"),
        };
        format!("{} ({}, {}; {who})", w.topic, w.type_name, w.qos)
    };
    if clock.is_simulated() && clock.now_nanos().is_none() {
        return Some(format!("use_sim_time is set: waiting for {}", describe(time)));
    }
    let stands = live.last_clock.is_some_and(|at| at.elapsed().as_secs_f64() > 5.0);
    if clock.is_simulated() && stands {
        return Some(format!("simulated time stands still: waiting for {}", describe(time)));
    }
    let silent = live.last_pose.is_none_or(|at| at.wall.elapsed().as_secs_f64() > 5.0);
    // A peer on another machine is not received: the most likely cause.
    let deaf = reach == Reach::Localhost && joint.publishers() + pose.publishers() == 0;
    let hint = "; this node hears this machine only, ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET opens the network";
    (silent && since.elapsed().as_secs_f64() > 1.0).then(|| {
        format!("waiting for a pose on {} or {}{}", describe(joint), describe(pose), if deaf { hint } else { "" })
    })
}
