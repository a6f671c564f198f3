//! What a frictional needle's resistance depends on beside the way: friction on the pressure of the tissue, cutting on the speed.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use needle_core::scene::Scene;
use needle_core::twin::{Pose, StampedPose, Twin};
use testkit::coarse::alone;

const SAMPLE: &str = "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.030\nheight_m = 0.017\n[material]\nmodel = \
    \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n";

fn built(needle: &str, cloud: &str, motion: &str) -> Twin {
    let scene = format!(
        "{SAMPLE}[instrument]\nkind = \"needle\"\ninteraction = \"frictional\"\n{needle}[discretisation]\n{cloud}[motion]\n{motion}"
    );
    alone(|| Twin::new(&Scene::from_toml(&scene, "needle.toml").unwrap()).unwrap())
}

/// Of a needle 12 mm deep that was moved sideways and then pulled out by 1.5 mm: force sideways before it is pulled, and along the
/// axis in the end, N.
fn pulled_where_it_presses(coefficient: f64, aside_m: f64) -> [f64; 2] {
    let needle = format!(
        "diameter_m = 0.002\ncapture_radius_m = 0.001\nfriction_n_per_m = 1.0\nshaft_friction_coefficient = {coefficient}\n"
    );
    let cloud = "dimension = \"full\"\nspacing_m = 2.5e-3\nedge_refinement = 0.2\n";
    let mut twin = built(&needle, cloud, "start_depth_m = 0.012\ndepth_m = 0.013\n");
    let mut step = |aside: f64, depth: f64| {
        let pose = Pose { tip: [aside, 0.0, 0.017 - depth], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 };
        twin.step(StampedPose { time_s: 0.0, pose }).unwrap()
    };
    let beside = (1..=30).map(|k| step(aside_m * f64::from(k) / 30.0, 0.012)).last().unwrap();
    let out = (1..=150).map(|k| step(aside_m, 0.012 - 1e-5 * f64::from(k))).last().unwrap();
    println!("coefficient {coefficient}, {aside_m} m aside: {:?} N, then {:?} N", beside.force_n, out.force_n);
    [-out.force_n[0], out.force_n[2]]
}

/// A long rigid cylinder that is bonded sideways to incompressible tissue and moved through it carries the same traction everywhere on its
/// circumference (as in creeping flow): a force F per length presses with F cos(theta) / (2 pi R) on half of it, F / pi in all.
#[test]
fn friction_grows_with_the_pressure_on_the_shaft() {
    let [without, with] = [0.0, 0.5].map(|coefficient| pulled_where_it_presses(coefficient, 1.5e-4));
    let expected = 0.5 * with[0] / PI;
    let more = without[1] - with[1];
    println!("{more} N more, expected {expected} N; without {without:?}");
    assert!((more / expected - 1.0).abs() < 0.1, "{more} {expected}");
}

const FINE: &str = "spacing_m = 2.33e-3\nedge_refinement = 0.11\ngrowth = 0.3\n";

/// A needle from 6 mm on three millimetres in at a speed in m/s: force along the axis, N, and depth to which it has cut, m, at each
/// tenth of
/// the way.
fn cuts(rate: &str, speed: f64, poses: u32) -> Vec<[f64; 2]> {
    stamped(rate, poses, |k| 3e-3 * f64::from(k) / f64::from(poses) / speed)
}

/// The same with stamps in s of pose k.
fn stamped(rate: &str, poses: u32, stamp: impl Fn(u32) -> f64) -> Vec<[f64; 2]> {
    let needle = format!("diameter_m = 0.001\ncapture_radius_m = 0.0005\ncutting_force_n = 0.003\n{rate}");
    let mut twin = built(&needle, FINE, "start_depth_m = 0.006\ndepth_m = 0.0095\n");
    let mut at = |k: u32| {
        let way = 3e-3 * f64::from(k) / f64::from(poses);
        let pose = twin.pose_at_depth(0.006 + way);
        let answer = twin.step(StampedPose { time_s: stamp(k), pose }).unwrap();
        [answer.force_n[2], twin.cut_depth().unwrap()]
    };
    let answers: Vec<[f64; 2]> = (0..=poses).map(&mut at).collect();
    answers.into_iter().step_by(poses as usize / 10).collect()
}

const RATE: &str = "cutting_rate_exponent = 0.5\ncutting_rate_reference_m_per_s = 1e-3\n";

/// Mean force, N, and the tip's mean speed in the tissue over that of the needle, in the second half of the way.
fn plateau(rate: &str, speed: f64) -> [f64; 2] {
    let all = cuts(rate, speed, 200);
    let mean = all[6..].iter().map(|a| a[0]).sum::<f64>() / all[6..].len() as f64;
    [mean, (all[10][1] - all[5][1]) / 1.5e-3]
}

#[test]
fn the_cutting_force_grows_with_a_power_of_the_speed() {
    // below the reference speed, and without the exponent, the force is the same
    let slow = [plateau("", 9e-3), plateau(RATE, 1e-4)];
    assert!(slow.iter().all(|[force, _]| (force / 0.003 - 1.0).abs() < 0.01), "{slow:?}");
    let fast = [2.0_f64, 4.0].map(|times| {
        let [force, speed] = plateau(RATE, 1e-3 * times);
        println!("{times} times the reference, {speed} of that in the tissue: {force} N");
        assert!((force / (0.003 * (speed * times).sqrt()) - 1.0).abs() < 0.02, "{times}: {force} N, {speed}");
        force
    });
    assert!((fast[1] / fast[0] / 2.0_f64.sqrt() - 1.0).abs() < 0.02, "{fast:?}");
}

#[test]
fn the_cutting_force_at_a_speed_does_not_depend_on_the_pose_rate() {
    let [fine, coarse] = [2000, 60].map(|poses| cuts(RATE, 4e-3, poses));
    let worst = fine.iter().zip(&coarse).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f64::max);
    println!("{:.4} of the plateau", worst / 0.006);
    assert!(worst < 0.01 * 0.006, "{fine:?} {coarse:?}");
}

/// A driver that hands over ten poses at once, stamped as it does so.
#[test]
fn the_cutting_force_at_a_speed_does_not_depend_on_bursts_of_stamps() {
    let (poses, each_s) = (200, 3e-3 / 4e-3 / 200.0);
    let even = stamped(RATE, poses, |k| each_s * f64::from(k));
    for (size, apart_s) in [(10, 1e-6), (10, 0.0), (4, 2e-4)] {
        let burst = |k: u32| each_s * f64::from(k - k % size + size) + apart_s * f64::from(k % size);
        let bursts = stamped(RATE, poses, burst);
        // the first tenth has the first bursts, before which nothing is known of the speed
        let worst = even.iter().zip(&bursts).skip(2).map(|(a, b)| (a[0] / b[0] - 1.0).abs()).fold(0.0, f64::max);
        println!("{size} poses {apart_s} s apart: {worst:.5}");
        assert!(worst < 0.01, "{size}, {apart_s}: {even:?} {bursts:?}");
    }
}
