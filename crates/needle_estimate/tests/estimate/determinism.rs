//! Contract of determinism: the same scene and poses give the same bits, whatever the number of threads.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use needle_estimate::compare::{Cancel, Finished, Keep, Run, Session};

/// A wide needle needs few nodes.
const WIDE: (&str, &str) = ("instrument.capture_radius_m", "0.0015");

/// A coarse scene with insertion, hold and retraction, and fewer steps than the force would need: every bit is under
/// test, not the force.
fn scene(preset: &str, changes: &[(&str, &str)]) -> Scene {
    let quick = [
        ("discretisation.dimension", "full"),
        ("discretisation.spacing_m", "0.004"),
        ("stepping.max_steps_per_pose", "5"),
        ("motion.depth_m", "0.001"),
        ("motion.speed_m_per_s", "0.02"),
        ("motion.hold_s", "0.01"),
        ("motion.retract", "true"),
    ];
    let changes: Vec<_> =
        quick.iter().chain(changes).map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset(preset).unwrap().with(&changes).unwrap()
}

fn solve(scene: &Scene, threads: usize) -> Run {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
        let keep = Keep { fields: true, ..Keep::ANSWERS };
        Session::new(scene, "test", keep).unwrap().unwatched(Session::motion(&scene.motion.unwrap()))
    })
}

/// All numbers of a run as bits, without those of the clock.
fn bits(run: &Run) -> Vec<u64> {
    let answers = run.answers.iter().flat_map(|a| [a.time_s, a.depth_m, a.predicted_n, f64::from(a.steps)]);
    let targets = run.targets.iter().flat_map(|row| row.positions.iter().flatten().copied());
    let state = &run.final_state;
    let fields =
        state.points.iter().chain(&state.displacement).flatten().chain(&state.jacobian).chain(&state.von_mises_pa);
    answers.chain(targets).chain(fields.copied()).map(f64::to_bits).collect()
}

#[test]
fn one_two_and_four_threads_give_the_same_bits() {
    for (preset, changes) in [
        ("needle_insertion", &[WIDE] as &[(&str, &str)]),
        ("needle_insertion", &[WIDE, ("discretisation.precision", "f64")]),
        ("indentation", &[]),
        ("compression", &[("discretisation.method", "tet4")]),
    ] {
        let scene = scene(preset, changes);
        let one = solve(&scene, 1);
        assert!(one.answers.iter().any(|a| a.predicted_n.abs() > 1e-4), "{preset}: there is a force to compare");
        assert_eq!(one.diverged, None, "{preset}");
        for threads in [2, 4] {
            let many = solve(&scene, threads);
            assert_eq!(many.checksum, one.checksum, "{preset} {changes:?} on {threads} threads");
            assert!(bits(&many) == bits(&one), "{preset} {changes:?} on {threads} threads: some bit differs");
        }
    }
}

#[test]
fn a_run_again_gives_the_same_bits() {
    let scene = scene("needle_insertion", &[WIDE]);
    assert!(bits(&solve(&scene, 2)) == bits(&solve(&scene, 2)));
}

#[test]
fn a_reset_twin_is_a_new_twin() {
    let scene = scene("indentation", &[]);
    let run = |mut twin: Twin| {
        twin.reset();
        let session = Session::with(twin, 0.0, "test", Keep::ANSWERS);
        session.run(Session::motion(&scene.motion.unwrap()), &mut Cancel::default())
    };
    let Finished { run: first, twin, .. } = run(Twin::new(&scene).unwrap());
    let Finished { run: second, .. } = run(twin);
    assert!(first.answers.iter().any(|a| a.predicted_n.abs() > 1e-4), "there is a force to compare");
    assert_eq!(first.checksum, second.checksum);
}

#[test]
fn the_checksum_sees_every_change() {
    let base = scene("needle_insertion", &[WIDE]);
    let checksum = solve(&base, 2).checksum;
    for change in [("material.shear_modulus_pa", "1679"), ("motion.depth_m", "0.00101")] {
        assert_ne!(solve(&scene("needle_insertion", &[WIDE, change]), 2).checksum, checksum, "{change:?}");
    }
}
