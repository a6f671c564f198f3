//! What a needle may do besides going straight in: sideways, tilted, out and in again, beside the axis.
//!
//! There is no reference solution of these motions: the tests ask for sense. The clouds are coarse and irregular, so
//! mirrored motions agree to a few per cent, not exactly.
#![allow(clippy::unwrap_used)]

use needle_core::twin::{Halt, Prediction, StampedPose, Twin};
use testkit::coarse::{at_depth, rest, scene, travel};

const DEPTH: f64 = 2.5e-3;

fn inserted() -> Twin {
    let mut twin = Twin::new(&scene("needle_insertion", &[])).unwrap();
    travel(&mut twin, 0.0, DEPTH, 100);
    let pose = twin.pose_at_depth(DEPTH);
    rest(&mut twin, pose);
    twin
}

/// Moves an inserted needle sideways (m) and tilts it (sine), in 40 poses, and waits for rest.
fn move_to(twin: &mut Twin, from: [f64; 3], to: [f64; 3]) -> Prediction {
    let pose = |twin: &Twin, s: f64| {
        let [x, y, tilt] = [0, 1, 2].map(|k| from[k] + s * (to[k] - from[k]));
        let mut pose = twin.pose_at_depth(DEPTH);
        pose.tip[0] += x;
        pose.tip[1] += y;
        pose.axis = [tilt, 0.0, -(1.0 - tilt * tilt).sqrt()];
        pose
    };
    for i in 1..=40 {
        let pose = pose(twin, f64::from(i) / 40.0);
        twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
    }
    let pose = pose(twin, 1.0);
    rest(twin, pose)
}

#[test]
fn an_inserted_needle_that_moves_sideways_is_pushed_back() {
    let mut twin = inserted();
    let start = at_depth(&mut twin, DEPTH).force_n;
    let mut push = |from: f64, to: f64| move_to(&mut twin, [from, 0.0, 0.0], [to, 0.0, 0.0]).force_n[0] - start[0];
    let (half, whole) = (push(0.0, 0.25e-3), push(0.25e-3, 0.5e-3));
    println!("lateral force {half:.6} N at 0.25 mm, {whole:.6} N at 0.5 mm; axial {:.6} N", start[2]);
    assert!(whole < 0.0 && half < 0.0, "the tissue pushes back");
    assert!((whole / half - 2.0).abs() < 0.2, "small motions are nearly linear: {}", whole / half);
    let other = push(0.5e-3, -0.5e-3);
    assert!((other / -whole - 1.0).abs() < 0.1, "mirrored motion, mirrored force: {other} {whole}");
    let back = push(-0.5e-3, 0.0);
    assert!(back.abs() < 0.03 * whole.abs(), "nothing is left when the needle is back: {back} of {whole}");
}

/// Into the tissue and then at once sideways, 5 um a pose: the tissue does not know that direction yet, and neither estimate of the error sees it.
#[test]
fn a_turn_into_a_new_direction_gets_the_steps_that_it_needs() {
    const WAY: f64 = 5e-6;
    let turned = |steps: &[(&str, &str)]| -> Vec<Prediction> {
        let mut twin = Twin::new(&scene("needle_insertion", steps)).unwrap();
        travel(&mut twin, 0.0, DEPTH, (DEPTH / WAY).round() as u32);
        let aside = |twin: &mut Twin, x: f64| {
            let mut pose = twin.pose_at_depth(DEPTH);
            pose.tip[0] += x;
            twin.step(StampedPose { time_s: 0.0, pose }).unwrap()
        };
        let poses = (1..=60).chain((0..60).rev());
        poses.map(|i| aside(&mut twin, WAY * f64::from(i))).collect()
    };
    let (own, many) = (turned(&[]), turned(&[("stepping.min_steps_per_pose", "40")]));
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let errors = own
        .iter()
        .zip(&many)
        .map(|(a, b)| length(std::array::from_fn(|k| a.force_n[k] - b.force_n[k])) / length(b.force_n));
    let largest = errors.fold(0.0, f64::max);
    let steps = |of: &[Prediction]| of.iter().map(|p| p.steps).max().unwrap_or_default();
    println!(
        "{largest:.3} of the force; {} steps at most where it turns, {} on the way back",
        steps(&own[..20]),
        steps(&own[80..])
    );
    assert!(largest < 0.1, "{largest} of the force");
    let back = steps(&own[80..]);
    assert!(back < steps(&own[..20]), "in a direction that is known it takes fewer: {back}");
}

#[test]
fn work_is_never_gained_on_a_closed_way() {
    let mut twin = inserted();
    let way = [[0.0, 0.0], [4e-4, 0.0], [4e-4, 4e-4], [0.0, 4e-4], [0.0, 0.0]];
    let (mut work, mut moved) = (0.0, 0.0);
    let mut last = at_depth(&mut twin, DEPTH).force_n;
    for pair in way.windows(2) {
        for i in 1..=40 {
            let s = f64::from(i) / 40.0;
            let mut pose = twin.pose_at_depth(DEPTH);
            let step = [0, 1].map(|k| (pair[1][k] - pair[0][k]) / 40.0);
            (0..2).for_each(|k| pose.tip[k] += pair[0][k] + s * (pair[1][k] - pair[0][k]));
            let force = twin.step(StampedPose { time_s: 0.0, pose }).unwrap().force_n;
            // the hand's work against the tissue's force
            let gain: f64 = (0..2).map(|k| -0.5 * (force[k] + last[k]) * step[k]).sum();
            work += gain;
            moved += gain.abs();
            last = force;
        }
    }
    println!("work {work:.3e} J of {moved:.3e} J moved");
    assert!(moved > 0.0 && work > -0.02 * moved, "work {work:.3e} J of {moved:.3e} J");
}

#[test]
fn a_tilted_needle_is_pushed_upright() {
    let mut twin = inserted();
    // the tip stays, the shaft leans: (tilt, 0, -1) points into the sample, so the shaft goes to -x
    let right = move_to(&mut twin, [0.0; 3], [0.0, 0.0, 0.1]).force_n[0];
    let left = move_to(&mut twin, [0.0, 0.0, 0.1], [0.0, 0.0, -0.1]).force_n[0];
    println!("tilted: {right:.6} N, {left:.6} N");
    assert!(right > 0.0 && left < 0.0, "the tissue resists the lean");
    assert!((right / -left - 1.0).abs() < 0.15, "mirrored");
}

#[test]
fn out_and_in_again_gives_the_same_force() {
    let mut twin = inserted();
    let first = at_depth(&mut twin, DEPTH).force_n[2];
    travel(&mut twin, DEPTH, -1e-3, 150);
    let out = at_depth(&mut twin, -1e-3);
    assert!(out.force_n.iter().all(|f| f.abs() < 0.01 * first), "{:?} of {first}", out.force_n);
    travel(&mut twin, -1e-3, DEPTH, 150);
    let pose = twin.pose_at_depth(DEPTH);
    let second = rest(&mut twin, pose).force_n[2];
    println!("first {first:.6} N, again {second:.6} N");
    assert!((second / first - 1.0).abs() < 0.02, "{second} {first}");
}

#[test]
fn mirrored_entry_points_have_mirrored_forces() {
    let force = |x: &str| {
        let mut twin = Twin::new(&scene("needle_insertion", &[("instrument.entry_x_m", x)])).unwrap();
        travel(&mut twin, 0.0, DEPTH, 100);
        let pose = twin.pose_at_depth(DEPTH);
        rest(&mut twin, pose).force_n
    };
    let (left, right) = (force("-0.005"), force("0.005"));
    println!("beside the axis: {left:?} {right:?}");
    assert!((left[2] / right[2] - 1.0).abs() < 0.05, "{left:?} {right:?}");
    assert!((left[0] + right[0]).abs() < 0.05 * right[2], "{left:?} {right:?}");
}

/// The resting force at DEPTH along an oblique path, along its axis and in x, y.
fn oblique(tilt: &str, azimuth: &str) -> (f64, [f64; 2]) {
    let changes = [("instrument.tilt_rad", tilt), ("instrument.azimuth_rad", azimuth)];
    let mut twin = Twin::new(&scene("needle_insertion", &changes)).unwrap();
    travel(&mut twin, 0.0, DEPTH, 100);
    let pose = twin.pose_at_depth(DEPTH);
    let force = rest(&mut twin, pose).force_n;
    (-(0..3).map(|k| force[k] * pose.axis[k]).sum::<f64>(), [force[0], force[1]])
}

#[test]
fn mirrored_oblique_paths_have_mirrored_forces() {
    let (upright, _) = oblique("0", "0");
    let (right, left, back) = (oblique("0.4", "0"), oblique("0.4", "3.14159265"), oblique("0.4", "1.57079633"));
    println!("upright {upright:.6} N; to +x {right:?}, to -x {left:?}, to +y {back:?}");
    for side in [right, left, back] {
        assert!((side.0 / right.0 - 1.0).abs() < 0.05, "the way round doesn't matter: {} {}", side.0, right.0);
        assert!((side.0 / upright - 1.0).abs() < 0.15, "no other order of force than upright: {} {upright}", side.0);
    }
    assert!(right.1[0] < -0.1 * right.0, "pushed back along the path, which goes to +x: {right:?}");
    assert!((right.1[0] + left.1[0]).abs() < 0.05 * right.0, "{right:?} {left:?}");
    assert!((right.1[0] - back.1[1]).abs() < 0.05 * right.0, "{right:?} {back:?}");
    assert!(right.1[1].abs() < 0.05 * right.0 && left.1[1].abs() < 0.05 * right.0, "no force out of the plane");
}

#[test]
fn an_oblique_needle_leaves_nothing_behind() {
    let mut twin = Twin::new(&scene("needle_insertion", &[("instrument.tilt_rad", "0.4")])).unwrap();
    let peak = travel(&mut twin, 0.0, DEPTH, 100).last().unwrap().force_n[2];
    travel(&mut twin, DEPTH, -1e-3, 150);
    let out = at_depth(&mut twin, -1e-3);
    assert!(out.force_n.iter().all(|f| f.abs() < 0.01 * peak), "{:?} of {peak}", out.force_n);
}

#[test]
fn a_path_that_leaves_the_sample_is_refused() {
    let scene = needle_core::scene::Scene::preset("needle_insertion").unwrap();
    let change = |path, value| needle_core::scene::Override::text(path, value, "test");
    let said = scene.with(&[change("instrument.tilt_rad", "0.6"), change("instrument.entry_x_m", "0.012")]);
    let said = said.unwrap_err().to_string();
    assert!(said.contains("instrument.tilt_rad") && said.contains("leaves the sample"), "{said}");
}

#[test]
fn a_needle_enters_on_its_path() {
    let mut twin = Twin::new(&scene("needle_insertion", &[])).unwrap();
    let mut pose = twin.pose_at_depth(1e-3);
    pose.tip[0] += 0.9e-3;
    let refused = twin.step(StampedPose { time_s: 0.0, pose });
    assert!(matches!(&refused, Err(Halt::Pose { reason }) if reason.contains("beside")), "{refused:?}");
    let mut pose = twin.pose_at_depth(1e-3);
    pose.axis = [0.2, 0.0, -(1.0 - 0.04_f64).sqrt()];
    let refused = twin.step(StampedPose { time_s: 0.0, pose });
    assert!(matches!(&refused, Err(Halt::Pose { reason }) if reason.contains("axis")), "{refused:?}");
}
