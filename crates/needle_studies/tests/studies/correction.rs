//! A coarse cloud that is corrected by what a finer one has at rest along the path: near the finer one where it was not learnt from as well, and
//! refused where it does not belong.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::sync::LazyLock;

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Prediction, StampedPose, Twin};
use needle_studies::correction::{Learnt, learn};
use needle_studies::progress::Progress;
use testkit::coarse::alone;

const PROBLEM: [(&str, &str); 6] = [
    ("instrument.tilt_rad", "0.26"),
    ("motion.depth_m", "0.003"),
    ("motion.pose_hz", "500"),
    ("discretisation.spacing_m", "3e-3"),
    ("discretisation.edge_refinement", "0.0833"),
    ("discretisation.path_rings", "2"),
];
const COARSE: [(&str, &str); 4] = [
    ("discretisation.spacing_m", "4.5e-3"),
    ("discretisation.edge_refinement", "0.0555"),
    ("discretisation.growth", "0.5"),
    ("discretisation.support_factor", "1.5"),
];
/// The finer cloud that is learnt from: 0.7 of the problem's spacings.
const FINER: [(&str, &str); 2] = [("discretisation.spacing_m", "2.1e-3"), ("discretisation.edge_refinement", "0.0833")];

fn with(scene: &Scene, changes: &[(&str, &str)]) -> Scene {
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    scene.with(&changes).unwrap()
}

fn problem() -> Scene {
    with(&Scene::preset("needle_insertion").unwrap(), &PROBLEM)
}

static LEARNT: LazyLock<Learnt> =
    LazyLock::new(|| learn(&problem(), &with(&problem(), &COARSE), 0.003, &Progress::default()).unwrap().unwrap());

/// Force and displacements of the targets at the last of some depths, waited for.
fn at_rest(scene: &Scene, depths: &[f64]) -> Vec<[f64; 3]> {
    let mut twin = alone(|| Twin::new(scene).unwrap());
    let (mut at, mut time_s) = (0.0, 0.0);
    let mut last: Option<Prediction> = None;
    for depth in depths {
        for i in 1..=400 {
            let share = (f64::from(i) / 200.0).min(1.0);
            time_s += 0.005;
            let pose = twin.pose_at_depth(at + share * (depth - at));
            last = Some(twin.step(StampedPose { time_s, pose }).unwrap());
        }
        at = *depth;
    }
    let mut places = Vec::new();
    twin.target_positions(&mut places);
    let moved = places.iter().zip(&scene.targets).map(|(p, t)| std::array::from_fn(|k| p[k] - t.position[k]));
    std::iter::once(last.unwrap().force_n).chain(moved).collect()
}

/// Distances over lengths.
fn errors(found: &[[f64; 3]], known: &[[f64; 3]]) -> Vec<f64> {
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let of = |(f, k): (&[f64; 3], &[f64; 3])| length(std::array::from_fn(|i| f[i] - k[i])) / length(*k);
    found.iter().zip(known).map(of).collect()
}

#[test]
fn it_holds_where_it_was_not_learnt_from() {
    let Learnt { scene, before, left, held_out, .. } = &*LEARNT;
    println!("{held_out:?}: {before:.4} before, {left:.4} left");
    assert!(*before > 0.03 && *left < 0.7 * before, "{before} {left}");
    assert_eq!(scene.correction.as_ref().unwrap().left, *left);
    let plain = Scene { correction: None, ..scene.clone() };
    let finer = with(&problem(), &FINER);
    // another coefficient at a depth between two that were learnt; half-way out again, where nothing was learnt, it does not make worse what is left
    for (depths, most) in [(&[2.33e-3][..], 0.5), (&[2.33e-3, 1.2e-3], 1.1)] {
        let of = |scene: &Scene| at_rest(&with(scene, &[("instrument.deformation_coefficient", "0.5")]), depths);
        let known = of(&finer);
        let (before, after) = (errors(&of(&plain), &known), errors(&of(scene), &known));
        println!("{depths:?}: {before:.4?} {after:.4?}");
        let worst = |errors: &[f64]| errors.iter().copied().fold(0.0, f64::max);
        assert!(worst(&after) < most * worst(&before), "{depths:?}: {before:?} {after:?}");
    }
}

#[test]
fn the_model_says_so() {
    let twin = alone(|| Twin::new(&LEARNT.scene).unwrap());
    let said = twin.dimension_because();
    assert!(said.contains("corrected by what") && said.contains("nodes") && said.contains("within"), "{said}");
    let plain = alone(|| Twin::new(&with(&LEARNT.scene, &[("correction.apply", "false")])).unwrap());
    assert!(plain.correction().is_none() && !plain.dimension_because().contains("corrected"));
}

#[test]
fn without_it_the_answers_are_the_clouds_own() {
    let own = Scene { correction: None, ..LEARNT.scene.clone() };
    let off = with(&LEARNT.scene, &[("correction.apply", "false")]);
    assert_eq!(at_rest(&own, &[1e-3]), at_rest(&off, &[1e-3]), "bit for bit");
}

#[test]
fn a_file_keeps_it() {
    let scene = &LEARNT.scene;
    assert_eq!(Scene::from_toml(&scene.to_toml(), "tuned.toml").unwrap(), *scene);
}

#[test]
fn it_is_refused_where_it_does_not_belong() {
    let refused =
        |path: &str, value: &str| LEARNT.scene.with(&[Override::text(path, value, "--set")]).unwrap_err().to_string();
    for (path, value) in [
        ("discretisation.spacing_m", "0.004"),
        ("discretisation.support_factor", "1.6"),
        ("instrument.tilt_rad", "0.2"),
        ("sample.height_m", "0.018"),
        ("targets.0.position_m", "[0.0, 0.0, 0.006]"),
        ("motion.depth_m", "0.004"),
    ] {
        let said = refused(path, value);
        assert!(
            said.contains("correction.of") && said.contains("tune --correct") && said.contains("apply = false"),
            "{path}: {said}"
        );
    }
    // constants, pace and what changes while running
    for (path, value) in [
        ("material.shear_modulus_pa", "3000"),
        ("material.poisson_ratio", "0.48"),
        ("instrument.deformation_coefficient", "0.3"),
        ("motion.speed_m_per_s", "0.02"),
        ("stepping.tolerance", "0.02"),
    ] {
        assert!(LEARNT.scene.with(&[Override::text(path, value, "--set")]).is_ok(), "{path}");
    }
    let said = refused("correction.depths_m", "[0.001, 0.0005]");
    assert!(said.contains("correction.depths_m") && said.contains("rise"), "{said}");
    let said = refused("correction.force", "[1.0, 0.0, 0.0, 0.0]");
    assert!(said.contains("correction.force") && said.contains("make 80"), "{said}");
    // what was learnt, changed
    let text = LEARNT.scene.to_toml();
    let edited = |from: &str, to: &str| {
        assert!(text.contains(from), "{text}");
        Scene::from_toml(&text.replacen(from, to, 1), "edited.toml").unwrap_err().to_string()
    };
    let learnt = LEARNT.scene.correction.as_ref().unwrap();
    let scale = format!("force = [{}", learnt.force[0]);
    for other in ["0.0", "-1.0", "0.4", "2.0000001"] {
        let said = edited(&scale, &format!("force = [{other}"));
        assert!(said.contains("correction.force") && said.contains("tune --correct"), "{other}: {said}");
    }
    let digit = format!("force = [{}", learnt.force[0] + 1e-9);
    let checksum = format!("checksum = \"{}\"\n", learnt.checksum);
    let left = format!("left = {}", learnt.left);
    for (from, to) in [(&*scale, &*digit), (&*checksum, ""), (&*left, "left = 0.001")] {
        let said = edited(from, to);
        assert!(
            said.contains("correction.checksum") && said.contains("tune --correct") && said.contains("--set"),
            "{from}: {said}"
        );
    }
    let said = refused("correction.left", "0.001");
    assert!(said.contains("correction.checksum"), "{said}");
    assert!(LEARNT.scene.with(&[Override::text("correction.apply", "true", "--set")]).is_ok());
}
