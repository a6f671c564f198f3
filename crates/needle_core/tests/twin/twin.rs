//! Contract of [`Twin`]: what it refuses, what it repeats, what it reports.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Event, Halt, Phase, Pose, StampedPose, Twin};
use testkit::coarse::{alone, at_depth, digits, scene, travel};

fn field(twin: &Twin) -> Vec<[f64; 3]> {
    let mut u = Vec::new();
    twin.displacements(&mut u);
    u
}

#[test]
fn a_pose_that_cannot_be_used_leaves_the_state_untouched() {
    let scene = scene("needle_insertion", &[]);
    let (mut twin, mut control) = (Twin::new(&scene).unwrap(), Twin::new(&scene).unwrap());
    for t in [&mut twin, &mut control] {
        travel(t, 0.0, 1e-3, 10);
    }
    let good = twin.pose_at_depth(1.1e-3);
    let with_tip =
        |k: usize, x: f64| Pose { tip: std::array::from_fn(|i| if i == k { x } else { good.tip[i] }), ..good };
    let with_axis = |axis| Pose { axis, ..good };
    let refused = [
        (0.0, with_tip(0, f64::NAN), "not finite"),
        (0.0, with_tip(2, f64::INFINITY), "not finite"),
        (0.0, with_tip(1, f64::NEG_INFINITY), "not finite"),
        (f64::NAN, good, "not finite"),
        (0.0, with_axis([0.0, f64::NAN, -1.0]), "not finite"),
        (0.0, with_axis([0.0, 0.0, -2.0]), "length"),
        (0.0, with_axis([0.0; 3]), "length"),
        (0.0, with_axis([0.0, 0.0, 1.0]), "axis"),
        (0.0, with_axis([0.6, 0.0, -0.8]), "axis"),
        (0.0, twin.pose_at_depth(0.012), "deepest"),
        (0.0, with_tip(0, 0.002), "beside"),
    ];
    for (time_s, pose, why) in refused {
        match twin.step(StampedPose { time_s, pose }) {
            Err(Halt::Pose { reason }) => assert!(reason.contains(why), "{pose:?}: {reason}"),
            other => assert!(matches!(other, Err(Halt::Pose { .. })), "{pose:?} gives {other:?}"),
        }
    }
    assert_eq!(field(&twin), field(&control));
    assert_eq!(twin.steps(), control.steps());
    let next = |t: &mut Twin| digits(&travel(t, 1e-3, 1.5e-3, 5));
    assert_eq!(next(&mut twin), next(&mut control));
}

#[test]
fn a_reset_twin_repeats_itself_bit_by_bit() {
    for (preset, depth, poses) in [("needle_insertion", 3e-3, 60), ("indentation", 3e-3, 20)] {
        let mut twin = Twin::new(&scene(
            preset,
            &[("instrument.puncture_strain", "0.05")][..usize::from(preset == "needle_insertion")],
        ))
        .unwrap();
        let run = |twin: &mut Twin| {
            let mut answers = vec![at_depth(twin, -1e-3)];
            answers.extend(travel(twin, -1e-3, depth, poses));
            answers.extend(travel(twin, depth, 0.5 * depth, poses / 2));
            (digits(&answers), field(twin))
        };
        let (first, u) = run(&mut twin);
        assert!(u.iter().flatten().any(|x| x.abs() > 1e-5), "{preset}: the tissue has moved");
        twin.reset();
        assert_eq!(twin.steps(), 0, "{preset}");
        assert!(field(&twin).iter().flatten().all(|x| *x == 0.0), "{preset}: undeformed after reset");
        let (second, v) = run(&mut twin);
        for (pose, (a, b)) in first.iter().zip(&second).enumerate() {
            assert_eq!(a, b, "{preset}, pose {pose}");
        }
        assert!(u == v, "{preset}: fields differ");
    }
}

#[test]
fn the_surface_is_punctured_once() {
    let mut twin = Twin::new(&scene("needle_insertion", &[("instrument.puncture_strain", "0.1")])).unwrap();
    assert_eq!(at_depth(&mut twin, -1e-3).phase, Phase::Approach);
    let mut answers = travel(&mut twin, 0.0, 3e-3, 60);
    answers.extend(travel(&mut twin, 3e-3, 1e-3, 20));
    answers.extend(travel(&mut twin, 1e-3, 3e-3, 20));
    let events: Vec<_> = answers.iter().enumerate().filter_map(|(i, a)| a.event.map(|e| (i, e))).collect();
    assert_eq!(events.len(), 1, "{events:?}");
    let (at, depth_m) = (events[0].0, events[0].1.puncture_depth().unwrap());
    println!("punctured at {:.3} mm", 1e3 * depth_m);
    assert!(
        answers[at - 2].depth_m <= depth_m && depth_m <= answers[at - 1].depth_m,
        "on the way that did it: {depth_m}"
    );
    assert!(at > 1 && depth_m < 2e-3, "a strain of 10 % is reached on the way: {depth_m}");
    let phases = [(0..at, Phase::Indentation), (at..60, Phase::Penetration), (60..80, Phase::Retraction)];
    for (poses, phase) in phases {
        assert!(answers[poses.clone()].iter().all(|a| a.phase == phase), "{phase:?} in poses {poses:?}");
    }
    assert_eq!(answers[99].phase, Phase::Penetration, "back at the deepest point");
}

#[test]
fn the_depth_of_a_puncture_does_not_depend_on_how_often_one_looks() {
    // with a strain of 10 % it matters as well how near to rest the tissue is when it is looked at
    for (strain, most) in [("1e-6", 2e-6), ("0.1", 15e-6)] {
        let of = |pose_hz: f64| {
            let mut twin = Twin::new(
                &Scene::preset("needle_insertion")
                    .unwrap()
                    .with(&[Override::text("instrument.puncture_strain", strain, "test")])
                    .unwrap(),
            )
            .unwrap();
            // at 1 mm/s, from a place above the sample that is on nobody's grid
            let depth = |k: u32| -0.000_137 + 0.001 * f64::from(k) / pose_hz;
            (0..).find_map(|k| at_depth(&mut twin, depth(k)).event).and_then(Event::puncture_depth).unwrap()
        };
        let seen = alone(|| [10.0, 100.0, 1000.0, 10_000.0].map(of));
        println!("strain {strain}: {seen:?}");
        let spread = seen.iter().copied().fold(f64::MIN, f64::max) - seen.iter().copied().fold(f64::MAX, f64::min);
        assert!(spread <= most, "strain {strain}: {seen:?}");
    }
}

#[test]
fn a_trembling_sensor_at_rest_changes_no_phase() {
    let mut twin = Twin::new(&scene("needle_insertion", &[])).unwrap();
    travel(&mut twin, 0.0, 3e-3, 60);
    let phases: Vec<Phase> =
        (0..200).map(|k: u32| at_depth(&mut twin, 3e-3 + 2e-6 * f64::from(k * 7919 % 5) - 4e-6).phase).collect();
    assert!(phases.iter().all(|p| *p == Phase::Penetration), "{phases:?}");
    assert_eq!(at_depth(&mut twin, 2.95e-3).phase, Phase::Retraction, "a real withdrawal is one");
}

#[test]
fn the_force_is_gone_when_the_instrument_is_out() {
    for (preset, depth) in [("indentation", 1e-3), ("needle_insertion", 3e-3)] {
        let mut twin = Twin::new(&scene(preset, &[])).unwrap();
        let way_in = travel(&mut twin, 0.0, depth, 50);
        let peak = way_in.iter().map(|a| a.force_n[2]).fold(0.0, f64::max);
        travel(&mut twin, depth, 0.0, 50);
        let left = at_depth(&mut twin, -1e-3).force_n[2].abs() / peak;
        println!("{preset}: {:.2} % of {peak:.4} N is left", 100.0 * left);
        assert!(peak > 1e-3, "{preset}: {peak} N");
        assert!(left < 0.02, "{preset}: {left} of the peak is left");
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let scene = scene("needle_insertion", &[]);
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut twin = Twin::new(&scene).unwrap();
            assert_eq!(twin.threads(), threads);
            (digits(&travel(&mut twin, 0.0, 2e-3, 20)), field(&twin))
        })
    };
    let one = run(1);
    for threads in [2, 4] {
        assert!(run(threads) == one, "{threads} threads give other bits");
    }
}
