//! Supports without the nodes that few of the points beside each other have: fewer visits of the kernel, and next to the same force.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::clouds::norm;
use needle_core::scene::{Override, Scene, Word as _};
use needle_core::twin::{StampedPose, Twin};
use testkit::coarse::alone;

const KEY: &str = "discretisation.points_per_support_node";
/// The oblique needle with coarse surroundings and narrow supports.
const COARSE: [(&str, &str); 7] = [
    ("instrument.tilt_rad", "0.26"),
    ("motion.depth_m", "0.003"),
    ("discretisation.spacing_m", "4.5e-3"),
    ("discretisation.edge_refinement", "0.0555"),
    ("discretisation.growth", "0.45"),
    ("discretisation.support_factor", "1.5"),
    ("discretisation.path_rings", "2"),
];

fn scene(changes: &[(&str, &str)]) -> Result<Scene, String> {
    let changes: Vec<_> =
        COARSE.iter().chain(changes).map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset("needle_insertion").unwrap().with(&changes).map_err(|e| e.to_string())
}

fn twin(changes: &[(&str, &str)]) -> Twin {
    alone(|| Twin::new(&scene(changes).unwrap()).unwrap())
}

/// The force vector at the scene's depth, waited for.
fn at_rest(twin: &mut Twin) -> [f64; 3] {
    let mut force = [0.0; 3];
    for i in 1..=400 {
        let pose = twin.pose_at_depth(3e-3 * (f64::from(i) / 200.0).min(1.0));
        force = twin.step(StampedPose { time_s: 5e-3 * f64::from(i), pose }).unwrap().force_n;
    }
    force
}

#[test]
fn the_oblique_needle_has_its_force_with_fewer_visits() {
    let (mut all, mut two) = (twin(&[]), twin(&[(KEY, "2")]));
    let [of_all, of_two] = [&all, &two].map(Twin::step_work);
    println!("{of_all:?}, {of_two:?}");
    assert!(of_two.flops < 0.9 * of_all.flops && of_two.bytes < 0.9 * of_all.bytes, "{of_two:?} {of_all:?}");
    assert!(of_two.support_nodes < of_all.support_nodes);
    assert_eq!(two.integration_points(), all.integration_points());
    let [expected, force] = [&mut all, &mut two].map(at_rest);
    let apart = norm(std::array::from_fn(|k| force[k] - expected[k])) / norm(expected);
    println!("{force:?} N of {expected:?}: {:.2} %", 100.0 * apart);
    assert!(apart > 0.0 && apart < 0.01, "{force:?} {expected:?}");
}

#[test]
fn one_is_the_default_and_changes_nothing() {
    let (mut own, mut one) = (twin(&[]), twin(&[(KEY, "1")]));
    assert_eq!(own.step_work(), one.step_work());
    for i in 1..=20 {
        let [a, b] = [&mut own, &mut one].map(|twin| {
            let pose = twin.pose_at_depth(1e-5 * f64::from(i));
            twin.step(StampedPose { time_s: 0.0, pose }).unwrap().force_n
        });
        assert_eq!(a, b, "the same bits");
    }
}

/// Groups of a half and of the whole are others, and so are their supports; the half plane has supports of its own.
#[test]
fn every_model_of_a_meshless_method_has_it_and_says_so() {
    for (dimension, tilt) in [("full", "0.26"), ("mirrored", "0.26"), ("axisymmetric", "0")] {
        let model = [("discretisation.dimension", dimension), ("instrument.tilt_rad", tilt)];
        let [all, two] = ["1", "2"].map(|fewest| twin(&[&model[..], &[(KEY, fewest)]].concat()));
        let told = two.dimension_because();
        assert!(told.contains("fewer than 2 of 8 points") && told.starts_with(all.dimension_because()), "{told}");
        assert_eq!(two.dimension().as_str(), dimension);
        assert!(two.step_work().flops < 0.97 * all.step_work().flops, "{dimension}");
    }
}

#[test]
fn elements_have_no_supports_to_leave_nodes_out_of() {
    let refused = scene(&[("discretisation.method", "tet4"), (KEY, "2")]).unwrap_err();
    for part in [KEY, "2", "linear tetrahedra", "use 1", "mmls or mls"] {
        assert!(refused.contains(part), "\"{part}\" is not in: {refused}");
    }
    assert!(scene(&[("discretisation.method", "tet4"), (KEY, "1")]).is_ok());
    for beyond in ["0", "5"] {
        let refused = scene(&[(KEY, beyond)]).unwrap_err();
        assert!(refused.contains(KEY) && refused.contains("[1, 4]"), "{refused}");
    }
}
