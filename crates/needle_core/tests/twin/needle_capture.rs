//! The needle's force does not depend on where nodes happen to lie.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use testkit::coarse;
use testkit::coarse::{alone, at_depth, travel};

const DEPTH: f64 = 3e-3;

fn needle(changes: &[(&str, &str)]) -> Twin {
    let mut all =
        vec![("discretisation.dimension", "full"), ("discretisation.spacing_m", "0.003"), ("motion.depth_m", "0.0035")];
    all.extend(changes);
    let changes: Vec<_> = all.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    alone(|| Twin::new(&Scene::preset("needle_insertion").unwrap().with(&changes).unwrap()).unwrap())
}

/// Force at [`DEPTH`], N.
fn force(twin: &mut Twin) -> f64 {
    travel(twin, 0.0, DEPTH, 3000).last().unwrap().force_n[2]
}

#[test]
fn the_effective_radius_is_the_capture_radius() {
    for (radius, changes) in [
        (5e-4, &[][..]),
        (1e-3, &[("instrument.capture_radius_m", "0.001")]),
        (5e-4, &[("instrument.tilt_rad", "0.4")]),
    ] {
        let found = needle(changes).effective_radius().unwrap();
        println!("{changes:?}: effective radius {:.4} mm of {:.4} mm", 1e3 * found, 1e3 * radius);
        assert!(found <= radius * 1.001 && found > 0.9 * radius, "{changes:?}: {found}");
    }
    let plate = Twin::new(&coarse::scene("compression", &[])).unwrap();
    assert_eq!(plate.effective_radius(), None);
}

#[test]
fn the_force_converges_with_the_cloud() {
    let at = |refinement: &str| {
        let mut twin = needle(&[("discretisation.edge_refinement", refinement)]);
        (twin.nodes(), force(&mut twin))
    };
    let found: Vec<_> = ["0.08", "0.06", "0.045"].map(at).into();
    println!("{found:?}");
    assert!(found.windows(2).all(|w| w[1].0 > w[0].0), "clouds grow");
    let finest = found[2].1;
    assert!((found[1].1 / finest - 1.0).abs() < 0.02 && (found[0].1 / finest - 1.0).abs() < 0.04, "{found:?}");
}

/// The same needle elsewhere in a wide sample meets other nodes.
#[test]
fn where_the_needle_enters_makes_no_difference() {
    let centred = force(&mut needle(&[]));
    let beside = force(&mut needle(&[("instrument.entry_x_m", "0.0013"), ("instrument.entry_y_m", "-0.0009")]));
    println!("centred {centred:.6} N, beside {beside:.6} N");
    assert!((beside / centred - 1.0).abs() < 0.02, "{centred} {beside}");
}

/// A needle so slow that a pose is 0.2 um: the radial parameters of the path's nodes on the axis, which nothing holds, stay where they are.
#[test]
fn thousands_of_small_poses_leave_the_path_on_the_axis() {
    let changes = [("motion.depth_m", "0.003"), ("discretisation.dimension", "axisymmetric")];
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    let scene = Scene::preset("needle_insertion").unwrap().with(&changes).unwrap();
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    let mut worst = 0.0_f64;
    for i in 1..=10_000 {
        let answer = at_depth(&mut twin, 2e-7 * f64::from(i));
        worst = worst.max(answer.health.constraint_error_m);
    }
    println!("constraint error {worst:.2e} m");
    assert!(worst < 1e-8, "{worst} m");
}
