//! What comes in from outside: a number that no instrument gives is refused with the reason, and costs nothing.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::Scene;
use needle_core::twin::{Halt, Pose, StampedPose, Twin};
use testkit::coarse::{alone, at_depth, scene, travel};

fn refusal(twin: &mut Twin, pose: StampedPose) -> String {
    match twin.follow(pose) {
        Err(Halt::Pose { reason }) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_place_that_no_tip_has_is_refused() {
    let mut twin = alone(|| Twin::new(&scene("indentation", &[])).unwrap());
    travel(&mut twin, 0.0, 1e-3, 50);
    let before = at_depth(&mut twin, 1e-3);
    for depth in [-1e300, -1e9, -10.1, 10.1, 1e300, f64::MAX] {
        let pose = StampedPose { time_s: 0.0, pose: twin.pose_at_depth(depth) };
        assert!(refusal(&mut twin, pose).contains("[-10, 10] m"), "{depth}");
    }
    let good = twin.pose_at_depth(1e-3);
    for (k, by) in [(2, 1e300), (0, 1e200), (1, -11.0)] {
        let tip = std::array::from_fn(|i| if i == k { by } else { good.tip[i] });
        assert!(
            refusal(&mut twin, StampedPose { time_s: 0.0, pose: Pose { tip, ..good } }).contains("tip"),
            "{k} {by}"
        );
    }
    assert!(refusal(&mut twin, StampedPose { time_s: 1e300, pose: good }).contains("time"));
    let after = at_depth(&mut twin, 1e-3);
    assert!((after.force_n[2] / before.force_n[2] - 1.0).abs() < 0.01, "the state is untouched");
}

/// From far away in the air to the surface is no way through the tissue.
#[test]
fn a_tip_that_comes_from_far_beside_takes_no_more_steps() {
    let scene = scene("indentation", &[]);
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    let straight = at_depth(&mut twin, 2e-3).steps;
    twin.reset();
    let up = Pose { tip: [9.0, -9.0, 9.0], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 };
    assert_eq!(twin.step(StampedPose { time_s: 0.0, pose: up }).unwrap().steps, 0);
    assert_eq!(at_depth(&mut twin, 2e-3).steps, straight);
}

/// One reading in thirty is 0: the forces of the others are those of a run without these, to the last bit.
#[test]
fn jumps_that_no_instrument_makes_are_left_out() {
    for (preset, deepest) in [("compression", 2.4e-3), ("needle_insertion", 6e-3)] {
        let scene = Scene::preset(preset).unwrap();
        let run = |broken: bool| {
            let mut twin = alone(|| Twin::new(&scene).unwrap());
            let mut forces = Vec::new();
            for i in 1..=600_u32 {
                let depth = deepest * f64::from(i) / 600.0;
                let glitch = i % 30 == 29 && depth > 1e-3;
                if glitch && broken {
                    let pose = StampedPose { time_s: 0.001 * f64::from(i), pose: twin.pose_at_depth(0.0) };
                    assert!(refusal(&mut twin, pose).contains("0.5 m/s"), "{preset} {i}");
                } else if !glitch {
                    let pose = StampedPose { time_s: 0.001 * f64::from(i), pose: twin.pose_at_depth(depth) };
                    forces.push(twin.follow(pose).unwrap().force_n);
                }
            }
            forces
        };
        assert_eq!(run(true), run(false), "{preset}");
    }
}

/// An instrument that is really there is heard again as soon as it can have got there.
#[test]
fn a_new_place_is_taken_once_there_was_time_to_get_there() {
    let mut twin = alone(|| Twin::new(&scene("indentation", &[])).unwrap());
    let at = |twin: &Twin, time_s, depth| StampedPose { time_s, pose: twin.pose_at_depth(depth) };
    let first = at(&twin, 0.0, 0.5e-3);
    twin.follow(first).unwrap();
    let there: Vec<bool> = (1..=10)
        .map(|i| {
            let pose = at(&twin, 1e-3 * f64::from(i), 2.5e-3);
            twin.follow(pose).is_ok()
        })
        .collect();
    assert!(matches!(there.iter().position(|ok| *ok), Some(3 | 4)), "2 mm at 0.5 m/s: {there:?}");
    assert!(there[4..].iter().all(|ok| *ok));
    // the air is no way
    let out = at(&twin, 0.012, -5.0);
    assert!(refusal(&mut twin, out).contains("0.5 m/s"), "the 2.5 mm to the surface are");
    let out = at(&twin, 0.03, -5.0);
    twin.follow(out).unwrap();
    let back = at(&twin, 0.031, -0.1e-3);
    assert!(twin.follow(back).is_ok());
}
