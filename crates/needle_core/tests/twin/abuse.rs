//! Poses that no careful user would send: the twin answers with a finite force that is right once it rests, or refuses.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::sync::Mutex;

use needle_core::scene::{Override, Scene, SceneError};
use needle_core::twin::{Halt, Pose, Prediction, StampedPose, Twin};
use testkit::coarse::{alone, at_depth, scene, travel};

const DEPTH: f64 = 5e-3;

fn twin(preset: &str) -> Twin {
    alone(|| Twin::new(&scene(preset, &[("motion.depth_m", "0.006")])).unwrap())
}

/// Poses at the same depth until the tissue is at rest.
fn rest(twin: &mut Twin, depth_m: f64) -> f64 {
    for _ in 0..3000 {
        let answer = at_depth(twin, depth_m);
        assert!(finite(&answer));
        if answer.steps == 0 {
            return answer.force_n[2];
        }
    }
    f64::NAN // never at rest
}

fn finite(answer: &Prediction) -> bool {
    answer.force_n.iter().chain(&answer.base_force_n).all(|f| f.is_finite())
}

/// Force at [`DEPTH`] after a careful approach, N; found once per preset.
fn careful(preset: &'static str) -> f64 {
    static KNOWN: Mutex<BTreeMap<&str, f64>> = Mutex::new(BTreeMap::new());
    *KNOWN.lock().unwrap().entry(preset).or_insert_with(|| {
        let mut twin = twin(preset);
        travel(&mut twin, 0.0, DEPTH, 400);
        rest(&mut twin, DEPTH)
    })
}

fn assert_near(found: f64, expected: f64, tolerance: f64, what: &str) {
    println!("{what}: {found:.6} N of {expected:.6} N");
    assert!((found / expected - 1.0).abs() < tolerance, "{what}: {found} of {expected}");
}

#[test]
fn a_jump_of_millimetres() {
    for preset in ["compression", "indentation"] {
        let mut twin = twin(preset);
        assert!(finite(&at_depth(&mut twin, DEPTH)));
        assert_near(rest(&mut twin, DEPTH), careful(preset), 0.01, preset);
    }
}

#[test]
fn a_needle_that_jumps() {
    let mut twin = twin("needle_insertion");
    assert!(finite(&at_depth(&mut twin, 5e-3)), "5 mm in one pose");
    let (jumped, seen) = (rest(&mut twin, 5e-3), careful("needle_insertion"));
    assert_near(jumped, seen, 0.05, "the way between was walked");
    travel(&mut twin, 5e-3, 0.0, 200);
    assert!(rest(&mut twin, -1e-3).abs() < 1e-3, "nothing is left");
}

#[test]
fn a_hundred_millimetres_per_second() {
    for preset in ["indentation", "needle_insertion"] {
        let mut twin = twin(preset);
        // 0.1 mm per pose of 1 kHz
        assert!(travel(&mut twin, 0.0, DEPTH, 40).iter().all(finite));
        assert_near(rest(&mut twin, DEPTH), careful(preset), 0.02, preset);
    }
}

#[test]
fn reversed_at_every_pose() {
    for preset in ["indentation", "needle_insertion"] {
        let mut twin = twin(preset);
        travel(&mut twin, 0.0, DEPTH, 400);
        for i in 0..400 {
            let depth = DEPTH - if i % 2 == 0 { 40e-6 } else { 0.0 };
            assert!(finite(&at_depth(&mut twin, depth)));
        }
        assert_near(rest(&mut twin, DEPTH), careful(preset), 0.01, preset);
    }
}

#[test]
fn stamps_in_any_order_and_gaps() {
    // irregular, repeated, out of order, 10 s and 30 years late
    let stamps = [0.0, 0.1, 0.1, 0.05, 10.0, -3.0, 1e9, 1e-9];
    let mut twin = twin("indentation");
    for i in 1..=400_u32 {
        let pose = twin.pose_at_depth(DEPTH * f64::from(i) / 400.0);
        let time_s = stamps[i as usize % stamps.len()];
        assert!(finite(&twin.step(StampedPose { time_s, pose }).unwrap()));
    }
    assert_near(rest(&mut twin, DEPTH), careful("indentation"), 0.01, "without relaxation, time is no matter");
}

#[test]
fn poses_at_any_rate() {
    // 10 mm/s at 10 Hz is 1 mm per pose, at 1 kHz 10 um
    for (hz, poses) in [(10.0, 5), (1000.0, 500)] {
        let mut twin = twin("indentation");
        for i in 1..=poses {
            let pose = twin.pose_at_depth(DEPTH * f64::from(i) / f64::from(poses));
            assert!(finite(&twin.step(StampedPose { time_s: f64::from(i) / hz, pose }).unwrap()));
        }
        assert_near(rest(&mut twin, DEPTH), careful("indentation"), 0.01, &format!("{hz} Hz"));
    }
}

/// With stress relaxation time matters, and the stamps are all that the twin knows of it.
#[test]
fn a_relaxing_tissue_with_stamps_in_any_order() {
    let prony = [("material.prony_shares", "[0.4]"), ("material.prony_times_s", "[0.5]"), ("motion.depth_m", "0.006")];
    let end = |stamps: &dyn Fn(u32) -> f64| {
        let mut twin = alone(|| Twin::new(&scene("indentation", &prony)).unwrap());
        let mut force = f64::NAN;
        for i in 1..=2000_u32 {
            let pose = twin.pose_at_depth(DEPTH * f64::from(i.min(200)) / 200.0);
            let answer = twin.step(StampedPose { time_s: stamps(i), pose }).unwrap();
            assert!(finite(&answer), "pose {i}");
            force = answer.force_n[2];
        }
        force
    };
    let regular = end(&|i| 0.01 * f64::from(i));
    // every fifth pose repeated, every seventh out of order by 50 ms, a gap of 10 s on the way
    let muddled = |i: u32| {
        let i = i - u32::from(i.is_multiple_of(5));
        0.01 * f64::from(i) - if i.is_multiple_of(7) { 0.05 } else { 0.0 } + if i > 100 { 10.0 } else { 0.0 }
    };
    assert_near(end(&muddled), regular, 0.01, "20 s at depth, 40 relaxation times");
}

/// A coarse scene of a needle, 6 mm deep unless changed.
fn needle_with(changes: &[(&str, &str)]) -> Result<Scene, SceneError> {
    let keys = [&[("motion.depth_m", "0.006")], changes].concat();
    let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    scene("needle_insertion", &[]).with(&keys)
}

#[test]
fn a_needle_where_needles_are_not_expected() {
    // beside the axis, near the wall, oblique
    let on_axis = careful("needle_insertion");
    for (changes, least, most) in [
        (&[("instrument.entry_x_m", "0.004")][..], 0.9, 1.3),
        (&[("instrument.entry_x_m", "0.012")], 0.2, 1.5),
        (&[("instrument.tilt_rad", "0.3"), ("instrument.azimuth_rad", "0.7")], 0.5, 2.0),
    ] {
        let mut twin = alone(|| Twin::new(&needle_with(changes).unwrap()).unwrap());
        assert!(travel(&mut twin, 0.0, DEPTH, 400).iter().all(finite), "{changes:?}");
        let share = rest(&mut twin, DEPTH) / on_axis;
        println!("{changes:?}: {share:.2} of the force on the axis");
        assert!((least..most).contains(&share), "{changes:?}: {share}");
        assert_eq!(twin.recoveries(), 0, "{changes:?}");
    }
}

/// Outside, through the side, deeper than the sample is high: refused with the key at fault.
#[test]
fn a_needle_that_misses_the_sample_is_refused() {
    for (changes, why) in [
        (&[("instrument.entry_x_m", "0.02")][..], "top face"),
        (&[("instrument.entry_x_m", "0.012"), ("instrument.tilt_rad", "0.6")], "leaves the sample"),
        (&[("motion.depth_m", "0.02")], "sample.height_m"),
        (&[("motion.depth_m", "nan")], "motion.depth_m"),
        (&[("motion.depth_m", "inf")], "motion.depth_m"),
    ] {
        let refusal = needle_with(changes).unwrap_err().to_string();
        assert!(refusal.contains(why), "{changes:?}: {refusal}");
    }
    // and so are its poses, which leave the state as it was
    let mut twin = twin("needle_insertion");
    travel(&mut twin, 0.0, 2e-3, 200);
    let before = rest(&mut twin, 2e-3);
    let good = twin.pose_at_depth(2.1e-3);
    let moved = |k: usize, by: f64| StampedPose {
        time_s: 0.0,
        pose: Pose { tip: std::array::from_fn(|i| good.tip[i] + if i == k { by } else { 0.0 }), ..good },
    };
    for pose in [
        moved(0, 0.02),
        moved(1, -0.014),
        moved(2, -0.016),
        moved(2, -1.0),
        moved(0, f64::NAN),
        moved(2, f64::INFINITY),
    ] {
        assert!(matches!(twin.step(pose), Err(Halt::Pose { .. })), "{pose:?}");
    }
    assert_eq!(rest(&mut twin, 2e-3), before, "the state is untouched");
}

#[test]
fn deeper_than_the_sample_and_outside_of_it() {
    let mut twin = twin("indentation");
    travel(&mut twin, 0.0, 1e-3, 100);
    let before = rest(&mut twin, 1e-3);
    for depth in [0.017, 0.05, 1e9] {
        let pose = twin.pose_at_depth(depth);
        assert!(matches!(twin.step(StampedPose { time_s: 0.0, pose }), Err(Halt::Pose { .. })), "{depth} m");
    }
    let mut aside = twin.pose_at_depth(1e-3);
    aside.tip[0] += 0.05;
    assert!(matches!(twin.step(StampedPose { time_s: 0.0, pose: aside }), Err(Halt::Pose { .. })));
    assert_eq!(rest(&mut twin, 1e-3), before, "the state is untouched");
}

/// Hours at one depth. A tremor of a nanometre is answered with steps; an instrument at rest with none.
#[test]
fn nothing_drifts_in_300_000_steps() {
    let keys = [
        ("discretisation.dimension", "axisymmetric"),
        ("discretisation.spacing_m", "0.004"),
        ("stepping.min_steps_per_pose", "1000"),
    ];
    for preset in ["indentation", "needle_insertion"] {
        let mut twin = alone(|| Twin::new(&scene(preset, &keys)).unwrap());
        travel(&mut twin, 0.0, 2.5e-3, 250);
        let start = rest(&mut twin, 2.5e-3);
        let before = twin.steps();
        for i in 0.. {
            assert!(finite(&at_depth(&mut twin, 2.5e-3 + 1e-9 * f64::from(i % 2))));
            if twin.steps() - before >= 300_000 {
                break;
            }
        }
        assert_near(rest(&mut twin, 2.5e-3), start, 1e-3, preset);
        assert_eq!(twin.recoveries(), 0);
    }
}

/// Deep and back: nothing is left of the force, nothing of the displacement.
#[test]
fn unloading_gives_everything_back() {
    let half = ("discretisation.dimension", "axisymmetric");
    for (preset, depth, changes) in [
        // in space, on a coarse cloud
        ("indentation", 13e-3, &[("discretisation.edge_refinement", "0.25"), ("motion.depth_m", "0.0135")][..]),
        // a fine edge, whose cells fold where tissue may pass the wall: then a tenth of a millimetre is left at 100 nodes
        ("indentation", 13e-3, &[("discretisation.edge_refinement", "0.08"), ("motion.depth_m", "0.0135")]),
        // the half planes, coarser than they ship
        ("indentation", 13e-3, &[half, ("discretisation.edge_refinement", "0.08"), ("motion.depth_m", "0.0135")]),
        ("compression", 5.1e-3, &[half, ("motion.depth_m", "0.0055")]),
        ("needle_insertion", 15e-3, &[half, ("motion.depth_m", "0.0151")]),
    ] {
        let mut twin = alone(|| Twin::new(&scene(preset, changes)).unwrap());
        // 10 um per pose
        let poses = (depth / 1e-5) as u32;
        let peak = travel(&mut twin, 0.0, depth, poses).last().unwrap().force_n[2];
        travel(&mut twin, depth, 0.0, poses);
        let left = rest(&mut twin, -1e-6).abs() / peak;
        let mut u = Vec::new();
        twin.displacements(&mut u);
        let moved = u.iter().flatten().fold(0.0_f64, |a, b| a.max(b.abs())) / depth;
        println!(
            "{preset}, {} nodes: left of {:.1} mm: force {:.3} %, displacement {:.3} %",
            twin.nodes(),
            1e3 * depth,
            100.0 * left,
            100.0 * moved
        );
        assert!(peak > 0.0 && left < 0.01 && moved < 0.01, "{preset}: {left} {moved}");
        assert_eq!(twin.recoveries(), 0, "{preset}");
    }
}

/// The twin takes steps until the tissue stands still, also where its forces balance long before: with crushed cells at a fine edge in
/// space and the wide supports of consistent gradients, single nodes come back last.
#[test]
fn at_rest_no_node_is_on_its_way() {
    let keys = [
        ("discretisation.dimension", "mirrored"),
        ("discretisation.spacing_m", "0.008"),
        ("discretisation.edge_refinement", "0.03"),
        ("motion.depth_m", "0.0135"),
    ];
    let mut twin = alone(|| Twin::new(&scene("indentation", &keys)).unwrap());
    travel(&mut twin, 0.0, 13e-3, 650);
    travel(&mut twin, 13e-3, 0.0, 650);
    assert!(rest(&mut twin, -1e-6).abs() < 1e-5);
    let mut u = Vec::new();
    twin.displacements(&mut u);
    let left = u.iter().map(|u| u[0].hypot(u[1]).hypot(u[2])).fold(0.0, f64::max) / 13e-3;
    println!("{} nodes: {:.4} % of 13 mm", twin.nodes(), 100.0 * left);
    // 0.02 % where balanced forces count as rest
    assert!(left < 5e-5, "{left:.2e}");
}

/// A gap in the poses makes the way after it a jump, and so does a first pose inside.
#[test]
fn a_needle_that_was_not_seen_on_its_way_is_followed() {
    let scene = Scene::preset("needle_insertion").unwrap();
    let mut twin = Twin::new(&scene).unwrap();
    let at = |twin: &Twin, time_s: f64, depth_m: f64| StampedPose { time_s, pose: twin.pose_at_depth(depth_m) };
    // From where, where to, m: through the puncture, deeper, back, and from outside.
    for (from, to) in [(0.5e-3, 2.5e-3), (0.2e-3, 1.5e-3), (1.5e-3, 2.9e-3), (2.9e-3, 0.5e-3), (-5e-3, 2.5e-3)] {
        let mut walk = |places: &[f64]| {
            twin.reset();
            let mut time_s = 0.0;
            for ends in places.windows(2) {
                let poses = ((ends[1] - ends[0]).abs() / 5e-6).ceil();
                for i in 1..=poses as u32 {
                    time_s += 0.005;
                    let pose = at(&twin, time_s, ends[0] + (ends[1] - ends[0]) * f64::from(i) / poses);
                    assert!(twin.step(pose).unwrap().force_n[2].is_finite());
                }
            }
            // after a gap, there if it is not yet, until at rest
            (0..400).fold(0.0, |_, i| {
                let pose = at(&twin, time_s + 1.5 + 0.005 * f64::from(i), to);
                twin.step(pose).unwrap().force_n[2]
            })
        };
        let start = f64::min(from, 0.0) - 1e-4;
        let (seen, unseen) = (walk(&[start, from, to]), walk(&[start, from]));
        println!("{:.1} to {:.1} mm: {unseen:.4} N, seen {seen:.4} N", 1e3 * from, 1e3 * to);
        assert!((unseen - seen).abs() < 0.05 * seen.abs() + 1e-4, "{from} to {to}: {unseen} N, seen {seen} N");
    }
    // of a way through the air nothing counts
    twin.reset();
    for (i, depth_m) in [-9.0, 1e-3, -9.9, -1.0].into_iter().enumerate() {
        let steps = twin.steps();
        let pose = at(&twin, i as f64, depth_m);
        assert!(twin.step(pose).unwrap().force_n[2].is_finite());
        assert!(twin.steps() - steps < 20_000, "{depth_m}: {} steps", twin.steps() - steps);
    }
}
