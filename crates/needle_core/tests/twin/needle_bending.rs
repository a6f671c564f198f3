//! A needle that bends: rod and tissue agree, and a rigid needle is the limit of a stiff one.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::{Dimension, Override, Scene};
use needle_core::twin::{Prediction, StampedPose, Twin};
use testkit::coarse::{digits, rest, scene, travel};

const DEPTH: f64 = 2.5e-3;
/// A thin wire, which a gel bends.
const WIRE: [(&str, &str); 4] = [
    ("instrument.flexible", "true"),
    ("instrument.length_m", "0.06"),
    ("instrument.outer_diameter_m", "0.0005"),
    ("instrument.youngs_modulus_pa", "6e10"),
];
const BEVEL: [(&str, &str); 3] =
    [("instrument.tip", "bevel"), ("instrument.bevel_force_n", "0.001"), ("instrument.diameter_m", "0.0005")];
const HALF: (&str, &str) = ("discretisation.dimension", "mirrored");

fn bent(changes: &[&[(&str, &str)]]) -> Twin {
    Twin::new(&scene("needle_insertion", &changes.concat())).unwrap()
}

fn inserted(twin: &mut Twin, poses: u32) -> Prediction {
    travel(twin, 0.0, DEPTH, poses);
    let pose = twin.pose_at_depth(DEPTH);
    rest(twin, pose)
}

fn tip(twin: &Twin) -> [f64; 3] {
    twin.bent_tip().unwrap().tip
}

#[test]
fn a_rigid_needle_is_the_limit_of_a_stiff_one() {
    let lean = [HALF, ("instrument.tilt_rad", "0.2")];
    let rigid = inserted(&mut bent(&[&lean]), 250);
    let mut stiff = bent(&[&lean, &WIRE, &[("instrument.youngs_modulus_pa", "1e15")]]);
    let answer = inserted(&mut stiff, 250);
    let peak = rigid.force_n[2];
    for k in 0..3 {
        let gap = answer.force_n[k] - rigid.force_n[k];
        assert!(gap.abs() < 5e-3 * peak, "{:?} against {:?}", answer.force_n, rigid.force_n);
    }
    let soft = inserted(&mut bent(&[&lean, &WIRE]), 250);
    assert!((soft.force_n[0] - rigid.force_n[0]).abs() > 1e-2 * peak, "a wire is no stiff needle");
}

/// What the tissue does to the needle bends it: its moment about the clamp is E I times the curvature there.
#[test]
fn the_moment_at_the_clamp_is_that_of_the_rods_curvature() {
    let at_clamp = [("instrument.load_cell_height_m", "0.06")];
    let mut twin = bent(&[&[HALF], &WIRE, &BEVEL, &at_clamp]);
    let answer = inserted(&mut twin, 250);
    let mut shape = Vec::new();
    twin.needle_shape(&mut shape);
    let length = 0.06 / (shape.len() - 1) as f64;
    let stiffness = 6e10 * std::f64::consts::PI / 64.0 * 0.5e-3_f64.powi(4);
    // the clamp holds the direction: half a cell whose neighbour is its mirror image
    let curvature = 2.0 * (shape[1].tip[0] - shape[0].tip[0]) / (length * length);
    let moment = -stiffness * curvature;
    let of_tissue = answer.torque_nm[1];
    assert!((of_tissue / moment - 1.0).abs() < 0.05, "{of_tissue} N m, and the rod has {moment} N m");
}

#[test]
fn a_bevel_draws_the_tip_to_its_side() {
    let offset = |roll: &str| {
        let mut twin = bent(&[&[HALF], &WIRE, &BEVEL, &[("instrument.roll_rad", roll)]]);
        assert_eq!(twin.dimension(), Dimension::Mirrored);
        let answer = inserted(&mut twin, 250);
        let unbalanced = answer.unbalanced_n();
        assert!(unbalanced.iter().all(|f| f.abs() < 0.02 * answer.force_n[2]), "{unbalanced:?}");
        tip(&twin)[0]
    };
    let (there, back) = (offset("0.0"), offset("3.141592653589793"));
    assert!(there > 5e-6, "{there} m");
    assert!((there / -back - 1.0).abs() < 0.1, "turned by half a turn it goes the other way: {there} {back}");
}

#[test]
fn its_line_does_not_depend_on_the_rate_of_poses() {
    let offset = |poses: u32| {
        let mut twin = bent(&[&[HALF], &WIRE, &BEVEL]);
        inserted(&mut twin, poses);
        tip(&twin)[0]
    };
    let (few, some, many) = (offset(20), offset(250), offset(1000));
    for other in [few, many] {
        assert!((other / some - 1.0).abs() < 0.06, "{few} {some} {many}");
    }
}

/// A template takes what the tissue does to the needle sideways off the load cell.
#[test]
fn a_template_holds_the_needle_above_the_tissue() {
    let guided = [("instrument.guide_z_m", "0.019")];
    let (mut free, mut held) = (bent(&[&[HALF], &WIRE, &BEVEL]), bent(&[&[HALF], &WIRE, &BEVEL, &guided]));
    let (alone, with) = (inserted(&mut free, 250), inserted(&mut held, 250));
    assert!(tip(&held)[0] < 0.5 * tip(&free)[0], "{:?} {:?}", tip(&held), tip(&free));
    assert!(alone.template_force_n == [0.0; 3] && with.template_force_n[0].abs() > 1e-4, "{with:?}");
    let gap: f64 = (0..3).map(|k| with.unbalanced_n()[k].powi(2)).sum::<f64>().sqrt();
    assert!(gap < 0.02 * with.force_n[2], "{gap}");
    // where the hole is, the needle is on its line
    let mut shape = Vec::new();
    held.needle_shape(&mut shape);
    let near = shape.iter().min_by(|a, b| (a.tip[2] - 0.019).abs().total_cmp(&(b.tip[2] - 0.019).abs())).unwrap();
    assert!(near.tip[0].abs() < 2e-5, "{near:?}");
}

/// The roll of a pose turns the bevel: what was cut before keeps its place.
#[test]
fn a_turned_needle_is_drawn_to_another_side() {
    let mut twin = bent(&[&WIRE, &BEVEL]);
    assert_eq!(twin.dimension(), Dimension::Full);
    let mut go = |from: f64, to: f64, roll_rad: f64| {
        for i in 1..=100 {
            let mut pose = twin.pose_at_depth(from + (to - from) * f64::from(i) / 100.0);
            pose.roll_rad = roll_rad;
            twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
        }
        tip(&twin)
    };
    let first = go(0.0, 1.8e-3, std::f64::consts::FRAC_PI_2);
    assert!(first[1] > 1e-6 && first[0].abs() < 0.2 * first[1], "{first:?}");
    let then = go(1.8e-3, 2.8e-3, -std::f64::consts::FRAC_PI_2);
    let went_on = go(2.8e-3, 2.9e-3, -std::f64::consts::FRAC_PI_2);
    assert!(went_on[1] < then[1], "{then:?} {went_on:?}");
}

/// The tip of a shaft in friction of t per length stands until the driver has turned by t l (L - l/2) / (G J), l of its length L being in the
/// tissue, and follows it by that much, either way; a shaft that goes on lets the twist go.
#[test]
fn a_turned_tip_lags_behind_its_driver_by_the_twist() {
    let stiffness = 6e10 * std::f64::consts::PI / 64.0 * 5e-4_f64.powi(4) / 1.3;
    let torsion = [("instrument.torsional_friction_n", "0.1")];
    let rubs = [
        ("instrument.interaction", "frictional"),
        ("instrument.friction_n_per_m", "10"),
        ("instrument.cutting_force_n", "0.001"),
    ];
    for (needle, per_length) in [(&torsion[..], 0.1), (&rubs, 10.0 * 2.5e-4)] {
        let mut twin = bent(&[&WIRE, &BEVEL, needle]);
        let go = |twin: &mut Twin, depth: f64, roll_rad: f64| {
            let mut pose = twin.pose_at_depth(depth);
            pose.roll_rad = roll_rad;
            twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
            twin.bent_tip().unwrap().roll_rad
        };
        let depth = 2e-3;
        (1..=100).for_each(|i| assert!(go(&mut twin, depth * f64::from(i) / 100.0, 0.0) == 0.0));
        // where the driver is in each of these, and how many of its lags it has turned since it stood last
        let at = |from: f64, to: f64, i: u32| from + (to - from) * f64::from(i) / 50.0;
        let lag = 0.8 - (0..=50).map(|i| go(&mut twin, depth, at(0.0, 0.8, i))).last().unwrap();
        // what the needle has passed of tissue that it drags along
        let radius = twin.scene().instrument.unwrap().needle().unwrap().capture_radius.get();
        let inside = twin.cut_depth().map_or(depth, |cut| cut - 0.5 * radius);
        let twist = per_length * inside * (0.06 - 0.5 * depth) / stiffness;
        println!("{needle:?}: {lag:.4} rad of {twist:.4}");
        assert!((lag / twist - 1.0).abs() < 0.05, "{lag} {twist}");
        let stands = (0..=50).map(|i| go(&mut twin, depth, at(0.8, 0.8 - 1.9 * lag, i))).last().unwrap();
        assert!((stands - (0.8 - lag)).abs() < 0.1 * lag, "{stands}");
        let follows = (0..=50).map(|i| go(&mut twin, depth, at(0.8 - 1.9 * lag, -3.0, i))).last().unwrap();
        assert!((follows - (-3.0 + lag)).abs() < 0.1 * lag, "{follows}");
        // across half a turn
        let across =
            (0..=50).map(|i| go(&mut twin, depth, at(-3.0, -3.4, i).rem_euclid(std::f64::consts::TAU))).last().unwrap();
        let driver = (-3.4_f64).rem_euclid(std::f64::consts::TAU);
        assert!((across - (driver + lag)).abs() < 0.1 * lag, "{across} {driver}");
        assert!((go(&mut twin, depth + 1e-5, driver) - driver).abs() < 1e-12, "it goes on straight");
    }
}

#[test]
fn a_reset_makes_it_straight_and_the_same_poses_the_same_bits() {
    let mut twin = bent(&[&[HALF], &WIRE, &BEVEL]);
    let first = digits(&travel(&mut twin, 0.0, 1.5e-3, 100));
    assert!(tip(&twin)[0] > 0.0);
    twin.reset();
    let mut shape = Vec::new();
    twin.needle_shape(&mut shape);
    assert!(shape.iter().all(|pose| pose.tip[0].abs() < 1e-15), "{shape:?}");
    assert!(digits(&travel(&mut twin, 0.0, 1.5e-3, 100)) == first, "other bits after a reset");
}

#[test]
fn with_friction_and_cutting_it_bends_as_well() {
    let rubs = [
        ("instrument.interaction", "frictional"),
        ("instrument.friction_n_per_m", "3"),
        ("instrument.cutting_force_n", "0.001"),
        ("instrument.tip", "bevel"),
    ];
    let mut twin = bent(&[&WIRE, &rubs]);
    travel(&mut twin, 0.0, 2e-3, 40);
    let pose = twin.pose_at_depth(2e-3);
    let answer = rest(&mut twin, pose);
    let [x, y, _] = tip(&twin);
    assert!(x > 1e-6 && y.abs() < 0.1 * x, "{x} {y}");
    let unbalanced = answer.unbalanced_n();
    assert!(unbalanced.iter().all(|f| f.abs() < 0.03 * answer.force_n[2]), "{unbalanced:?} of {:?}", answer.force_n);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let with = |changes: &[(&str, &str)]| {
        let all: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "--set")).collect();
        Scene::preset("needle_insertion").unwrap().with(&all).map(|_| ()).unwrap_err().to_string()
    };
    for (changes, says) in [
        (&[("instrument.length_m", "0.1")][..], "instrument.flexible is \"false\""),
        (&[("instrument.flexible", "true")], "instrument.length_m"),
        (&[("instrument.tip", "sphere")], "a needle is \"flat\", \"conical\" or \"bevel\""),
        (&[("instrument.bevel_rad", "0.3")], "instrument.tip is \"flat\""),
        (&[("instrument.tip", "bevel")], "instrument.bevel_force_n"),
        (&[("instrument.flexible", "true"), ("instrument.length_m", "0.005")], "instrument.length_m"),
        (
            &[
                ("instrument.flexible", "true"),
                ("instrument.length_m", "0.1"),
                ("instrument.inner_diameter_m", "0.001"),
            ],
            "instrument.inner_diameter_m",
        ),
        (
            &[("instrument.flexible", "true"), ("instrument.length_m", "0.1"), ("instrument.guide_z_m", "0.01")],
            "instrument.guide_z_m",
        ),
    ] {
        let error = with(changes);
        assert!(error.contains(says), "{changes:?}: {error}");
    }
}

/// A flexible needle in place whose driver goes sideways, against independent finite elements of a beam in a block
/// (`tests/references/beam_in_block.py`): displacements over the driver's, and force over it.
#[test]
fn a_needle_in_a_block_bends_as_finite_elements() {
    let table = std::fs::read_to_string(testkit::root().join("tests/references/beam_in_block.csv")).unwrap();
    let (depth, aside, outer, top) = (8e-3, 1e-4, 5e-4_f64, 0.017);
    for line in table.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let [stiffness, wanted_tip, wanted_surface, wanted_force] = numbers[..] else { panic!("{line}") };
        let modulus = (stiffness / (std::f64::consts::PI / 64.0 * outer.powi(4))).to_string();
        let changes = [
            HALF,
            ("instrument.flexible", "true"),
            ("instrument.length_m", "0.02"),
            ("instrument.outer_diameter_m", "0.0005"),
            ("instrument.youngs_modulus_pa", &modulus),
            // the way in is straight, and hardly moves the tissue
            ("instrument.deformation_coefficient", "0.01"),
            ("instrument.retraction_coefficient", "0.01"),
            ("motion.depth_m", "0.009"),
        ];
        let changes = changes.map(|(path, value)| Override::text(path, value, "test"));
        let mut twin = Twin::new(&Scene::preset("needle_insertion").unwrap().with(&changes).unwrap()).unwrap();
        let mut time_s = 0.0;
        let mut go = |depth: f64, x: f64| {
            time_s += 0.002;
            let mut pose = twin.pose_at_depth(depth);
            pose.tip[0] += x;
            twin.step(StampedPose { time_s, pose }).unwrap().force_n[0]
        };
        let mut before = 0.0;
        (1..=800).for_each(|i| before = go(depth * f64::from(i) / 800.0, 0.0));
        (1..=100).for_each(|i| _ = go(depth, aside * f64::from(i) / 100.0));
        // needle and tissue come to rest in turns
        let force = (0..500).map(|_| go(depth, aside)).last().unwrap();
        let mut shape = Vec::new();
        twin.needle_shape(&mut shape);
        let at = shape.windows(2).find(|pair| pair[1].tip[2] < top).unwrap();
        let share = (at[0].tip[2] - top) / (at[0].tip[2] - at[1].tip[2]);
        let surface = at[0].tip[0] + share * (at[1].tip[0] - at[0].tip[0]);
        let [tip, surface, force] = [tip(&twin)[0] / aside, surface / aside, (before - force) / aside];
        println!(
            "EI {stiffness}: tip {tip:.4} of {wanted_tip}, surface {surface:.4} of {wanted_surface}, {force:.3} of {wanted_force} N/m"
        );
        assert!(
            (tip - wanted_tip).abs() < 0.005 && (surface - wanted_surface).abs() < 0.005,
            "{tip} {surface}: {line}"
        );
        assert!((force / wanted_force - 1.0).abs() < 0.015, "{force}: {line}");
    }
}
