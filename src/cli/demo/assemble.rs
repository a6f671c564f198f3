//! What was heard on the network as a [`Run`], for the same report as every other run.

use needle_core::scene::Word as _;
use std::collections::BTreeMap;

use xxhash_rust::xxh3::Xxh3;

use crate::ros::observer::{Heard, Observations, PointFields};
use needle_core::scene::Scene;
use needle_core::twin::{Event, Phase};
use needle_estimate::compare::{Answer, FinalState, Occurrence, Run, Snapshot, TargetRow};
use needle_recording::ForceSeries;
use ros2_messages::needle_twin::{TissueEvent, TissueModel, TissueState, TwinStatus};

/// Snapshots that a report takes.
const SNAPSHOTS: usize = 96;

/// The run that was observed. `source` says what the measured force is.
pub(super) fn run(heard: &Observations, scene: &Scene, source: &str) -> Run {
    let dimension = scene.dimension();
    let mut run = Run {
        scene: scene.name.clone(),
        dimension: dimension.dimension.as_str().to_owned(),
        dimension_because: dimension.because,
        description: scene.description.clone(),
        target_names: scene.targets.iter().map(|t| t.name.clone()).collect(),
        instrument: scene.instrument,
        scene_toml: scene.to_toml(),
        command: "demo".to_owned(),
        accuracy: scene.accuracy,
        live: true,
        min_jacobian: 1.0,
        ..Run::default()
    };
    let Some(origin_ns) = heard.predicted.iter().map(|f| f.stamp_ns).min() else { return run };
    let seconds = |ns: i64| (ns - origin_ns) as f64 * 1e-9;
    if !heard.measured.is_empty() {
        source.clone_into(&mut run.measured_source);
    }
    run.answers = answers(heard, origin_ns);
    run.events = events(heard, origin_ns);
    run.simulated_s = run.answers.last().map_or(0.0, |a| a.time_s);
    run.targets = heard
        .targets
        .iter()
        .filter(|t| t.stamp_ns >= origin_ns)
        .map(|t| TargetRow {
            time_s: seconds(t.stamp_ns),
            depth_m: depth_at(&run.answers, seconds(t.stamp_ns)),
            positions: t.value.clone(),
        })
        .collect();
    health(&mut run, heard);
    if let Some(model) = &heard.model {
        tissue(&mut run, model, heard, origin_ns);
    }
    run.checksum = checksum(&run, heard);
    run
}

/// One answer per predicted force, with the depth of the pose that has its stamp.
fn answers(heard: &Observations, origin_ns: i64) -> Vec<Answer> {
    let poses: BTreeMap<i64, &Heard<f64>> = heard.depths.iter().map(|d| (d.stamp_ns, d)).collect();
    let seconds = |ns: i64| (ns - origin_ns) as f64 * 1e-9;
    let measured = ForceSeries::new(heard.measured.iter().map(|f| (seconds(f.stamp_ns), f.value)).collect());
    let mut status = heard.status.iter().peekable();
    let mut present: Option<&TwinStatus> = None;
    let mut puncture_said = false;
    let mut forces: Vec<&Heard<[f64; 3]>> = heard.predicted.iter().collect();
    forces.sort_by_key(|f| f.stamp_ns);
    forces
        .into_iter()
        .filter_map(|force| {
            let pose = poses.get(&force.stamp_ns)?;
            while let Some(next) = status.next_if(|s| s.stamp_ns <= force.stamp_ns) {
                present = Some(&next.value);
            }
            let event = present.filter(|s| s.punctured && !puncture_said).map(|s| {
                puncture_said = true;
                Event::Puncture { depth_m: s.puncture_depth_m, region: 0 }
            });
            Some(Answer {
                time_s: seconds(force.stamp_ns),
                depth_m: pose.value,
                // The demo's needle goes straight down: against its axis is up.
                predicted_n: force.value[2],
                measured_n: measured.at(seconds(force.stamp_ns)).map(|f| f[2]),
                predicted_vector_n: force.value,
                measured_vector_n: measured.at(seconds(force.stamp_ns)),
                // the share of the last status, of both parts
                model_error_n: present.map_or(f64::NAN, |s| {
                    let size = force.value.iter().map(|f| f * f).sum::<f64>().sqrt();
                    size * s.model_error.hypot(s.force_imbalance)
                }),
                phase: present.map_or(Phase::Approach, phase),
                event,
                steps: present.map_or(0, |s| s.steps_per_pose.round() as u32),
                // As a third program sees it: from hearing the pose to hearing its answer.
                latency_s: (force.received_ns - pose.received_ns).max(0) as f64 * 1e-9,
            })
        })
        .collect()
}

fn events(heard: &Observations, origin_ns: i64) -> Vec<Occurrence> {
    let occurrence = |e: &Heard<TissueEvent>| Occurrence {
        time_s: (e.stamp_ns - origin_ns) as f64 * 1e-9,
        kind: e.value.kind.clone(),
        region: e.value.region.clone(),
        depth_m: e.value.depth_m,
        force_before_n: e.value.force_before_n,
        force_after_n: e.value.force_after_n,
    };
    heard.events.iter().filter(|e| e.value.source == TissueEvent::MODEL).map(occurrence).collect()
}

fn phase(status: &TwinStatus) -> Phase {
    match status.phase {
        TwinStatus::PHASE_APPROACH => Phase::Approach,
        TwinStatus::PHASE_INDENTATION => Phase::Indentation,
        TwinStatus::PHASE_PENETRATION => Phase::Penetration,
        _ => Phase::Retraction,
    }
}

fn depth_at(answers: &[Answer], time_s: f64) -> f64 {
    let after = answers.partition_point(|a| a.time_s < time_s);
    answers.get(after).or(answers.last()).map_or(0.0, |a| a.depth_m)
}

fn health(run: &mut Run, heard: &Observations) {
    let peak = heard.status.iter().map(|s| s.value.predicted_n.abs()).fold(0.0, f64::max);
    // The status relates the imbalance to the peak so far, which is next to nothing at first contact.
    let (mut so_far, mut imbalance_n, mut imbalance_n2, mut statuses) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for Heard { value: status, .. } in heard.status.iter().filter(|s| s.value.poses_answered > 0) {
        run.min_jacobian = run.min_jacobian.min(status.min_jacobian);
        so_far = so_far.max(status.predicted_n.abs());
        imbalance_n = imbalance_n.max(status.force_imbalance * so_far);
        imbalance_n2 += (status.force_imbalance * so_far).powi(2);
        statuses += 1.0;
        run.note_folds(status.depth_m, status.folded_energy);
        run.constraint_error_m = run.constraint_error_m.max(status.constraint_error_m);
        if status.predicted_n.abs() >= 0.1 * peak {
            run.max_kinetic_to_strain_energy = run.max_kinetic_to_strain_energy.max(status.kinetic_to_strain_energy);
        }
    }
    if peak > 0.0 {
        run.force_imbalance = imbalance_n / peak;
        run.force_imbalance_rms = (imbalance_n2 / statuses).sqrt() / peak;
    }
    let Some(Heard { value: last, .. }) = heard.status.last() else { return };
    run.steps = last.steps;
    run.missed_deadlines = last.missed_deadlines;
    run.coalesced_poses = last.poses_coalesced;
    if last.health == TwinStatus::HEALTH_ERROR {
        run.diverged = Some(last.reasons.join("; "));
    }
    let number = |key: &str| heard.diagnostics.get(key).and_then(|v| v.parse::<f64>().ok());
    run.build_s = number("build (s)").unwrap_or(0.0);
    run.wall_s = number("stepping in all (s)").unwrap_or(0.0);
    run.effective_radius_m = number("effective radius (m)");
}

fn tissue(run: &mut Run, model: &TissueModel, heard: &Observations, origin_ns: i64) {
    run.method.clone_from(&model.method);
    // an axisymmetric model shows every node as a ring of points
    let nodes = heard.diagnostics.get("nodes").and_then(|n| n.parse().ok());
    run.nodes = nodes.unwrap_or(model.reference_points.len());
    run.integration_points = usize::try_from(model.integration_points).unwrap_or(0);
    let states: Vec<&Heard<TissueState>> =
        heard.tissue.iter().filter(|s| s.value.model_id == model.model_id && s.stamp_ns >= origin_ns).collect();
    let fields = |stamp_ns: i64| -> PointFields {
        heard.fields.iter().rev().find(|f| f.stamp_ns == stamp_ns).map(|f| f.value.clone()).unwrap_or_default()
    };
    let stride = states.len().div_ceil(SNAPSHOTS).max(1);
    let mut last_stamp = i64::MIN;
    run.snapshots = states
        .iter()
        .enumerate()
        .filter(|(i, _)| i % stride == 0 || i + 1 == states.len())
        .filter(|(_, s)| std::mem::replace(&mut last_stamp, s.stamp_ns) != s.stamp_ns)
        .map(|(_, s)| Snapshot {
            time_s: (s.stamp_ns - origin_ns) as f64 * 1e-9,
            depth_m: s.value.depth_m,
            displacement: displacement(&s.value),
            jacobian: fields(s.stamp_ns).jacobian,
            needle: Vec::new(),
        })
        .collect();
    let (triangles, cells) = (model.surface_triangles.chunks_exact(3), model.cells.chunks_exact(4));
    let last = states.last();
    let fields = last.map(|s| fields(s.stamp_ns)).unwrap_or_default();
    run.final_state = FinalState {
        points: model.reference_points.iter().map(|p| (*p).into()).collect(),
        surface: triangles.map(|t| [t[0], t[1], t[2]]).collect(),
        cells: cells.map(|c| [c[0], c[1], c[2], c[3]]).collect(),
        region: Vec::new(),
        displacement: last.map(|s| displacement(&s.value)).unwrap_or_default(),
        jacobian: fields.jacobian,
        von_mises_pa: fields.von_mises_pa,
    };
}

fn displacement(state: &TissueState) -> Vec<[f64; 3]> {
    state.displacements.iter().map(|u| (*u).into()).collect()
}

fn checksum(run: &Run, heard: &Observations) -> String {
    let mut hash = Xxh3::new();
    let mut forces: Vec<&Heard<[f64; 3]>> = heard.predicted.iter().collect();
    forces.sort_by_key(|f| f.stamp_ns);
    for component in forces.iter().flat_map(|f| f.value).chain(run.final_state.displacement.iter().flatten().copied()) {
        hash.update(&component.to_le_bytes());
    }
    format!("{:032x}", hash.digest128())
}
