//! Contract of a kinematic needle's side before the puncture: free tissue does not pass it; after the puncture it is out of the way.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Phase, Twin};
use testkit::coarse::{alone, digits, press, travel};

/// Capture radius of the preset, m.
const RADIUS: f64 = 5e-4;
const NO_WALL: (&str, &str) = ("instrument.wall_contact", "false");
/// The surface holds as far as these tests go.
const TOUGH: (&str, &str) = ("instrument.puncture_strain", "10");
const DEPTH: (&str, &str) = ("motion.depth_m", "0.0022");

fn twin(preset: &str, changes: &[(&str, &str)]) -> Twin {
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    alone(|| Twin::new(&Scene::preset(preset).unwrap().with(&changes).unwrap()).unwrap())
}

/// How far tissue that was beside the shaft is inside it above its tip at a depth, m.
fn inside(twin: &Twin, depth_m: f64) -> f64 {
    let mut u = Vec::new();
    twin.displacements(&mut u);
    let pose = twin.pose_at_depth(depth_m);
    let beside = |p: [f64; 3]| {
        let v: [f64; 3] = std::array::from_fn(|k| p[k] - pose.tip[k]);
        let along: f64 = (0..3).map(|k| v[k] * pose.axis[k]).sum();
        (0..3).map(|k| (v[k] - along * pose.axis[k]).powi(2)).sum::<f64>().sqrt()
    };
    let within = |(x, u): (&[f64; 3], &[f64; 3])| {
        let now: [f64; 3] = std::array::from_fn(|k| x[k] + u[k]);
        let above = now[2] > pose.tip[2] + 1e-6;
        if beside(*x) > RADIUS * 1.001 && above { RADIUS - beside(now) } else { 0.0 }
    };
    twin.reference_points().iter().zip(&u).map(within).fold(0.0, f64::max)
}

#[test]
fn tissue_beside_the_shaft_stays_outside_before_the_puncture() {
    // the strain at the edge of the tip grows as the cloud gets finer: the half plane's passes 10 first
    let cases = [
        ("axisymmetric", "0", 1.1e-3, 5e-5),
        ("full", "0", 2.1e-3, 1e-4),
        ("mirrored", "0", 2.1e-3, 1e-4),
        ("mirrored", "0.3", 2.1e-3, 1e-4),
        ("full", "0.3", 1.5e-3, 5e-5),
    ];
    for (dimension, tilt, depth, folded) in cases {
        let there = |wall: &[(&str, &str)]| {
            let spacing =
                ("discretisation.edge_refinement", if dimension == "axisymmetric" { "0.0268" } else { "0.11" });
            let own = [spacing, ("discretisation.dimension", dimension), ("instrument.tilt_rad", tilt)];
            let mut twin = twin("needle_insertion", &[&[TOUGH, DEPTH][..], &own, wall].concat());
            let answers = travel(&mut twin, 0.0, depth, (depth / 2e-5).round() as u32);
            assert!(answers.iter().all(|a| a.phase == Phase::Indentation), "{dimension}: no puncture");
            inside(&twin, depth)
        };
        let (with, without) = (there(&[]), there(&[NO_WALL]));
        println!("{dimension}, tilt {tilt}: {:.2} um inside with a wall, {:.0} um without", 1e6 * with, 1e6 * without);
        assert!(with < 1e-7 && without > folded, "{dimension}: {with} m, {without} m");
    }
}

/// Beside a needle with friction that presses on a membrane too: without a wall the surface closes above its tip.
#[test]
fn tissue_beside_the_shaft_stays_outside_a_needle_that_presses_on_a_membrane() {
    let frictional = [
        ("instrument.interaction", "frictional"),
        ("instrument.friction_n_per_m", "3.0"),
        ("instrument.cutting_force_n", "0.003"),
        ("instrument.puncture_force_n", "0.09"),
    ];
    let there = |wall: &[(&str, &str)]| {
        let mut twin = twin("needle_insertion", &[&frictional[..], &[("motion.depth_m", "0.004")], wall].concat());
        let answers = travel(&mut twin, 0.0, 2.5e-3, 500);
        assert!(answers.iter().all(|a| a.phase != Phase::Penetration), "no puncture");
        inside(&twin, 2.5e-3)
    };
    let (with, without) = (there(&[]), there(&[NO_WALL]));
    println!("{:.2} um inside with a wall, {:.0} um without", 1e6 * with, 1e6 * without);
    assert!(with < 1e-7 && without > 5e-5, "{with} m, {without} m");
}

/// An oblique shaft meets a force that is that of an upright one as the tilt goes to nothing.
#[test]
fn the_force_on_a_shaft_goes_to_that_of_an_upright_one() {
    let force = |tilt: &str| {
        let keys = [TOUGH, DEPTH, ("discretisation.dimension", "mirrored"), ("instrument.tilt_rad", tilt)];
        press(&mut twin("needle_insertion", &keys), 1.2e-3).force_n
    };
    let (upright, oblique, more) = (force("0"), force("0.02"), force("0.3"));
    println!("{upright:.6?} N upright, {oblique:.6?} N at 0.02 rad, {more:.6?} N at 0.3 rad");
    assert!((oblique[2] / upright[2] - 1.0).abs() < 0.01, "{oblique:?} {upright:?}");
    assert!(oblique[0].abs() < 0.05 * upright[2] && more[0] < -0.05 * upright[2], "{oblique:?} {more:?}");
}

/// Until the puncture a needle is a flat indenter, whose wall is held to finite elements (`contact.rs`): another cloud, the same force.
#[test]
fn a_needle_that_presses_has_the_force_of_an_indenter() {
    let keys = [("instrument.diameter_m", "0.001"), DEPTH, ("discretisation.edge_refinement", "0.02")];
    let indenter = press(&mut twin("indentation", &keys), 1e-3).force_n[2];
    let needle = press(&mut twin("needle_insertion", &[TOUGH, DEPTH]), 1e-3).force_n[2];
    println!("needle {needle:.6} N, indenter {indenter:.6} N: {:+.2} %", 1e2 * (needle / indenter - 1.0));
    assert!((needle / indenter - 1.0).abs() < 0.03, "{needle} N, {indenter} N");
}

/// Reference of the insertion at 2 mm, N.
const AT_2_MM: f64 = 0.003_552_5;

/// The wall goes at the puncture and comes back with a reset, bit for bit.
#[test]
fn the_wall_is_out_of_the_way_after_the_puncture() {
    let keys = [("instrument.puncture_strain", "0.5"), DEPTH];
    let mut twin = twin("needle_insertion", &keys);
    let first = travel(&mut twin, 0.0, 2e-3, 100);
    assert!(first.iter().any(|a| a.phase == Phase::Indentation) && first.last().unwrap().phase == Phase::Penetration);
    let deep = travel(&mut twin, 2e-3, 2e-3, 400)[399].force_n[2];
    let at_once = press(&mut self::twin("needle_insertion", &[DEPTH]), 2e-3).force_n[2];
    println!("punctured at a strain of 0.5 and at once: {deep:.6} N, {at_once:.6} N");
    // each on its own cloud: of the finite elements (bags/reference), which are between them
    for force in [deep, at_once] {
        assert!((force / AT_2_MM - 1.0).abs() < 0.02, "once in, the rule says where tissue is: {deep} N, {at_once} N");
    }
    twin.reset();
    assert_eq!(digits(&first), digits(&travel(&mut twin, 0.0, 2e-3, 100)));
}

/// A surface that gives way before tissue can come to the shaft keeps its bits.
#[test]
fn a_surface_that_gives_way_at_once_needs_no_wall() {
    for strain in ["1e-6", "0.1"] {
        let keys = [("instrument.puncture_strain", strain), DEPTH];
        let of = |wall: &[(&str, &str)]| {
            digits(&travel(&mut twin("needle_insertion", &[&keys, wall].concat()), 0.0, 5e-4, 50))
        };
        assert_eq!(of(&[]), of(&[NO_WALL]), "{strain}");
    }
}
