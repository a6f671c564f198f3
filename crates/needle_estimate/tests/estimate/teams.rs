//! Contract of teams: siblings that take their poses together answer as they do alone, with the same bits.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Halt, Motion, Prediction, StampedPose, Team, Twin};
use needle_estimate::compare::Cancel;
use needle_estimate::compare::ensemble::{self, Crew, Live, MemberPath, Paths, Size};
use needle_recording::{At, Reading};

use testkit::coarse::{self, alone};

const HALF_PLANE: (&str, &str) = ("discretisation.dimension", "axisymmetric");

const NEEDLE: &[&str] = &["material.shear_modulus_pa", "instrument.deformation_coefficient", "material.poisson_ratio"];
const PRESSED: &[&str] = &["material.shear_modulus_pa", "material.poisson_ratio"];

/// Scenes whose members differ in some keys, and how deep they are pressed, m.
fn scenes() -> Vec<(Scene, &'static [&'static str], f64)> {
    let tilted = [("discretisation.dimension", "mirrored"), ("instrument.tilt_rad", "0.15")];
    let of = coarse::scene;
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

/// Members and single runs answer alike all the way down in poses of so many metres, and at rest.
fn go_alike(scene: &Scene, keys: &[&str], depth_m: f64, way_m: f64, rests: u32) {
    let (mut own, mut together) = (siblings(scene, keys), siblings(scene, keys));
    let mut team = team(&together);
    let (mut peak, mut apart, mut most) = (0.0_f64, 0.0_f64, 0);
    let poses = (depth_m / way_m) as u32;
    for pose in 1..=poses + rests {
        let depth = way_m * f64::from(pose.min(poses));
        let answers = step(&mut team, &mut together, pose, |_| depth);
        let answers: Vec<Prediction> = answers.into_iter().map(Result::unwrap).collect();
        for (k, (twin, answer)) in own.iter_mut().zip(&answers).enumerate() {
            let single = twin.step(at(twin, pose, depth)).unwrap();
            let told = |p: &Prediction| (p.force_n, p.base_force_n, p.torque_nm, p.steps, p.health.min_jacobian);
            assert_eq!(told(&single), told(answer), "{}, member {k}, pose {pose}", scene.name);
            peak = peak.max(single.force_n[2].abs());
            apart = apart.max((answer.force_n[2] - answers[0].force_n[2]).abs());
            most = most.max(answer.steps);
        }
    }
    assert!(peak > 1e-3 && apart > 0.05 * peak && most > 0, "{}: members differ", scene.name);
}

#[test]
fn a_member_has_the_bits_of_its_single_run_in_any_dimension() {
    for (scene, keys, depth_m) in scenes() {
        alone(|| go_alike(&scene, keys, depth_m, 1e-5, 20));
    }
}

#[test]
fn a_member_has_the_bits_of_its_single_run_to_full_depth() {
    for (scene, keys, depth_m) in presets(&["needle_insertion", "indentation", "compression"], &[]) {
        alone(|| go_alike(&scene, keys, depth_m, 5e-6, 20));
    }
}

#[test]
#[ignore = "minutes: .ci/long runs it"]
fn so_it_has_in_space() {
    for (scene, keys, depth_m) in presets(&["needle_insertion"], &[("discretisation.dimension", "full")]) {
        alone(|| go_alike(&scene, keys, depth_m, 1e-5, 20));
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
                assert_eq!((single.force_n, single.steps), (answer.force_n, answer.steps), "{k} at pose {pose}");
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
fn an_ensemble_has_the_bits_of_single_runs_for_any_threads() {
    let (scene, readings) = ensemble_of("uncertainty.material.poisson_ratio", "{ uniform = [0.45, 0.49] }");
    let members = ensemble::members(&scene, Size { members: 20, seed: 0 }).unwrap();
    let times = [1.0, 1.0001];
    let crew = |threads| Crew { threads, cancel: Cancel::default(), done: &|| {} };
    let one = ensemble::tracked_paths(&members, &readings, &times, &crew(1)).unwrap();
    let two = ensemble::tracked_paths(&members, &readings, &times, &crew(2)).unwrap();
    assert_eq!(one, two);
    assert_eq!(one.runs, 20);
    // so many threads that each member goes alone
    let own = ensemble::tracked_paths(&members, &readings, &times, &crew(8)).unwrap();
    assert_eq!(one, own);
    for a in &one.of_member {
        let a = a.as_ref().unwrap();
        let peak = a.force_n.iter().fold(0.0_f64, |m, f| m.max(*f));
        assert!(peak > 0.05, "{peak} N");
        let near = |a: &[[f64; 3]], b: &[[f64; 3]]| (0..3).all(|c| (a[1][c] - b[1][c]).abs() < 1e-6);
        let tracked: Vec<_> = a.tracked.iter().flatten().collect();
        assert!(tracked.len() == 2 && near(tracked[1], tracked[0]) && !near(tracked[1], &a.targets), "{tracked:?}");
    }
    // clouds of their own, and few members
    let (scene, readings) = ensemble_of("uncertainty.instrument.capture_radius_m", "{ uniform = [0.0005, 0.0006] }");
    let wide = ensemble::members(&scene, Size { members: 16, seed: 0 }).unwrap();
    for members in [&wide[..], &members[..4]] {
        let found = ensemble::paths(members, &readings, &crew(2)).unwrap();
        assert_eq!(bits(&found), bits(&ensemble::paths(members, &readings, &crew(8)).unwrap()));
    }
}

#[test]
fn live_members_in_a_team_answer_as_twins_alone() {
    let (scene, _) = ensemble_of("uncertainty.material.poisson_ratio", "{ uniform = [0.45, 0.49] }");
    let members = ensemble::members(&scene, Size { members: 6, seed: 0 }).unwrap();
    let mut live = Live::build(&members, |k, why| panic!("{k}: {why}")).unwrap();
    let mut twins: Vec<Twin> = alone(|| members.iter().map(|m| Twin::new(&m.scene).unwrap()).collect());
    for poses in [2000, 200] {
        let mut peak = 0.0_f64;
        for pose in 1..=poses {
            let stamped = at(&twins[0], pose, 5e-6 * f64::from(pose));
            live.follow(&stamped);
            assert!(live.halt().is_none());
            let own: Vec<f64> = twins.iter_mut().map(|t| t.follow(stamped).unwrap().force_n[2]).collect();
            assert!(live.forces().eq(own.iter().copied()), "pose {pose}");
            peak = own.iter().fold(peak, |peak, f| peak.max(f.abs()));
            if pose % 500 == 0 {
                let ahead = live.ahead(&Motion::new(2e-4, 0.02, 10)).unwrap();
                let more = ahead.forces_n.iter().map(|way| way.last().unwrap() - way[0]);
                assert!(more.into_iter().all(|more| more > 0.0), "{ahead:?}");
            }
        }
        assert!(peak > 1e-3, "{peak} N");
        live.reset();
        twins.iter_mut().for_each(Twin::reset);
    }
}
