//! Poses that no careful user would send: the twin answers with a finite force that is right once it rests, or refuses.
#![allow(clippy::unwrap_used, clippy::panic)]

mod coarse;

use std::collections::BTreeMap;
use std::sync::Mutex;

use coarse::{alone, at_depth, scene, travel};
use needle_twin::twin::{Halt, Prediction, StampedPose, Twin};

const DEPTH: f64 = 4e-3;

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
    assert!(rest(&mut twin, 5e-3).abs() < 1.0);
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
    let mut twin = twin("indentation");
    let stamps = [0.0, 0.1, 0.1, 0.05, 10.0, -3.0, 1e9, 1e-9];
    for i in 1..=400_u32 {
        let pose = twin.pose_at_depth(DEPTH * f64::from(i) / 400.0);
        let time_s = stamps[i as usize % stamps.len()];
        assert!(finite(&twin.step(StampedPose { time_s, pose }).unwrap()));
    }
    assert_near(rest(&mut twin, DEPTH), careful("indentation"), 0.01, "without relaxation, time is no matter");
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

#[test]
fn nothing_drifts_while_the_instrument_trembles() {
    let mut twin = twin("indentation");
    travel(&mut twin, 0.0, 1e-3, 100);
    let start = rest(&mut twin, 1e-3);
    let mut steps = 0;
    while steps < 20_000 {
        // a tremor of a nanometre is answered with a step
        steps += at_depth(&mut twin, 1e-3 + 1e-9 * f64::from(steps % 2)).steps.max(1);
    }
    assert_near(rest(&mut twin, 1e-3), start, 1e-3, "after 20 000 steps at one depth");
}

#[test]
fn unloading_gives_everything_back() {
    let deep = [("motion.depth_m", "0.009"), ("discretisation.edge_refinement", "0.25")];
    let mut twin = alone(|| Twin::new(&scene("indentation", &deep)).unwrap());
    let peak = travel(&mut twin, 0.0, 8e-3, 2000).last().unwrap().force_n[2];
    travel(&mut twin, 8e-3, 0.0, 2000);
    let left = rest(&mut twin, -1e-6).abs() / peak;
    let mut u = Vec::new();
    twin.displacements(&mut u);
    let moved = u.iter().flatten().fold(0.0_f64, |a, b| a.max(b.abs())) / 8e-3;
    println!("left of 8 mm: force {:.2} %, displacement {:.2} %", 100.0 * left, 100.0 * moved);
    assert!(left < 0.01 && moved < 0.01, "{left} {moved}");
}
