//! What the steps make of the force decides about a run, and not how far the base lags behind.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::Health;
use needle_estimate::compare::{Keep, Run, Session};
use testkit::coarse::alone;

/// A ball that presses stiffening tissue without friction.
const BALL: &str = r#"
name = "ball"
[sample]
shape = "cylinder"
diameter_m = 0.05
height_m = 0.033
[material]
model = "veronda_westmann"
shear_modulus_pa = 4500.0
stiffening_exponent = 3.0
poisson_ratio = 0.48
density_kg_per_m3 = 1000.0
[instrument]
kind = "indenter"
diameter_m = 0.008
tip = "sphere"
contact = "frictionless"
[motion]
depth_m = 0.0034
speed_m_per_s = 0.005
pose_hz = 500.0
"#;

fn run(scene: &Scene) -> Run {
    alone(|| Session::new(scene, "test", Keep::ANSWERS).unwrap().unwatched(Session::motion(&scene.motion.unwrap())))
}

/// The run, and how far its forces are from those with a tenth of the tolerance, over the peak, as a root mean square.
fn off(scene: &Scene) -> (Run, f64) {
    let finer = scene.with(&[Override::text("stepping.tolerance", "0.001", "test")]).unwrap();
    let (run, finer) = (run(scene), run(&finer));
    let peak = finer.answers.iter().map(|a| a.predicted_n.abs()).fold(0.0, f64::max);
    let squares = run.answers.iter().zip(&finer.answers).map(|(a, b)| (a.predicted_n - b.predicted_n).powi(2));
    let rms = (squares.sum::<f64>() / run.answers.len() as f64).sqrt() / peak;
    println!("off by {rms:.5}, steps {:?}, imbalance {:.5}", run.step_error_rms, run.force_imbalance_rms);
    (run, rms)
}

/// The base lags by more than the accuracy while the force is right: the run holds.
#[test]
fn a_base_that_lags_is_no_error_of_the_force() {
    let (run, off) = off(&Scene::from_toml(BALL, "ball").unwrap());
    let bound = Health::MEAN_IMBALANCE * run.accuracy;
    assert!(run.force_imbalance_rms > bound, "it shows nothing of a lag");
    assert!(off < 0.3 * bound && off < run.step_error_rms.unwrap(), "{off}");
    assert!(run.unstable().is_empty(), "{:?}", run.unstable());
}

/// A needle that ends a millimetre deep at 5 mm/s is off by as much as the accuracy: the run does not hold, and what it says is no less than the error.
#[test]
fn a_force_that_is_off_by_the_accuracy_does_not_hold() {
    let changes = [("motion.depth_m", "0.001"), ("motion.speed_m_per_s", "0.005")];
    let changes = changes.map(|(path, value)| Override::text(path, value, "test"));
    let (run, off) = off(&Scene::preset("needle_insertion").unwrap().with(&changes).unwrap());
    assert!(off > 0.8 * run.accuracy && off < run.step_error_rms.unwrap(), "{off}");
    assert!(run.unstable().join("\n").contains("Error of the steps, r.m.s."), "{:?}", run.unstable());
}

/// Slip decides what follows, and no inertia shows it: of a needle with friction the imbalance counts in full.
#[test]
fn the_imbalance_of_a_needle_with_friction_counts_in_full() {
    let depth = Override::text("motion.depth_m", "0.0004", "test");
    let once = Override::text("motion.insertions", "1", "test");
    let run = run(&Scene::preset("layered_tissue").unwrap().with(&[depth, once]).unwrap());
    assert!(run.force_imbalance_rms > 0.0);
    assert_eq!(run.step_error_rms, Some(run.force_imbalance_rms));
}
