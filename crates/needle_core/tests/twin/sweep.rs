//! Every key over its whole allowed range, alone and in pairs: the force is right, or the scene is refused, or the health says so.
//!
//! The short run is a part of the tests. The long one, `SWEEP=10000 cargo test --release --test twin sweep -- --ignored --nocapture`,
//! says of each scene that fails which it is, and its count stands in `docs/lab/faults.md`. `SWEEP_OF=contact_and_regions` sweeps the keys
//! of contact, capture, regions and of a needle with friction instead of those of the presets.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::sync::mpsc;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

use needle_core::scene::{Kind, Override, Scene, keys};
use needle_core::twin::{Halt, StampedPose, Twin};
use testkit::coarse::alone;
use testkit::random::Random;

/// Nodes of a model that is swept over.
const NODES: f64 = 3000.0;
/// Processor time after which a scene has shown enough, s.
const ENOUGH_S: f64 = 4.0;
/// Processor time after which a scene hangs, s: other programs have no part in it.
const HANGS_S: f64 = 60.0;
/// Time between two looks at it.
const LOOK: Duration = Duration::from_millis(500);
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

/// Time on a processor of this thread or of the whole program, s.
fn spent(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// A value of the key's range: an end, next to one, or in between on a scale that reaches every order of magnitude.
fn value(path: &str, scene: &Scene, random: &mut Random) -> Option<String> {
    let mut share_of_one = || random.below(1 << 32) as f64 / (1_u64 << 32) as f64;
    let share = share_of_one();
    let real = |low: f64, high: f64| match random_end(share) {
        Some(true) => high,
        Some(false) => low,
        None if low >= 0.0 => (low.max(1e-9).ln() + share * (high.ln() - low.max(1e-9).ln())).exp(),
        None => low + share * (high - low),
    };
    Some(match keys::find(path)?.kind {
        Kind::Text if path.ends_with(".material") => {
            scene.materials.get((share * scene.materials.len() as f64) as usize)?.name.clone()
        }
        Kind::Text => return None,
        // in the sample and beside it, or an edge
        Kind::Point => {
            let [x, y] = [share_of_one(), share_of_one()].map(|share| 0.03 * (share - 0.5));
            format!("[{x:e}, {y:e}, {:e}]", 0.02 * share)
        }
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
    let begun = spent(ClockId::ThreadCPUTime);
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
        if spent(ClockId::ThreadCPUTime) - begun > ENOUGH_S {
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

/// A scene whose keys are changed.
struct Base {
    scene: Scene,
    /// Its own force, N.
    force: f64,
    /// Forces of the same scene with all of the softest and of the stiffest material, N.
    homogeneous: Option<[f64; 2]>,
    /// Forces without friction and with a bond, N.
    rough: Option<[f64; 2]>,
    /// Whether a key is one that is swept over here.
    takes: fn(&str) -> bool,
}

impl Base {
    fn of(scene: Scene, takes: fn(&str) -> bool) -> Self {
        let force = |changes: &[(String, String)]| {
            let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "sweep")).collect();
            match run(&scene.with(&changes).unwrap()) {
                Outcome::Force(force) => force,
                other => panic!("{}: {other:?} {changes:?}", scene.name),
            }
        };
        let pair = |path: &str, value: &str| (path.to_owned(), value.to_owned());
        let homogeneous = (!scene.materials.is_empty() && !rubs(&scene)).then(|| {
            let paths = scene.materials.iter().map(|m| format!("materials.{}.shear_modulus_pa", m.name));
            let paths: Vec<String> = paths.chain(["material.shear_modulus_pa".to_owned()]).collect();
            [SOFT, STIFF].map(|modulus| force(&paths.iter().map(|p| pair(p, modulus)).collect::<Vec<_>>()))
        });
        let rough = scene
            .paths()
            .iter()
            .any(|p| p == "instrument.friction_coefficient")
            .then(|| ["frictionless", "bonded"].map(|contact| force(&[pair("instrument.contact", contact)])));
        Self { force: force(&[]), homogeneous, rough, takes, scene }
    }

    /// What the force may be over that of the unchanged scene, where that is known.
    fn allowed(&self, key: &str, scene: &Scene) -> Option<(f64, f64)> {
        let over = |[low, high]: [f64; 2]| (0.9 * low / self.force, 1.1 * high / self.force);
        Some(match key {
            _ if rubs(scene) => (-0.02, 1.1 * most_of_a_needle(scene) / self.force),
            "material.density_kg_per_m3"
            | "motion.speed_m_per_s"
            | "motion.pose_hz"
            | "motion.hold_s"
            | "motion.retract" => (0.999, 1.001),
            "stepping.tolerance"
            | "stepping.step_factor"
            | "stepping.max_steps_per_pose"
            | "stepping.min_steps_per_pose" => (0.95, 1.05),
            "material.shear_modulus_pa" if self.homogeneous.is_none() => {
                let ratio = scene.material.shear_modulus() / self.scene.material.shear_modulus();
                (0.95 * ratio, 1.05 * ratio)
            }
            // from nothing to incompressible
            "material.poisson_ratio" => (0.1, 1.1),
            "discretisation.precision" => (0.98, 1.02),
            "instrument.contact"
            | "instrument.friction_coefficient"
            | "sample.base"
            | "sample.base_friction_coefficient" => over(self.rough?),
            "instrument.wall_contact" => (0.8, 1.25),
            "instrument.tip" => (0.02, 50.0),
            "instrument.capture_window_m" => (0.1, 2.0),
            _ if key.ends_with(".rigid") => (0.99, f64::INFINITY),
            _ if key.ends_with(".density_kg_per_m3") => (0.999, 1.001),
            // the force is a homogeneous and rising function of the moduli
            _ if key.ends_with(".shear_modulus_pa") => {
                let (now, then) = (scene.get(key)?.as_real()?, self.scene.get(key)?.as_real()?);
                (0.95 * (now / then).min(1.0), 1.05 * (now / then).max(1.0))
            }
            // which part is of which material, and what is soft ahead of what is stiff, can't leave these
            _ if key.starts_with("regions.") => over(self.homogeneous?),
            _ => return None,
        })
    }
}

fn rubs(scene: &Scene) -> bool {
    scene.get("instrument.interaction").is_some_and(|word| word.to_string().contains("frictional"))
}

/// What holds a needle back at most, with friction along all that is in: friction, cutting, and a membrane not yet through, N.
fn most_of_a_needle(scene: &Scene) -> f64 {
    let real = |path: String| scene.get(&path).and_then(|value| value.as_real()).unwrap_or(0.0);
    let largest = |key: &str| {
        let regions = scene.materials.iter().map(|m| real(format!("materials.{}.{key}", m.name)));
        regions.fold(real(format!("instrument.{key}")), f64::max)
    };
    // what presses on the shaft is not known
    if largest("friction_coefficient").max(real("instrument.shaft_friction_coefficient".to_owned())) > 0.0 {
        return f64::INFINITY;
    }
    // the tip runs faster than the needle where a membrane has broken
    let speed =
        10.0 * real("motion.speed_m_per_s".to_owned()) / real("instrument.cutting_rate_reference_m_per_s".to_owned());
    let faster = speed.max(1.0).powf(largest("cutting_rate_exponent"));
    // half a millimetre of undeformed tissue may have been drawn along
    let length = real("motion.depth_m".to_owned()) + 5e-4;
    let toughness = largest("fracture_toughness_j_per_m2") * real("instrument.diameter_m".to_owned());
    largest("friction_n_per_m") * length
        + faster * largest("cutting_force_n").max(toughness)
        + largest("puncture_force_n")
}

/// Moduli of the materials of regions, Pa.
const SOFT: &str = "839.0";
const STIFF: &str = "5034.0";

fn presets() -> Vec<Base> {
    ["compression", "indentation", "needle_insertion"].map(|preset| Base::of(base(preset), |_| true)).into()
}

/// Contact with friction on plate, flat and ball, the needle's window, and samples of several materials.
fn contact_and_regions() -> Vec<Base> {
    let with = |scene: &Scene, keys: &[(&str, &str)]| {
        let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
        scene.with(&keys).unwrap()
    };
    let rough = [("instrument.contact", "coulomb"), ("instrument.friction_coefficient", "0.3")];
    let of_contact = |key: &str| {
        let last = key.rsplit('.').next().unwrap_or(key);
        ["contact", "friction_coefficient", "wall_contact", "tip", "base", "base_friction_coefficient"].contains(&last)
    };
    let of_regions = |key: &str| key.starts_with("materials.") || key.starts_with("regions.");
    let layer = |name: &str, of: &str, from: f64, to: f64| {
        format!(
            "[[regions]]\nname = \"{name}\"\nmaterial = \"{of}\"\nshape = \"layer\"\nfrom_depth_m = {from}\nto_depth_m = {to}\n"
        )
    };
    let material = |name: &str, modulus: &str| format!("[materials.{name}]\nshear_modulus_pa = {modulus}\n");
    let in_parts = |preset: &str, regions: String| {
        let (soft, stiff) = (material("soft", SOFT), material("stiff", STIFF));
        Scene::from_toml(&(base(preset).to_toml() + &soft + &stiff + &regions), preset).unwrap()
    };
    let layers = || layer("skin", "stiff", 0.0, 0.004) + &layer("fat", "soft", 0.004, 0.010);
    let lump = || {
        "[[regions]]\nname = \"lump\"\nmaterial = \"stiff\"\nshape = \"sphere\"\ncentre_m = [0, 0, 0.009]\nradius_m = 0.004\n"
            .to_owned()
    };
    let flat = with(&base("indentation"), &rough);
    let ball = with(&flat, &[("instrument.tip", "sphere")]);
    let plate = with(&base("compression"), &rough);
    let plate = with(&plate, &[("sample.base", "coulomb"), ("sample.base_friction_coefficient", "0.3")]);
    let needle = with(
        &in_parts("needle_insertion", layers()),
        &[
            ("instrument.interaction", "frictional"),
            ("instrument.friction_n_per_m", "1.0"),
            ("instrument.cutting_force_n", "0.003"),
            ("materials.soft.friction_n_per_m", "0.5"),
            ("materials.soft.cutting_force_n", "0.002"),
            ("materials.stiff.friction_n_per_m", "2.0"),
            ("materials.stiff.cutting_force_n", "0.005"),
            ("discretisation.edge_refinement", "0.12"),
            ("motion.depth_m", "0.003"),
        ],
    );
    let of_friction = |key: &str| {
        let last = key.rsplit('.').next().unwrap_or(key);
        let keys = ["friction_n_per_m", "cutting_force_n", "puncture_force_n", "fracture_toughness_j_per_m2"];
        keys.contains(&last) || key.starts_with("materials.") || key.starts_with("regions.")
    };
    vec![
        Base::of(needle, of_friction),
        Base::of(flat, of_contact),
        Base::of(ball, of_contact),
        Base::of(plate, of_contact),
        Base::of(base("needle_insertion"), |key| key == "instrument.capture_window_m"),
        Base::of(in_parts("compression", layers()), of_regions),
        Base::of(in_parts("indentation", layers()), of_regions),
        Base::of(in_parts("indentation", lump()), of_regions),
        Base::of(in_parts("needle_insertion", layers()), of_regions),
    ]
}

/// What becomes of a scene, by the processor's time: `None` if it hangs or panics.
fn outcome(scene: &Scene) -> Option<Outcome> {
    let (sender, receiver) = mpsc::channel();
    let one = scene.clone();
    std::thread::spawn(move || sender.send(alone(|| run(&one))));
    let begun = spent(ClockId::ProcessCPUTime);
    loop {
        match receiver.recv_timeout(LOOK) {
            Ok(outcome) => return Some(outcome),
            Err(mpsc::RecvTimeoutError::Timeout) if spent(ClockId::ProcessCPUTime) - begun < HANGS_S => {}
            Err(_) => return None,
        }
    }
}

/// Sweeps over so many scenes, those before `from` left out; what failed in silence.
fn sweep(bases: &[Base], count: u32, from: u32, seed: u64) -> Vec<String> {
    let mut random = Random::new(seed);
    let (mut wrong, mut tally) = (Vec::new(), [0_u32; 5]);
    let begun = Instant::now();
    for i in 0..count {
        let base = &bases[i as usize % bases.len()];
        let paths = base.scene.paths();
        let first: Vec<String> = paths.iter().filter(|path| (base.takes)(path)).cloned().collect();
        let number = 1 + random.below(2) as usize;
        let chosen: Vec<String> = (0..number)
            .map(|k| if k == 0 { &first } else { &paths })
            .map(|paths| paths[random.below(paths.len() as u64) as usize].clone())
            .collect();
        let value = |path: &String| value(path, &base.scene, &mut random).map(|v| Override::text(path, &v, "sweep"));
        let changes: Vec<Override> = chosen.iter().filter_map(value).collect();
        if i < from {
            continue;
        }
        let Ok(scene) = base.scene.with(&changes) else {
            tally[0] += 1;
            continue;
        };
        let mut fail = |how: String| {
            println!("{i}: {} {changes:?}: {how}", base.scene.name);
            wrong.push(format!("{i}: {} {changes:?}: {how}", base.scene.name));
        };
        let Some(outcome) = outcome(&scene) else {
            fail("a hang, or a panic".to_owned());
            continue;
        };
        tally[match outcome {
            Outcome::Refused => 0,
            Outcome::Skipped => 1,
            Outcome::Halted => 2,
            Outcome::Loud => 3,
            Outcome::Force(_) => 4,
        }] += 1;
        if let (Outcome::Force(found), [key]) = (&outcome, &chosen[..])
            && let Some((low, high)) = base.allowed(key, &scene)
            && !(low..=high).contains(&(found / base.force))
        {
            fail(format!("{found} N, {} N unchanged, allowed {low} to {high} of it", base.force));
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
    let wrong = [sweep(&presets(), 60, 0, 1), sweep(&contact_and_regions(), 40, 0, 1)].concat();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[ignore = "hours, the long form of the short run above; SWEEP says how many scenes: .ci/long runs it"]
fn many_scenes_are_right_refused_or_said() {
    let number = |name: &str| std::env::var(name).ok().and_then(|n| n.parse().ok());
    let added = std::env::var("SWEEP_OF").is_ok_and(|of| of == "contact_and_regions");
    let bases = if added { contact_and_regions() } else { presets() };
    let wrong = sweep(&bases, number("SWEEP").unwrap_or(10_000), number("SWEEP_FROM").unwrap_or(0), 2);
    assert!(wrong.is_empty(), "{wrong:#?}");
}
