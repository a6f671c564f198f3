//! A frictional needle in space: through a membrane, on an oblique path, and moved sideways.
#![allow(clippy::unwrap_used)]

use needle_core::scene::Scene;
use needle_core::twin::{Pose, StampedPose, Twin};
use testkit::coarse::alone;

const SAMPLE: &str = "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.030\nheight_m = 0.017\n[material]\nmodel = \
    \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n[instrument]\nkind = \
    \"needle\"\ndiameter_m = 0.002\ncapture_radius_m = 0.001\n";
const RUBS: &str = "interaction = \"frictional\"\nfriction_n_per_m = 3.0\ncutting_force_n = 0.008\n";

fn built(needle: &str, dimension: &str, motion: &str) -> Twin {
    let cloud = "spacing_m = 2.5e-3\nedge_refinement = 0.2\n";
    let scene = format!(
        "{SAMPLE}{needle}[discretisation]\ndimension = \"{dimension}\"\n{cloud}[motion]\n{motion}depth_m = 0.0075\n"
    );
    alone(|| Twin::new(&Scene::from_toml(&scene, "needle.toml").unwrap()).unwrap())
}

/// From 6 mm on along its own axis by 0.3 mm, by 1.2 mm in all, and back to 0.3 mm before the start: force along the axis and across it, N.
fn pushed_and_pulled(twin: &mut Twin) -> [[f64; 2]; 3] {
    let axis = twin.pose_at_depth(0.0).axis;
    let side = axis[0].signum();
    let mut to = |from: f64, to: f64, poses: u32| {
        let at = |k: u32| 6e-3 + from + (to - from) * f64::from(k) / f64::from(poses);
        let step = |k: u32| twin.step(StampedPose { time_s: 0.0, pose: twin.pose_at_depth(at(k)) }).unwrap();
        let force = (1..=poses).map(step).last().unwrap().force_n;
        let along = -(0..3).map(|k| force[k] * axis[k]).sum::<f64>();
        assert!(force[1].abs() < 1e-4, "{force:?}");
        [along, side * (force[0] + along * axis[0])]
    };
    [to(0.0, 3e-4, 12), to(3e-4, 1.2e-3, 36), to(1.2e-3, -3e-4, 60)]
}

/// In space as in the half plane: the tissue swings after the drop, and what it swings past its rest is neither cut nor slipped.
#[test]
fn in_space_too_the_drop_ends_at_cutting_and_friction() {
    let needle = format!("{RUBS}puncture_force_n = 0.03\n");
    for dimension in ["axisymmetric", "full"] {
        let mut twin = built(&needle, dimension, "");
        let mut fallen = Vec::new();
        for k in 1..=60_u32 {
            let pose = twin.pose_at_depth(5e-5 * f64::from(k));
            let force = twin.step(StampedPose { time_s: 0.0, pose }).unwrap().force_n[2];
            let cut = twin.cut_depth().unwrap();
            if cut > 0.0 {
                fallen.push(force / (0.008 + 3.0 * (cut - 5e-4).max(0.0)));
            }
            if fallen.len() > 4 {
                break;
            }
        }
        println!("{dimension}: force over cutting and friction {fallen:.4?}");
        assert!(fallen.len() > 4 && fallen.iter().all(|over| (over - 1.0).abs() < 0.02), "{dimension}: {fallen:?}");
    }
}

#[test]
fn an_oblique_needle_is_held_as_an_upright_one() {
    let start = "start_depth_m = 0.006\n";
    let upright = pushed_and_pulled(&mut built(RUBS, "axisymmetric", start));
    let leaning = [0.0, std::f64::consts::PI].map(|azimuth: f64| {
        let entry = -3e-3 * azimuth.cos();
        let needle = format!("{RUBS}tilt_rad = 0.26\nazimuth_rad = {azimuth}\nentry_x_m = {entry}\n");
        pushed_and_pulled(&mut built(&needle, "full", start))
    });
    println!("upright {upright:.5?} N, oblique {:.5?} N, the other way {:.5?} N", leaning[0], leaning[1]);
    let plateau = 0.003 * 6.0 + 0.008;
    for way in leaning {
        for (own, other) in way.iter().zip(upright) {
            assert!((own[0] - other[0]).abs() < 0.02 * plateau, "{own:?} {other:?}");
        }
        assert!((way[1][0] / plateau - 1.0).abs() < 0.005, "{way:?}");
    }
    // what its motion to one side does to it, that to the other side does the other way round
    for (one, other) in leaning[0].iter().zip(leaning[1]) {
        assert!((one[0] - other[0]).abs() < 0.01 * plateau && (one[1] - other[1]).abs() < 0.01 * plateau);
    }
    assert!(leaning[0][1][1] > 0.03 * plateau, "{leaning:?}");
}

/// Force on a needle as deep as this in m that is moved by 0.1 mm sideways, N.
fn moved_aside(twin: &mut Twin, depth: f64) -> f64 {
    let mut to = |aside: f64| {
        let pose = Pose { tip: [aside, 0.0, 0.017 - depth], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 };
        twin.step(StampedPose { time_s: 0.0, pose }).unwrap()
    };
    for k in 1..20_u32 {
        to(5e-6 * f64::from(k));
    }
    // until nothing is left to be done
    (0..500).map(|_| to(1e-4)).find(|answer| answer.steps == 0).unwrap().force_n[0]
}

/// Tissue that sticks to the shaft is held as the kinematic rule holds it with a coefficient of 0. The difference is at the tip, whose face
/// pushes and never pulls.
#[test]
fn a_needle_that_sticks_is_as_stiff_sideways_as_one_that_carries_tissue_along() {
    let depth = 0.006;
    let stuck = "interaction = \"frictional\"\nfriction_n_per_m = 1e3\ncutting_force_n = 1.0\n";
    let sticks = moved_aside(&mut built(stuck, "full", "start_depth_m = 0.006\n"), depth);
    let mut kinematic = built("deformation_coefficient = 0.0\nretraction_coefficient = 0.0\n", "full", "");
    for k in 1..=30_u32 {
        let pose = kinematic.pose_at_depth(depth * f64::from(k) / 30.0);
        kinematic.step(StampedPose { time_s: 0.0, pose }).unwrap();
    }
    let carried = moved_aside(&mut kinematic, depth);
    println!("{sticks} N, {carried} N");
    assert!(carried < -1e-3 && (sticks / carried - 1.0).abs() < 0.01, "{sticks} {carried}");
}
