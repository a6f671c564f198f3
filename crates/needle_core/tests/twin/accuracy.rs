//! Contract of `accuracy`: what the scene leaves to the program follows from it, and the force is as near a fine run as it says.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use testkit::coarse::{alone, at_depth, rest, travel};

fn with(preset: &str, changes: &[(&str, &str)]) -> Scene {
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset(preset).unwrap().with(&changes).unwrap()
}

/// Axial forces of 400 poses of 5 um.
fn forces(scene: &Scene) -> Vec<f64> {
    let mut twin = alone(|| Twin::new(scene).unwrap());
    travel(&mut twin, 0.0, 2e-3, 400).iter().map(|answer| answer.force_n[2]).collect()
}

#[test]
fn the_error_is_within_it_and_the_cloud_grows_with_it() {
    for preset in ["compression", "needle_insertion"] {
        let fine = forces(&with(preset, &[("accuracy", "0.002"), ("stepping.tolerance", "0.001")]));
        let peak = fine.iter().copied().fold(0.0, f64::max);
        let mut nodes = usize::MAX;
        for accuracy in [0.004, 0.01, 0.05] {
            let scene = with(preset, &[("accuracy", &accuracy.to_string())]);
            assert_eq!(scene.tolerance(), accuracy);
            let own = alone(|| Twin::new(&scene).unwrap()).nodes();
            assert!(own < nodes, "{preset}: {own} nodes at {accuracy}, {nodes} before");
            nodes = own;
            let squares = forces(&scene).iter().zip(&fine).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            let error = (squares / fine.len() as f64).sqrt() / peak;
            println!("{preset}, accuracy {accuracy}: {own} nodes, error {error:.5}");
            assert!(error < accuracy, "{preset}, {accuracy}: {error}");
        }
    }
}

#[test]
fn a_number_in_the_scene_is_kept_and_values_out_of_range_are_refused() {
    let given = [("accuracy", "0.05"), ("discretisation.spacing_m", "0.002"), ("stepping.tolerance", "0.004")];
    let scene = with("needle_insertion", &given);
    assert_eq!((scene.grading().unwrap().spacing.get(), scene.tolerance()), (0.002, 0.004));
    let standard = Scene::preset("needle_insertion").unwrap();
    assert_eq!(with("needle_insertion", &[("accuracy", "0.01")]).grading(), standard.grading());
    for bad in ["0", "0.001", "0.2", "nan", "fine"] {
        let changed = standard.with(&[Override::text("accuracy", bad, "test")]);
        let said = changed.unwrap_err().to_string();
        assert!(said.contains("accuracy") && said.contains("test"), "{said}");
    }
}

/// The first poses of an indenter at 5 mm/s: a body at rest that is met at once.
#[test]
fn the_first_forces_are_near_those_at_rest() {
    let scene = Scene::preset("indentation").unwrap();
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    for pose in 1..=6 {
        let depth = 5e-6 * f64::from(pose);
        let moving = at_depth(&mut twin, depth).force_n[2];
        let mut still = alone(|| Twin::new(&scene).unwrap());
        at_depth(&mut still, depth);
        let down = still.pose_at_depth(depth);
        let resting = rest(&mut still, down).force_n[2];
        println!("{depth} m: {moving:.6} N, {resting:.6} N at rest");
        let most = if pose < 3 { 1.5 } else { 0.35 };
        assert!((moving / resting - 1.0).abs() < most, "{depth} m: {moving} N, {resting} N at rest");
    }
}

/// The bound on the steps of a pose is one of the pose, however many strides it has.
#[test]
fn a_pose_of_a_needle_with_friction_has_no_more_steps_than_it_may() {
    for most in [20_u32, 200] {
        let scene = with("layered_tissue", &[("stepping.max_steps_per_pose", &most.to_string())]);
        let mut twin = alone(|| Twin::new(&scene).unwrap());
        let steps = travel(&mut twin, 0.0, 1.6e-3, 320).iter().map(|answer| answer.steps).max().unwrap();
        println!("at most {most}: {steps}");
        assert!(steps <= most && steps > most / 2, "{steps} of {most}");
    }
}

/// A pose that is long may pass several membranes: its bound grows with its way.
#[test]
fn long_poses_come_to_rest_as_well() {
    let mut twin = alone(|| Twin::new(&Scene::preset("layered_tissue").unwrap()).unwrap());
    let answers = travel(&mut twin, 0.0, 5e-3, 10);
    let steps = answers.iter().map(|answer| answer.steps).max().unwrap();
    let imbalance = answers.iter().map(|answer| answer.health.force_imbalance).fold(0.0, f64::max);
    println!("{steps} steps at most, imbalance {imbalance}");
    assert!(steps > 2000 && imbalance < 0.02, "{steps} steps, {imbalance}");
}
