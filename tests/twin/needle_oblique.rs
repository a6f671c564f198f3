//! Needles that go in oblique, beside the sample's axis, and both, against finite elements in three dimensions.
//!
//! `tests/references/needle_oblique.csv` (`needle_oblique.py` beside it): force vector and displacements per unit of a small
//! deformation coefficient, for which the problem is linear.
#![allow(clippy::unwrap_used)]

use crate::coarse::alone;
use crate::needle_sideways::{insert, targets};
use needle_twin::scene::{Override, Scene};
use needle_twin::twin::Twin;

const REFERENCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/references/needle_oblique.csv");
/// Deformation coefficient of the test: 40 um at the surface.
const COEFFICIENT: f64 = 0.01;

/// Of a case, per unit of the coefficient, from its finest mesh.
struct Reference {
    /// N
    force: [f64; 3],
    /// About the tip, N m.
    torque: [f64; 3],
    /// Places and their displacements, m.
    points: Vec<[[f64; 3]; 2]>,
}

fn reference(tilt: f64, entry: f64) -> Reference {
    let text = std::fs::read_to_string(REFERENCE).unwrap();
    let number = |cell: &str| cell.parse::<f64>().unwrap_or(0.0);
    let cells = text.lines().skip(1).map(|l| l.split(',').collect::<Vec<_>>());
    let of: Vec<_> = cells.filter(|r| number(r[0]) == tilt && number(r[1]) == entry).collect();
    let finest = of.iter().map(|r| r[3].parse::<u32>().unwrap()).max().unwrap().to_string();
    let three = |r: &Vec<&str>, from: usize| std::array::from_fn(|k| number(r[from + k]));
    let mut found = Reference { force: [0.0; 3], torque: [0.0; 3], points: Vec::new() };
    for r in of.iter().filter(|r| r[3] == finest) {
        match r[4] {
            "force" => found.force = three(r, 8),
            "torque" => found.torque = three(r, 8),
            _ => found.points.push([three(r, 5), three(r, 8)]),
        }
    }
    found
}

/// Bounds on errors: of the force over the whole, of the lateral force over itself, of the torque about the tip over
/// force times depth, of displacements over the largest.
struct Within {
    vector: f64,
    lateral: f64,
    torque: f64,
    points: f64,
}

fn compare(tilt: f64, entry: f64, depth_m: f64, within: &Within) {
    let Reference { force: wanted, torque: wanted_torque, points } = reference(tilt, entry);
    let preset = Scene::preset("needle_insertion").unwrap().to_toml();
    let mut text = preset[..preset.find("[[targets]]").unwrap()].to_owned();
    for (i, [p, _]) in points.iter().enumerate() {
        text += &format!("[[targets]]\nname = \"t{i}\"\nposition_m = [{:.9}, {:.9}, {:.9}]\n", p[0], p[1], p[2]);
    }
    let c = COEFFICIENT.to_string();
    let numbers = [tilt.to_string(), entry.to_string(), "0.006".to_owned()];
    let changes = [
        ("instrument.tilt_rad", numbers[0].as_str()),
        ("instrument.entry_x_m", &numbers[1]),
        ("instrument.deformation_coefficient", &c),
        ("instrument.retraction_coefficient", &c),
        ("motion.depth_m", &numbers[2]),
        ("instrument.load_cell_height_m", "0"),
        ("discretisation.dimension", "mirrored"),
    ];
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    let scene = Scene::from_toml(&text, "test").unwrap().with(&changes).unwrap();
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    let before = targets(&twin);
    let answer = insert(&mut twin, depth_m / tilt.cos());
    let [force, torque] = [answer.force_n, answer.torque_nm].map(|v| v.map(|x| x / COEFFICIENT));
    let length = |a: [f64; 3]| a.iter().map(|x| x * x).sum::<f64>().sqrt();
    let apart = |a: [f64; 3], b: [f64; 3]| length(std::array::from_fn(|k| a[k] - b[k]));
    println!(
        "tilt {tilt}, entry {entry}: force {force:.5?} of {wanted:.5?} N: x {:+.2} %, z {:+.2} %, vector {:.2} %",
        1e2 * (force[0] / wanted[0] - 1.0),
        1e2 * (force[2] / wanted[2] - 1.0),
        1e2 * apart(force, wanted) / length(wanted)
    );
    let largest = depth_m / tilt.cos();
    println!("  torque about the tip {:.4?} of {:.4?} uN m", torque.map(|x| 1e6 * x), wanted_torque.map(|x| 1e6 * x));
    let arm = depth_m * length(wanted);
    assert!(apart(torque, wanted_torque) < within.torque * arm, "{torque:?} {wanted_torque:?}");
    for ((now, before), [_, by]) in targets(&twin).iter().zip(&before).zip(&points) {
        let found: [f64; 3] = std::array::from_fn(|k| (now[k] - before[k]) / COEFFICIENT);
        let off = apart(found, *by) / largest;
        println!(
            "  {:.4?} of {:.4?} mm, off by {:.2} % of the largest",
            found.map(|x| 1e3 * x),
            by.map(|x| 1e3 * x),
            1e2 * off
        );
        assert!(off < within.points, "{found:?} {by:?}");
    }
    assert!(apart(force, wanted) < within.vector * length(wanted), "{force:?} {wanted:?}");
    let lateral = wanted[0].abs().max(0.05 * length(wanted));
    assert!((force[0] - wanted[0]).abs() < within.lateral * lateral, "{force:?} {wanted:?}");
}

const TWO_PER_CENT: Within = Within { vector: 0.02, lateral: 0.02, torque: 0.01, points: 0.01 };

#[test]
fn straight_down_the_axis() {
    compare(0.0, 0.0, 4e-3, &TWO_PER_CENT);
}

#[test]
fn an_oblique_needle_has_the_force_vector_of_finite_elements() {
    compare(0.3, 0.0, 4e-3, &TWO_PER_CENT);
}

#[test]
fn a_needle_beside_the_axis_has_the_force_vector_of_finite_elements() {
    compare(0.0, 0.01, 4e-3, &TWO_PER_CENT);
}

#[test]
fn an_oblique_needle_beside_the_axis_has_the_force_vector_of_finite_elements() {
    compare(0.3, 0.006, 3e-3, &Within { vector: 0.02, lateral: 0.045, torque: 0.01, points: 0.015 });
}
