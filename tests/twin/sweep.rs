//! Every key over its whole allowed range, alone and in pairs: the force is right, or the scene is refused, or the health says so.
//!
//! The short run is a part of the tests. The long one, `SWEEP=10000 cargo test --release --test twin sweep -- --ignored --nocapture`,
//! says of each scene that fails which it is, and its count stands in `docs/lab/faults.md`.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::sync::mpsc;
use std::time::{Duration, Instant};

use crate::coarse::alone;
use crate::common::random::Random;
use needle_twin::scene::{Kind, Override, Scene, keys};
use needle_twin::twin::{Halt, StampedPose, Twin};

/// Nodes of a model that is swept over.
const NODES: f64 = 3000.0;
/// Wall time after which a scene has shown enough, s; a pose on a busy machine may cost many times that.
const ENOUGH_S: f64 = 4.0;
/// Time after which a scene hangs.
const HANGS: Duration = Duration::from_secs(240);
/// Poses of an insertion.
const POSES: u32 = 60;
/// Gap between the forces on instrument and base, over the peak, from which the health says that a force at rest is none.
const LOUD: f64 = 0.05;

#[derive(Debug, PartialEq)]
enum Outcome {
    /// By the scene, or by the build.
    Refused,
    /// Larger than what is swept over, or slower.
    Skipped,
    /// The twin said that it can't.
    Halted,
    /// The health says it: imbalance, energy or recoveries.
    Loud,
    /// Force at rest, N.
    Force(f64),
}

fn base(preset: &str) -> Scene {
    let mut keys = vec![
        ("discretisation.spacing_m", "0.004"),
        ("discretisation.edge_refinement", "0.5"),
        ("motion.depth_m", "0.0015"),
    ];
    if preset == "needle_insertion" {
        keys.push(("instrument.capture_radius_m", "0.001"));
    }
    let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset(preset).unwrap().with(&keys).unwrap()
}

/// A value of the key's range: an end, next to one, or in between on a scale that reaches every order of magnitude.
fn value(path: &str, random: &mut Random) -> Option<String> {
    let share = random.below(1 << 32) as f64 / (1_u64 << 32) as f64;
    let real = |low: f64, high: f64| match random_end(share) {
        Some(true) => high,
        Some(false) => low,
        None if low >= 0.0 => (low.max(1e-9).ln() + share * (high.ln() - low.max(1e-9).ln())).exp(),
        None => low + share * (high - low),
    };
    Some(match keys::find(path)?.kind {
        Kind::Text | Kind::Point => return None,
        Kind::Word(words) => words[(share * words.len() as f64) as usize % words.len()].to_owned(),
        Kind::Real(range) => format!("{:e}", real(range.low, range.high)),
        Kind::Integer(low, high) => format!("{}", real(low as f64, high as f64) as i64),
        Kind::OneOf(choices) => choices[(share * choices.len() as f64) as usize % choices.len()].to_string(),
        Kind::Boolean => (share < 0.5).to_string(),
        Kind::List(range, _) => format!("[{:e}]", real(range.low.max(0.0), range.high)),
    })
}

fn random_end(share: f64) -> Option<bool> {
    (share < 0.05).then_some(false).or_else(|| (share > 0.95).then_some(true))
}

fn run(scene: &Scene) -> Outcome {
    if scene.estimate().is_some_and(|size| size.nodes > NODES) {
        return Outcome::Skipped;
    }
    let Ok(mut twin) = Twin::new(scene) else { return Outcome::Refused };
    if twin.nodes() as f64 > NODES {
        return Outcome::Skipped;
    }
    let begun = Instant::now();
    let depth = scene.motion.map_or(1e-3, |m| m.depth.get());
    let mut last = None;
    for i in 1..=POSES + 200 {
        let pose = twin.pose_at_depth(depth * f64::from(i.min(POSES)) / f64::from(POSES));
        match twin.step(StampedPose { time_s: 0.01 * f64::from(i), pose }) {
            Ok(answer) => last = Some(answer),
            Err(Halt::Pose { .. }) => return Outcome::Refused,
            Err(_) => return Outcome::Halted,
        }
        if i > POSES && last.is_some_and(|answer| answer.steps == 0) {
            break;
        }
        if begun.elapsed().as_secs_f64() > ENOUGH_S {
            return Outcome::Skipped;
        }
    }
    let Some(answer) = last else { return Outcome::Halted };
    assert!(answer.force_n.iter().all(|f| f.is_finite()), "{}", scene.to_toml());
    let health = answer.health;
    if health.force_imbalance > LOUD || health.kinetic_to_strain_energy > LOUD || twin.recoveries() > 0 {
        return Outcome::Loud;
    }
    Outcome::Force(answer.force_n[2])
}

/// What the force may be over that of the unchanged scene, where that is known.
fn allowed(key: &str, scene: &Scene, unchanged: &Scene) -> Option<(f64, f64)> {
    match key {
        "material.density_kg_per_m3"
        | "motion.speed_m_per_s"
        | "motion.pose_hz"
        | "motion.hold_s"
        | "motion.retract" => Some((0.999, 1.001)),
        "stepping.tolerance"
        | "stepping.step_factor"
        | "stepping.max_steps_per_pose"
        | "stepping.min_steps_per_pose" => Some((0.95, 1.05)),
        "material.shear_modulus_pa" => {
            let ratio = scene.material.shear_modulus() / unchanged.material.shear_modulus();
            Some((0.95 * ratio, 1.05 * ratio))
        }
        // from nothing to incompressible
        "material.poisson_ratio" => Some((0.1, 1.1)),
        "discretisation.precision" => Some((0.98, 1.02)),
        _ => None,
    }
}

/// Sweeps over so many scenes, those before `from` left out; what failed in silence.
fn sweep(count: u32, from: u32, seed: u64) -> Vec<String> {
    let mut random = Random::new(seed);
    let presets = ["compression", "indentation", "needle_insertion"];
    let bases: Vec<(Scene, f64)> = presets
        .iter()
        .map(|preset| {
            let scene = base(preset);
            let Outcome::Force(force) = run(&scene) else { panic!("{preset}") };
            (scene, force)
        })
        .collect();
    let (mut wrong, mut tally) = (Vec::new(), [0_u32; 5]);
    let begun = Instant::now();
    for i in 0..count {
        let (unchanged, force) = &bases[i as usize % bases.len()];
        let paths = unchanged.paths();
        let number = 1 + random.below(2) as usize;
        let chosen: Vec<String> =
            (0..number).map(|_| paths[random.below(paths.len() as u64) as usize].clone()).collect();
        let changes: Vec<Override> =
            chosen.iter().filter_map(|p| value(p, &mut random).map(|v| Override::text(p, &v, "sweep"))).collect();
        if i < from {
            continue;
        }
        let Ok(scene) = unchanged.with(&changes) else {
            tally[0] += 1;
            continue;
        };
        let (sender, receiver) = mpsc::channel();
        let one = scene.clone();
        std::thread::spawn(move || sender.send(alone(|| run(&one))));
        let outcome = match receiver.recv_timeout(HANGS) {
            Ok(outcome) => outcome,
            Err(e) => {
                wrong.push(format!("{i}: {changes:?}: {e} (a hang, or a panic)"));
                wrong.last().iter().for_each(|wrong| println!("{wrong}"));
                continue;
            }
        };
        tally[match outcome {
            Outcome::Refused => 0,
            Outcome::Skipped => 1,
            Outcome::Halted => 2,
            Outcome::Loud => 3,
            Outcome::Force(_) => 4,
        }] += 1;
        if let (Outcome::Force(found), [key]) = (&outcome, &chosen[..])
            && let Some((low, high)) = allowed(key, &scene, unchanged)
            && !(low..=high).contains(&(found / force))
        {
            wrong.push(format!("{i}: {changes:?}: {found} N, {force} N unchanged"));
            wrong.last().iter().for_each(|wrong| println!("{wrong}"));
        }
        if i % 500 == 499 {
            println!("{} scenes in {:.0} s: {tally:?}, {} wrong", i + 1, begun.elapsed().as_secs_f64(), wrong.len());
        }
    }
    let [refused, skipped, halted, loud, right] = tally;
    println!(
        "{count} scenes in {:.0} s: {refused} refused, {skipped} too large or slow to be swept, {halted} halted, {loud} said by the \
         health, {right} with a force",
        begun.elapsed().as_secs_f64()
    );
    wrong
}

#[test]
fn some_scenes_are_right_refused_or_said() {
    let wrong = sweep(60, 0, 1);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[ignore = "hours, the long form of the short run above; SWEEP says how many scenes: .ci/long runs it"]
fn many_scenes_are_right_refused_or_said() {
    let number = |name: &str| std::env::var(name).ok().and_then(|n| n.parse().ok());
    let wrong = sweep(number("SWEEP").unwrap_or(10_000), number("SWEEP_FROM").unwrap_or(0), 2);
    assert!(wrong.is_empty(), "{wrong:#?}");
}
