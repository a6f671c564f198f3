//! Sideways motion and lean of an inserted needle, and oblique paths, against finite elements.
//!
//! `tests/references/needle_sideways.csv`: lateral force and displacements of points of the tissue per metre of lateral motion, and per
//! unit of lean (tangent), of a needle of the preset's capture radius in the preset's cylinder: first Fourier mode on the exact
//! state of the insertion (`tests/references/needle_sideways.py`). Tissue ahead of the tip is free there.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Health, Prediction, StampedPose, Twin};
use testkit::coarse::{alone, digits, rest, travel};

const REFERENCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/references/needle_sideways.csv");
/// Lateral motion of the test, m, and lean (sine).
const MOTION: f64 = 2.5e-4;
const LEAN: f64 = 0.05;

/// A row of the reference: depth, `sideways` or `lean`, force, and the displacements per unit of motion.
fn row(depth_m: f64, motion: &str) -> Vec<f64> {
    let reference = std::fs::read_to_string(REFERENCE).unwrap();
    let rows = reference.lines().skip(1).map(|l| l.split(',').collect::<Vec<_>>());
    let found = rows.filter(|r| r[1] == motion && (r[0].parse::<f64>().unwrap() - depth_m).abs() < 1e-9).last();
    found.unwrap()[2..].iter().map(|x| x.parse().unwrap()).collect()
}

fn needle(changes: &[(&str, &str)]) -> Twin {
    let all = [&[("discretisation.dimension", "full")], changes].concat();
    let changes: Vec<_> = all.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    alone(|| Twin::new(&Scene::preset("needle_insertion").unwrap().with(&changes).unwrap()).unwrap())
}

/// The preset with targets 0.5 and 1 mm ahead of a tip, beside it in x (2 mm above) and in y (1.5 mm above).
fn with_targets(depth_m: f64, changes: &[(&str, &str)]) -> Twin {
    let preset = Scene::preset("needle_insertion").unwrap().to_toml();
    let tip = 0.017 - depth_m;
    let places =
        [[0.0, 0.0, tip - 5e-4], [0.0, 0.0, tip - 1e-3], [1.5e-3, 0.0, tip + 2e-3], [0.0, 1.5e-3, tip + 1.5e-3]];
    let mut text = preset[..preset.find("[[targets]]").unwrap()].to_owned();
    for (i, p) in places.iter().enumerate() {
        text += &format!("[[targets]]\nname = \"t{i}\"\nposition_m = [{:.7}, {:.7}, {:.7}]\n", p[0], p[1], p[2]);
    }
    let all = [&[("discretisation.dimension", "full")], changes].concat();
    let changes: Vec<_> = all.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    alone(|| Twin::new(&Scene::from_toml(&text, "test").unwrap().with(&changes).unwrap()).unwrap())
}

pub fn targets(twin: &Twin) -> Vec<[f64; 3]> {
    let mut places = Vec::new();
    twin.target_positions(&mut places);
    places
}

/// Goes to a depth at once, m, and waits.
pub fn insert(twin: &mut Twin, depth_m: f64) -> Prediction {
    travel(twin, 0.0, depth_m, (depth_m / 2e-5).round() as u32);
    let pose = twin.pose_at_depth(depth_m);
    rest(twin, pose)
}

/// Moves or leans an inserted needle in 25 poses, waits, and returns the change of the force in x and of the targets.
fn moved(twin: &mut Twin, depth_m: f64, sideways_m: f64, lean: f64) -> (f64, Vec<[f64; 3]>) {
    let start = insert(twin, depth_m).force_n[0];
    let before = targets(twin);
    let pose = |twin: &Twin, s: f64| {
        let mut pose = twin.pose_at_depth(depth_m);
        pose.tip[0] += s * sideways_m;
        pose.axis = [s * lean, 0.0, -(1.0 - (s * lean).powi(2)).sqrt()];
        pose
    };
    for i in 1..25 {
        let pose = pose(twin, f64::from(i) / 25.0);
        twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
    }
    let pose = pose(twin, 1.0);
    let force = rest(twin, pose).force_n[0] - start;
    let now = targets(twin);
    (force, now.iter().zip(&before).map(|(a, b)| std::array::from_fn(|k| a[k] - b[k])).collect())
}

/// Compares with the reference: force within a share of it, displacements within a share of the largest motion of the needle.
fn compare(
    depth_m: f64,
    motion: &str,
    scale: f64,
    largest: f64,
    (force, points): (f64, Vec<[f64; 3]>),
    shares: [f64; 2],
) {
    let row = row(depth_m, motion);
    let wanted: Vec<f64> = row.iter().map(|x| scale * x).collect();
    let found = [points[0][0], points[1][0], points[2][0], points[2][2], points[3][0]];
    println!(
        "{motion} at {:.2} mm: force {force:.6} N of {:.6} N ({:+.2} %)",
        1e3 * depth_m,
        wanted[0],
        1e2 * (force / wanted[0] - 1.0)
    );
    println!(
        "  displacements, um: {:.1?} of {:.1?}",
        found.map(|x| 1e6 * x),
        wanted[1..].iter().map(|x| 1e6 * x).collect::<Vec<_>>()
    );
    assert!((force / wanted[0] - 1.0).abs() < shares[0], "{motion} at {depth_m} m: {force} N of {} N", wanted[0]);
    for (found, wanted) in found.iter().zip(&wanted[1..]) {
        assert!((found - wanted).abs() < shares[1] * largest, "{motion} at {depth_m} m: {found} m of {wanted} m");
    }
}

#[test]
fn tissue_ahead_of_the_tip_goes_sideways_with_the_needle() {
    // the second depth lies between two layers of nodes
    for depth_m in [4e-3, 2.6e-3] {
        let answer = moved(&mut with_targets(depth_m, &[]), depth_m, MOTION, 0.0);
        compare(depth_m, "sideways", MOTION, MOTION, answer, [0.015, 0.02]);
    }
}

#[test]
fn a_needle_that_leans_meets_the_force_of_the_tissue_behind_its_tip() {
    for depth_m in [4e-3, 2.6e-3] {
        let answer = moved(&mut with_targets(depth_m, &[]), depth_m, 0.0, LEAN);
        let tangent = LEAN / (1.0 - LEAN * LEAN).sqrt();
        // the axis points into the sample: the shaft goes to -x
        compare(depth_m, "lean", -tangent, tangent * depth_m, answer, [0.02, 0.02]);
    }
}

/// The lateral force of a needle that rests sideways has no saw-tooth at the distance of the layers, 0.25 mm.
#[test]
fn the_lateral_force_grows_evenly_with_the_depth() {
    let depths: Vec<f64> = (0..=5).map(|i| 2.5e-3 + 0.5e-4 * f64::from(i)).collect();
    let stiffness = |d: &f64| {
        let mut twin = needle(&[
            ("motion.depth_m", "0.0035"),
            ("discretisation.spacing_m", "0.003"),
            ("discretisation.edge_refinement", "0.0833"),
        ]);
        moved(&mut twin, *d, MOTION, 0.0).0 / MOTION
    };
    let found: Vec<f64> = depths.iter().map(stiffness).collect();
    println!("N/m: {found:.3?}");
    let (first, last) = (found[0], found[5]);
    for (i, k) in found.iter().enumerate() {
        let line = first + (last - first) * i as f64 / 5.0;
        assert!((k / line - 1.0).abs() < 0.01, "{:.3} mm: {k} N/m, {line} N/m on the line", 1e3 * depths[i]);
    }
}

/// The same force whatever the cloud, for spacings of a half to a quarter of the capture radius: the vector within 1 %, of the first path the
/// lateral component alone, too, for a half and a third. What the cloud's own irregularity makes of a force across the plane of the path,
/// where there is none, is as large as 1 % of that.
#[test]
fn the_force_of_an_oblique_needle_does_not_depend_on_the_cloud() {
    let [half, third, quarter] = ["0.0833", "0.0556", "0.0417"];
    let paths = [("0.26", 3e-3, &[half, "0.0714", third, "0.05", quarter][..]), ("0.15", 3e-3, &[half, quarter][..])];
    for (tilt, depth_m, refinements) in paths {
        let force = |refinement: &&str| {
            let changes = [
                ("instrument.tilt_rad", tilt),
                ("motion.depth_m", "0.0035"),
                ("discretisation.spacing_m", "0.003"),
                ("discretisation.edge_refinement", *refinement),
            ];
            insert(&mut needle(&changes), depth_m).force_n
        };
        let found: Vec<[f64; 3]> = refinements.iter().map(force).collect();
        let last = found[found.len() - 1];
        for (refinement, f) in refinements.iter().zip(&found) {
            let apart = apart(*f, last);
            println!(
                "tilt {tilt}, {refinement}: {f:.6?} N, {apart:.4} from the finest, lateral {:+.4}",
                f[0] / last[0] - 1.0
            );
            assert!(apart < 0.01, "{tilt} {refinement}: {f:?} {last:?}");
            let even = tilt == "0.26" && [half, third].contains(refinement);
            assert!(!even || (f[0] / last[0] - 1.0).abs() < 0.01, "lateral: {f:?} {last:?}");
            assert!(f[1].abs() < 0.0035 * size(last), "across the plane: {f:?}");
        }
    }
}

/// The same on the clouds of the half beside the plane of symmetry, which `auto` takes: nodes are 2.33 mm apart far away as the preset has
/// them, or 2.6 mm, another irregular cloud.
#[test]
fn nor_does_it_on_the_clouds_of_the_half() {
    for tilt in ["0.15", "0.26", "0.35"] {
        for (depth, depth_m) in [("0.002", 2e-3), ("0.003", 3e-3)] {
            let force = |spacing_m: f64, share: f64| {
                let [spacing, refinement] = [spacing_m, share * 5e-4 / spacing_m].map(|x| x.to_string());
                let changes = [
                    ("discretisation.dimension", "auto"),
                    ("instrument.tilt_rad", tilt),
                    ("motion.depth_m", depth),
                    ("discretisation.spacing_m", &spacing),
                    ("discretisation.edge_refinement", &refinement),
                ];
                let mut twin = needle(&changes);
                assert!(twin.repaired_supports() == 0, "{tilt}, {depth_m} m, {share}: supports were enlarged");
                insert(&mut twin, depth_m).force_n
            };
            let finest = force(2.33e-3, 0.25);
            for (spacing_m, share) in [(2.33e-3, 0.5), (2.6e-3, 0.5), (2.6e-3, 0.25)] {
                let f = force(spacing_m, share);
                let apart = apart(f, finest);
                println!("tilt {tilt}, {depth_m} m, {spacing_m} m, {share} R: {f:.6?} N, {apart:.4} from the finest");
                assert!(apart < 0.011, "{tilt}, {depth_m} m, {spacing_m} m, {share} R: {f:?} {finest:?}");
            }
        }
    }
}

/// Distance of two force vectors over the length of the second.
fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    size(std::array::from_fn(|k| a[k] - b[k])) / size(b)
}

fn size(f: [f64; 3]) -> f64 {
    f.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A needle that has been moved sideways goes on through tissue that was not: what it pierces further down is less and less aside.
#[test]
fn what_a_shifted_needle_pierces_further_down_is_not_aside() {
    let mut twin = with_targets(2e-3, &[]);
    let depth = 2e-3;
    moved(&mut twin, depth, 4e-4, 0.0);
    for i in 1..=100 {
        let mut pose = twin.pose_at_depth(depth + 2e-5 * f64::from(i));
        pose.tip[0] += 4e-4;
        twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
    }
    let mut pose = twin.pose_at_depth(2.0 * depth);
    pose.tip[0] += 4e-4;
    rest(&mut twin, pose);
    let x = targets(&twin);
    println!("0.5 and 1 mm below where it was moved: {:.1} um, {:.1} um", 1e6 * x[0][0], 1e6 * x[1][0]);
    assert!(x[0][0] > 1e-4 && x[0][0] < 4e-4 && x[1][0] > 5e-5 && x[1][0] < x[0][0], "{x:?}");
}

/// Sideways at 0.5 mm/s, a thousand poses a second: what inertia adds is taken out of the lateral force.
#[test]
fn the_lateral_force_on_the_way_is_that_at_rest() {
    let changes = [
        ("motion.depth_m", "0.0035"),
        ("discretisation.spacing_m", "0.003"),
        ("discretisation.edge_refinement", "0.0833"),
    ];
    let mut twin = needle(&changes);
    let start = insert(&mut twin, 3e-3).force_n;
    let mut last = start;
    let mut pose = twin.pose_at_depth(3e-3);
    for i in 1..=500 {
        pose.tip[0] = 5e-7 * f64::from(i);
        last = twin.step(StampedPose { time_s: 1e-3 * f64::from(i), pose }).unwrap().force_n;
        if i % 50 == 0 {
            println!("{:.3} mm: {:.6} N, {:.6} N", 5e-4 * f64::from(i), last[0] - start[0], last[2]);
        }
    }
    let resting = rest(&mut twin, pose).force_n;
    let (moving, resting_x) = (last[0] - start[0], resting[0] - start[0]);
    println!("moving {moving:.6} N, at rest {resting_x:.6} N; axial {:.6} N, {:.6} N", last[2], resting[2]);
    assert!((moving / resting_x - 1.0).abs() < 0.02, "{moving} N on the way, {resting_x} N at rest");
    assert!((last[2] / resting[2] - 1.0).abs() < 0.01, "the axial force: {} N, {} N", last[2], resting[2]);
}

/// Much faster: either the lateral force is still that at rest, or the imbalance says that it isn't.
#[test]
fn a_lateral_force_with_inertia_in_it_is_told() {
    let changes = [("motion.depth_m", "0.0035"), ("discretisation.spacing_m", "0.003")];
    let changes = [&changes[..], &[("discretisation.edge_refinement", "0.0833")]].concat();
    for (speed, most_steps) in [(5e-3, "1000"), (5e-2, "1000"), (5e-2, "2")] {
        let mut twin = needle(&[&changes[..], &[("stepping.max_steps_per_pose", most_steps)]].concat());
        let start = insert(&mut twin, 3e-3).force_n[0];
        let mut pose = twin.pose_at_depth(3e-3);
        let poses = (MOTION / speed * 1e3).round().max(1.0) as u32;
        let mut last = None;
        for i in 1..=poses {
            pose.tip[0] = MOTION * f64::from(i) / f64::from(poses);
            last = Some(twin.step(StampedPose { time_s: 1e-3 * f64::from(i), pose }).unwrap());
        }
        let last = last.unwrap();
        let resting = rest(&mut twin, pose).force_n[0] - start;
        let error = (last.force_n[0] - start) / resting - 1.0;
        let told = last.health.force_imbalance;
        println!("{speed} m/s, at most {most_steps} steps per pose: {:+.2} %, imbalance {told:.4}", 1e2 * error);
        assert!(error.abs() < 0.03 || told > 0.01 * Health::MOST_IMBALANCE, "{speed} m/s: {error:+.4}, {told}");
    }
}

/// The capture window is a length: by default one and a half layers of this cloud, 0.5 mm apart, and not another where a key says the same.
#[test]
fn the_capture_window_is_a_length() {
    let force = |window: &str| {
        let keys = [("instrument.capture_radius_m", "0.001"), ("instrument.capture_window_m", window)];
        let changes = [("motion.depth_m", "0.003"), ("discretisation.spacing_m", "0.003")];
        let mut twin = needle(&[&keys[..], &changes[..], &[("discretisation.edge_refinement", "0.1667")]].concat());
        digits(&travel(&mut twin, 0.0, 2e-3, 100))
    };
    let own = force("0");
    println!("{:?}", own.last());
    let of = ["0.00065", "0.00075", "0.00085"].map(|window| force(window) == own);
    assert_eq!(of, [false, true, false]);
}
