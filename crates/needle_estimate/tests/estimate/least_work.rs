//! Only what is asked: what nobody takes is not computed, and what is absent costs nothing. Counted, not timed.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Twin, Work};
use needle_estimate::compare::{Cancel, Finished, Keep, Run, Session};
use testkit::coarse;
use testkit::coarse::{alone, at_depth, travel};

fn scene(preset: &str) -> Scene {
    let keys = [("discretisation.spacing_m", "0.004"), ("motion.depth_m", "0.001"), ("motion.pose_hz", "100")];
    let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset(preset).unwrap().with(&keys).unwrap()
}

/// A scene's own motion as `solve` runs it, and what was computed beside its forces.
fn solved(scene: &Scene, fields: bool) -> (Run, Work, usize) {
    alone(|| {
        let keep = Keep { fields, duration_s: Some(1.0), save_every_s: None };
        let session = Session::new(scene, "test", keep).unwrap();
        let Finished { run, twin, .. } = session.run(Session::motion(&scene.motion.unwrap()), &mut Cancel::default());
        (run, twin.work(), twin.reference_points().len())
    })
}

#[test]
fn a_force_costs_no_field_no_target_and_no_stress() {
    for preset in ["compression", "indentation", "needle_insertion"] {
        for dimension in ["axisymmetric", "full"] {
            let mut scene = scene(preset);
            scene.set("discretisation.dimension", dimension).unwrap();
            let mut twin = alone(|| Twin::new(&scene).unwrap());
            let answers = travel(&mut twin, 0.0, 0.001, 20);
            assert!(answers.iter().any(|a| a.force_n[2] > 0.0) && twin.steps() > 0);
            assert_eq!(twin.work(), Work::default(), "{preset}, {dimension}");
        }
    }
}

#[test]
fn an_absent_instrument_costs_no_step() {
    let text = scene("compression").to_toml();
    let (before, after) = text.split_once("[instrument]").unwrap();
    let after = &after[after.find("\n[").unwrap()..];
    let scene = Scene::from_toml(&format!("{before}{after}"), "bare").unwrap();
    assert_eq!(scene.instrument, None);
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    travel(&mut twin, 0.0, 0.001, 50);
    assert_eq!((twin.steps(), twin.work()), (0, Work::default()));
}

#[test]
fn an_instrument_that_rests_or_is_above_the_sample_costs_no_step() {
    let mut twin = alone(|| Twin::new(&scene("indentation")).unwrap());
    travel(&mut twin, -0.002, -0.001, 50);
    assert_eq!(twin.steps(), 0, "above");
    coarse::press(&mut twin, 0.0005);
    let pressed = twin.steps();
    (0..100).for_each(|_| assert_eq!(at_depth(&mut twin, 0.0005).steps, 0));
    assert_eq!(twin.steps(), pressed, "at rest");
}

/// `solve` without `--out` computes one field of displacements, for its checksum, and the targets that a scene has.
#[test]
fn a_run_computes_what_its_outputs_take() {
    let with_targets = scene("needle_insertion");
    let mut without = with_targets.clone();
    without.targets.clear();
    let (run, work, points) = solved(&without, false);
    assert_eq!(work, Work { displacements: points as u64, ..Work::default() });
    let (again, work, _) = solved(&with_targets, false);
    let targets = (again.answers.len() * with_targets.targets.len()) as u64;
    assert_eq!(work, Work { displacements: points as u64, targets, ..Work::default() });
    assert_eq!(run.checksum, again.checksum, "looking at targets changes nothing");
    let (full, work, _) = solved(&without, true);
    let (snapshots, points) = (full.snapshots.len() as u64, points as u64);
    assert!(snapshots > 10);
    // the volume ratio at every snapshot, the stress for final.vtu alone
    let wanted = Work {
        displacements: (snapshots + 1) * points,
        volume_ratios: (snapshots + 1) * points,
        stresses: points,
        targets: 0,
    };
    assert_eq!(work, wanted);
    assert_eq!(full.checksum, run.checksum);
}

/// The volume ratio alone is that of the fields with stress.
#[test]
fn the_volume_ratio_needs_no_stress() {
    for dimension in ["axisymmetric", "full"] {
        let mut scene = scene("indentation");
        scene.set("discretisation.dimension", dimension).unwrap();
        let mut twin = alone(|| Twin::new(&scene).unwrap());
        travel(&mut twin, 0.0, 0.001, 20);
        let (mut alone, mut both, mut stress) = (Vec::new(), Vec::new(), Vec::new());
        twin.jacobian(&mut alone);
        twin.jacobian_and_stress(&mut both, &mut stress);
        assert_eq!(alone.len(), both.len());
        assert!(alone.iter().any(|j| (j - 1.0).abs() > 1e-3), "{dimension}: something is deformed");
        let gap = alone.iter().zip(&both).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(gap < 1e-6, "{dimension}: {gap:e}");
    }
}
