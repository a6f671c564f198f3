//! A cloud whose nodes move with the layers' interfaces: the force of a cloud made for them, and a smooth function of the depth.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{StampedPose, Twin};
use needle_studies::composites::Composite;
use testkit::coarse::alone;

const DEPTH: &str = "regions.top.to_depth_m";

/// Three layers under a disc, all poses with the same number of steps.
fn layers(keys: &[(&str, &str)]) -> Scene {
    let steps = [("stepping.min_steps_per_pose", "24"), ("stepping.max_steps_per_pose", "24")];
    let keys = [&[("regions.middle.from_depth_m", "0"), ("motion.depth_m", "0.002")], &steps[..], keys].concat();
    let keys: Vec<Override> = keys.iter().map(|(key, value)| Override::text(key, value, "test")).collect();
    Composite::find("layered_indentation").unwrap().scene().unwrap().with(&keys).unwrap()
}

fn with_depth(scene: &Scene, depth_m: f64) -> Scene {
    scene.with(&[Override::typed(DEPTH, depth_m, "test")]).unwrap()
}

/// Force at 0.5 and 1 mm, N.
fn forces(twin: &mut Twin) -> [f64; 2] {
    let at = |i: i32| StampedPose { time_s: 1e-3 * f64::from(i), pose: twin.pose_at_depth(2e-5 * f64::from(i)) };
    let poses: Vec<StampedPose> = (1..=50).map(at).collect();
    let all: Vec<f64> = poses.into_iter().map(|pose| twin.step(pose).unwrap().force_n[2]).collect();
    [all[24], all[49]]
}

fn moved(scene: &Scene, from: &Scene) -> [f64; 2] {
    alone(|| forces(&mut Twin::on_cloud_of(scene, &from.regions).unwrap()))
}

#[test]
fn the_force_is_that_of_a_cloud_made_for_the_layers() {
    let coarse = [
        ("discretisation.dimension", "full"),
        ("discretisation.spacing_m", "0.004"),
        ("discretisation.edge_refinement", "0.4"),
    ];
    for keys in [&[("discretisation.dimension", "axisymmetric")][..], &coarse] {
        let scene = layers(keys);
        assert_eq!(
            moved(&scene, &scene),
            alone(|| forces(&mut Twin::new(&scene).unwrap())),
            "not moved: the same bits"
        );
        for depth in [1.6e-3, 2.6e-3] {
            let other = with_depth(&scene, depth);
            let (own, moved) = (alone(|| forces(&mut Twin::new(&other).unwrap())), moved(&other, &scene));
            println!("{depth}: own cloud {own:?} N, moved {moved:?} N");
            assert!(own.iter().zip(moved).all(|(own, moved)| (moved / own - 1.0).abs() < 0.01), "{own:?} {moved:?}");
        }
    }
}

#[test]
fn the_force_is_a_smooth_function_of_the_depth() {
    let scene = layers(&[("discretisation.dimension", "axisymmetric")]);
    let force = |share: f64| moved(&with_depth(&scene, 2e-3 * (1.0 + share)), &scene)[1];
    let slope = |share: f64| (force(share) - force(-share)) / (2.0 * share);
    let slopes = [0.005, 0.02, 0.05].map(slope);
    println!("{slopes:?} N");
    assert!(slopes.iter().all(|s| (s / slopes[2] - 1.0).abs() < 0.005), "{slopes:?}");
}

#[test]
fn only_layers_of_the_same_materials_are_moved_to() {
    let scene = layers(&[]);
    let stretch = |scene: &Scene, from: &Scene| Twin::stretch_from(scene, &from.regions);
    assert_eq!(stretch(&scene, &scene), Some(1.0));
    let most = stretch(&with_depth(&scene, 3e-3), &scene).unwrap();
    assert!((most - 1.5).abs() < 1e-12, "{most}");
    assert_eq!(stretch(&with_depth(&scene, 4.1e-3), &scene), None, "more than twice as thick");
    let sphere = Composite::find("inclusion_indentation").unwrap().scene().unwrap();
    assert_eq!((stretch(&sphere, &sphere), stretch(&scene, &sphere)), (None, None));
}
