//! Contract of teams: siblings that take their poses together answer as they do alone, to a thousandth of the peak force.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_twin::compare::ensemble::{self, Crew, Live, MemberPath, Paths, Size};
use needle_twin::compare::{At, Reading};
use needle_twin::scene::{Override, Scene, Word};
use needle_twin::twin::{Halt, Motion, Prediction, StampedPose, Team, Twin};

use crate::coarse::{self, alone};

const HALF_PLANE: (&str, &str) = ("discretisation.dimension", "axisymmetric");

const NEEDLE: &[&str] = &["material.shear_modulus_pa", "instrument.deformation_coefficient", "material.poisson_ratio"];
const PRESSED: &[&str] = &["material.shear_modulus_pa", "material.poisson_ratio"];

/// Scenes whose members differ in some keys, and how deep they are pressed, m. Each pose takes three steps, so that members and twins alone
/// have the same pace.
fn scenes() -> Vec<(Scene, &'static [&'static str], f64)> {
    let tilted = [("discretisation.dimension", "mirrored"), ("instrument.tilt_rad", "0.15")];
    let of = |preset: &str, changes: &[(&str, &str)]| {
        let pace = [("stepping.min_steps_per_pose", "3"), ("stepping.max_steps_per_pose", "3")];
        coarse::scene(preset, &[changes, &pace[..]].concat())
    };
    vec![
        (of("needle_insertion", &[HALF_PLANE]), NEEDLE, 2.5e-3),
        (of("needle_insertion", &[]), NEEDLE, 2.5e-3),
        (of("needle_insertion", &tilted), NEEDLE, 2.5e-3),
        (of("indentation", &[HALF_PLANE]), PRESSED, 2e-3),
        (of("compression", &[HALF_PLANE]), PRESSED, 2e-3),
    ]
}

/// Presets as they ship, but for the speed.
fn presets(names: &[&'static str], changes: &[(&str, &str)]) -> Vec<(Scene, &'static [&'static str], f64)> {
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    let of = |name: &&'static str| {
        let scene = Scene::preset(name).unwrap().with(&changes).unwrap();
        let depth_m = scene.motion.unwrap().depth.get();
        (scene, if *name == "needle_insertion" { NEEDLE } else { PRESSED }, depth_m)
    };
    names.iter().map(of).collect()
}

/// The scene with each of the keys between 0.9 and 1.1 times (a ratio: 0.97 to 1) what it is.
fn member(scene: &Scene, keys: &[&str], k: usize) -> Scene {
    let share = |i: usize| ((7 * k + 5 * i) % Team::MOST) as f64 / (Team::MOST - 1) as f64;
    let change = |(i, key): (usize, &&str)| {
        let own = scene.get(key).unwrap();
        let own: f64 = own.to_string().parse().unwrap();
        let factor = if key.contains("ratio") { 0.97 + 0.03 * share(i) } else { 0.9 + 0.2 * share(i) };
        Override::typed(key, own * factor, "test")
    };
    scene.with(&keys.iter().enumerate().map(change).collect::<Vec<_>>()).unwrap()
}

fn siblings(scene: &Scene, keys: &[&str]) -> Vec<Twin> {
    let first = Twin::new(scene).unwrap();
    (0..Team::MOST).map(|k| first.sibling(&member(scene, keys, k)).unwrap()).collect()
}

fn at(twin: &Twin, pose: u32, depth_m: f64) -> StampedPose {
    StampedPose { time_s: 1e-3 * f64::from(pose), pose: twin.pose_at_depth(depth_m) }
}

/// Answers of all twins to their depths.
fn step(
    team: &mut Team,
    twins: &mut [Twin],
    pose: u32,
    depth_m: impl Fn(usize) -> f64,
) -> Vec<Result<Prediction, Halt>> {
    let poses = std::array::from_fn(|k| at(&twins[k], pose, depth_m(k)));
    let mut all = twins.iter_mut();
    team.step(&mut std::array::from_fn(|_| all.next()), &poses).into_iter().flatten().collect()
}

fn team(twins: &[Twin]) -> Team {
    Team::new(&twins.iter().collect::<Vec<_>>(), None).unwrap()
}

/// Largest difference of a member's force from that of its single run, over the peak, all the way down in poses of so many metres.
fn off(scene: &Scene, keys: &[&str], depth_m: f64, way_m: f64, rests: u32) -> f64 {
    let (mut own, mut together) = (siblings(scene, keys), siblings(scene, keys));
    let mut team = team(&together);
    let (mut peak, mut off, mut apart, mut most) = (0.0_f64, 0.0_f64, 0.0_f64, 0);
    let poses = (depth_m / way_m) as u32;
    for pose in 1..=poses + rests {
        let depth = way_m * f64::from(pose.min(poses));
        let answers = step(&mut team, &mut together, pose, |_| depth);
        let answers: Vec<Prediction> = answers.into_iter().map(Result::unwrap).collect();
        for (twin, answer) in own.iter_mut().zip(&answers) {
            let single = twin.step(at(twin, pose, depth)).unwrap();
            peak = peak.max(single.force_n[2].abs());
            off = off.max((single.force_n[2] - answer.force_n[2]).abs());
            apart = apart.max((answer.force_n[2] - answers[0].force_n[2]).abs());
            most = most.max(answer.steps);
            let (j, k) = (single.health.min_jacobian, answer.health.min_jacobian);
            assert!((j - k).abs() < 0.02, "{}: {j} {k}", scene.name);
        }
    }
    println!("{} {}: off {:.1e} of the peak {peak:.4} N", scene.name, own[0].dimension().as_str(), off / peak);
    assert!(peak > 1e-3 && apart > 0.05 * peak && most > 0, "{}: members differ", scene.name);
    off / peak
}

#[test]
fn so_it_is_in_any_dimension() {
    for (scene, keys, depth_m) in scenes() {
        // the needle's peak is a tenth of that at full depth, and the inertia of its first poses as large as ever
        let off = alone(|| off(&scene, keys, depth_m, 1e-5, 0));
        assert!(off < 3e-3, "{}: {off}", scene.name);
    }
}

#[test]
fn a_member_is_its_single_run_to_a_thousandth_of_the_peak() {
    for (scene, keys, depth_m) in presets(&["needle_insertion", "indentation", "compression"], &[]) {
        // deeper the indented cloud snaps from one shape to the next, and where it does depends on the pace
        let depth_m = if scene.name == "indentation" { 6e-3 } else { depth_m };
        let off = alone(|| off(&scene, keys, depth_m, 5e-6, 20));
        assert!(off < 1e-3, "{}: {off}", scene.name);
    }
}

/// A single run in space is no better defined: 1e-7 times more modulus, which is the round-off of single precision, moves its force by 1.8e-3 of the
/// peak between 2 and 3 mm (before the mixed formulation; members were off by 1.5e-3 then, by 2.5e-3 with it), since a pose gets another number of steps.
#[test]
#[ignore = "minutes: .ci/long runs it"]
fn so_it_is_in_space_as_far_as_round_off_lets_it() {
    for (scene, keys, depth_m) in presets(&["needle_insertion"], &[("discretisation.dimension", "full")]) {
        let off = alone(|| off(&scene, keys, depth_m, 1e-5, 20));
        assert!(off < 3e-3, "{}: {off}", scene.name);
    }
}

#[test]
fn one_that_jumps_or_is_refused_takes_its_pose_alone() {
    let (scene, keys, _) = scenes().swap_remove(3);
    alone(|| {
        let mut twins = siblings(&scene, keys);
        let mut own = siblings(&scene, keys);
        let mut team = team(&twins);
        for pose in 1..=40 {
            // the second jumps ahead and back again, the third is sent too deep
            let depth = |k: usize| match (k, pose) {
                (1, 10) => 7e-4,
                (2, 20) => 1.0,
                _ => 1e-5 * f64::from(pose),
            };
            let answers = step(&mut team, &mut twins, pose, depth);
            for (k, twin) in own.iter_mut().enumerate() {
                let (single, answer) = (twin.step(at(twin, pose, depth(k))), &answers[k]);
                assert_eq!(single.is_ok(), answer.is_ok(), "{k} at pose {pose}: {single:?} {answer:?}");
                assert_eq!(single.is_err(), (k, pose) == (2, 20), "{k} at pose {pose}: {single:?}");
                let (Ok(single), Ok(answer)) = (single, answer) else { continue };
                let off = (single.force_n[2] - answer.force_n[2]).abs();
                // a jump is inexact in itself
                let close = if k == 1 && pose >= 10 { 0.05 } else { 1e-3 };
                assert!(off < close * (0.05 + single.force_n[2].abs()), "{k} at pose {pose}: {off}");
            }
        }
    });
}

#[test]
fn what_no_team_can_step_has_none() {
    let of = |changes: &[(&str, &str)]| {
        let scene = coarse::scene("needle_insertion", &[&[HALF_PLANE], changes].concat());
        alone(|| Twin::new(&scene)).unwrap()
    };
    let plain = of(&[]);
    assert!(Team::new(&[&plain], None).is_some());
    assert!(Team::new(&[&plain, &of(&[])], None).is_none(), "two clouds");
    for changes in [
        &[("material.prony_shares", "[0.3]"), ("material.prony_times_s", "[0.05]")][..],
        &[("material.volumetric", "logarithmic")],
        &[
            ("instrument.interaction", "frictional"),
            ("instrument.friction_n_per_m", "5"),
            ("instrument.cutting_force_n", "0.02"),
        ],
    ] {
        assert!(Team::new(&[&of(changes)], None).is_none(), "{changes:?}");
    }
}

/// An ensemble of a half plane, and the poses for it.
fn ensemble_of(key: &str, prior: &str) -> (Scene, Vec<Reading>) {
    let few = [("motion.speed_m_per_s", "0.005"), (key, prior)];
    let few = few.map(|(path, value)| Override::text(path, value, "test"));
    let scene = Scene::preset("needle_insertion").unwrap().with(&few).unwrap();
    let poses = scene.motion.unwrap().poses().map(|(time_s, depth_m)| Reading { time_s, at: At::Depth(depth_m) });
    let poses = poses.collect();
    (scene, poses)
}

fn bits(paths: &Paths) -> Vec<u64> {
    let force = |path: &Result<MemberPath, String>| path.as_ref().unwrap().force_n.clone();
    paths.of_member.iter().flat_map(force).map(f64::to_bits).collect()
}

#[test]
fn an_ensemble_has_the_same_bits_for_any_threads_and_is_right_to_a_thousandth() {
    let (scene, readings) = ensemble_of("uncertainty.material.poisson_ratio", "{ uniform = [0.45, 0.49] }");
    let members = ensemble::members(&scene, Size { members: 20, seed: 0 }).unwrap();
    let times = [1.0, 1.0001];
    let crew = |threads| Crew { threads, stop: None, done: &|| {} };
    let one = ensemble::tracked_paths(&members, &readings, &times, &crew(1)).unwrap();
    let two = ensemble::tracked_paths(&members, &readings, &times, &crew(2)).unwrap();
    assert_eq!(one, two);
    assert_eq!(one.runs, 20);
    let own = ensemble::paths(&members, &readings, &crew(2)).unwrap();
    assert_ne!(bits(&one), bits(&own), "teams were at work");
    for (k, (a, b)) in one.of_member.iter().zip(&own.of_member).enumerate() {
        let (a, b) = (a.as_ref().unwrap(), b.as_ref().unwrap());
        let peak = b.force_n.iter().fold(0.0_f64, |m, f| m.max(*f));
        let off = a.force_n.iter().zip(&b.force_n).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(peak > 0.05 && off < 1e-3 * peak, "member {k}: {off} N of {peak} N");
        let near = |a: &[[f64; 3]], b: &[[f64; 3]]| (0..3).all(|c| (a[1][c] - b[1][c]).abs() < 1e-6);
        assert!(near(&a.targets, &b.targets), "{:?} {:?}", a.targets, b.targets);
        let tracked: Vec<_> = a.tracked.iter().flatten().collect();
        assert!(tracked.len() == 2 && near(tracked[1], tracked[0]) && !near(tracked[1], &a.targets), "{tracked:?}");
    }
    // what has clouds of its own, and few members, are as they were
    let (scene, readings) = ensemble_of("uncertainty.instrument.capture_radius_m", "{ uniform = [0.0005, 0.0006] }");
    let wide = ensemble::members(&scene, Size { members: 16, seed: 0 }).unwrap();
    for members in [&wide[..], &members[..4]] {
        let found = ensemble::tracked_paths(members, &readings, &[], &crew(2)).unwrap();
        assert_eq!(bits(&found), bits(&ensemble::paths(members, &readings, &crew(1)).unwrap()));
    }
}

#[test]
fn live_members_in_a_team_answer_as_twins_alone() {
    let (scene, _) = ensemble_of("uncertainty.material.poisson_ratio", "{ uniform = [0.45, 0.49] }");
    let members = ensemble::members(&scene, Size { members: 6, seed: 0 }).unwrap();
    let mut live = Live::build(&members, |k, why| panic!("{k}: {why}")).unwrap();
    let mut twins: Vec<Twin> = alone(|| members.iter().map(|m| Twin::new(&m.scene).unwrap()).collect());
    for poses in [2000, 200] {
        let (mut peak, mut off) = (0.0_f64, 0.0_f64);
        for pose in 1..=poses {
            let stamped = at(&twins[0], pose, 5e-6 * f64::from(pose));
            live.follow(&stamped);
            assert!(live.halt().is_none());
            let own: Vec<f64> = twins.iter_mut().map(|t| t.follow(stamped).unwrap().force_n[2]).collect();
            for (a, b) in live.forces().zip(&own) {
                (peak, off) = (peak.max(b.abs()), off.max((a - b).abs()));
            }
            if pose % 500 == 0 {
                let ahead = live.ahead(&Motion::new(2e-4, 0.02, 10)).unwrap();
                let more = ahead.forces_n.iter().map(|way| way.last().unwrap() - way[0]);
                assert!(more.into_iter().all(|more| more > 0.0), "{ahead:?}");
            }
        }
        // of the peak at 10 mm
        assert!(peak > 1e-3 && off < 1e-3 * peak.max(0.05), "{off} N of {peak} N");
        live.reset();
        twins.iter_mut().for_each(Twin::reset);
    }
}
