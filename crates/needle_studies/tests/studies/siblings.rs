//! Twins that share a cloud answer with the bits of twins that are built anew.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Motion, Prediction, StampedPose, Twin};
use needle_studies::composites::Composite;
use testkit::coarse::{self, alone};

const HALF_PLANE: [(&str, &str); 1] = [("discretisation.dimension", "axisymmetric")];

fn with(scene: &Scene, keys: &[(&str, f64)]) -> Scene {
    let keys: Vec<Override> = keys.iter().map(|(key, value)| Override::typed(key, *value, "test")).collect();
    scene.with(&keys).unwrap()
}

/// Answers down to a depth in poses of 20 um, one each millisecond.
fn down(twin: &mut Twin, depth_m: f64) -> Vec<Prediction> {
    let poses = (depth_m / 2e-5) as u32;
    let at = |i: u32| StampedPose { time_s: 1e-3 * f64::from(i), pose: twin.pose_at_depth(2e-5 * f64::from(i)) };
    let poses: Vec<StampedPose> = (1..=poses).map(at).collect();
    poses.into_iter().map(|pose| twin.step(pose).unwrap()).collect()
}

/// Every kind of instrument, with constants that a cloud does not depend on.
fn scenes() -> Vec<(Scene, Vec<(&'static str, f64)>)> {
    let modulus = ("material.shear_modulus_pa", 2100.0);
    let needle = vec![modulus, ("instrument.deformation_coefficient", 0.3)];
    let frictional = [
        ("instrument.interaction", "frictional"),
        ("instrument.friction_n_per_m", "5"),
        ("instrument.cutting_force_n", "0.02"),
    ];
    let rubbed = vec![modulus, ("instrument.friction_n_per_m", 8.0), ("instrument.cutting_force_n", 0.03)];
    let coulomb = [&HALF_PLANE[..], &[("instrument.contact", "coulomb"), ("instrument.friction_coefficient", "0.2")]];
    let layered = Scene::preset("layered_tissue").unwrap().with(&[Override::typed("motion.depth_m", 0.003, "test")]);
    let relaxing =
        [&HALF_PLANE[..], &[("material.prony_shares", "[0.3]"), ("material.prony_times_s", "[0.05]")]].concat();
    vec![
        (coarse::scene("needle_insertion", &HALF_PLANE), needle.clone()),
        (coarse::scene("needle_insertion", &[]), needle),
        (coarse::scene("needle_insertion", &[&HALF_PLANE[..], &frictional].concat()), rubbed),
        (coarse::scene("indentation", &coulomb.concat()), vec![modulus, ("instrument.friction_coefficient", 0.5)]),
        (coarse::scene("compression", &relaxing), vec![modulus, ("material.poisson_ratio", 0.48)]),
        (
            layered.unwrap(),
            vec![("materials.skin.shear_modulus_pa", 3e4), ("materials.fat.friction_n_per_m", 12.0), modulus],
        ),
    ]
}

#[test]
fn a_sibling_has_the_bits_of_a_twin_that_is_built_anew() {
    for (scene, keys) in scenes() {
        let other = with(&scene, &keys);
        let [anew, sibling, again] = alone(|| {
            let mut first = Twin::new(&scene).unwrap();
            let own = down(&mut first, 1e-3);
            // the first one has been used by then
            let mut sibling = first.sibling(&other).unwrap();
            assert!(sibling.is_sibling_of(&first));
            assert_eq!(sibling.scene(), &other);
            let anew = down(&mut Twin::new(&other).unwrap(), 1e-3);
            let of_sibling = down(&mut sibling, 1e-3);
            assert_ne!(own.last().unwrap().force_n, anew.last().unwrap().force_n, "the constants change the force");
            sibling.reset();
            [anew, of_sibling, down(&mut sibling, 1e-3)]
        });
        assert_eq!(anew, sibling, "{}: {keys:?}", scene.name);
        assert_eq!(anew, again, "{}: after a reset", scene.name);
    }
}

#[test]
fn what_changes_the_cloud_has_no_sibling() {
    let scene = coarse::scene("needle_insertion", &HALF_PLANE);
    let twin = alone(|| Twin::new(&scene).unwrap());
    for (key, value) in [
        ("discretisation.spacing_m", 0.0025),
        ("instrument.capture_radius_m", 0.0012),
        ("instrument.puncture_strain", 0.2),
        ("motion.depth_m", 0.004),
        ("stepping.step_factor", 0.6),
        ("sample.height_m", 0.04),
    ] {
        let other = with(&scene, &[(key, value)]);
        assert!(twin.sibling(&other).is_none(), "{key}");
    }
    // so soft a thin layer has more cells across
    let thin = [("regions.middle.to_depth_m", 0.003)];
    let layered = with(&Composite::find("layered_indentation").unwrap().scene().unwrap(), &thin);
    let twin = alone(|| Twin::new(&layered).unwrap());
    assert!(twin.sibling(&with(&layered, &[("materials.soft.shear_modulus_pa", 700.0)])).is_some());
    assert!(twin.sibling(&with(&layered, &[("materials.soft.shear_modulus_pa", 100.0)])).is_none());
}

#[test]
fn a_double_takes_over_a_sibling_with_its_constants() {
    let scene = coarse::scene("needle_insertion", &HALF_PLANE);
    let other = with(&scene, &[("material.shear_modulus_pa", 2100.0), ("instrument.deformation_coefficient", 0.3)]);
    alone(|| {
        let mut one = Twin::new(&scene).unwrap();
        let mut two = one.sibling(&other).unwrap();
        down(&mut one, 1e-3);
        let pose = StampedPose { time_s: 0.05, ..last(&mut two) };
        let motion = Motion::new(2e-4, 0.02, 10);
        let (mut double, mut own) = (one.double(), two.double());
        let ahead = |double: &mut Twin| {
            let mut way = Vec::new();
            double.take_over(&two);
            double.look_ahead(&pose, &motion, &mut way).unwrap();
            way
        };
        assert_eq!(ahead(&mut own), ahead(&mut double));
    });
}

/// Takes a twin to a depth of 1 mm; its last pose.
fn last(twin: &mut Twin) -> StampedPose {
    down(twin, 1e-3);
    StampedPose { time_s: 0.05, pose: twin.pose_at_depth(1e-3) }
}
