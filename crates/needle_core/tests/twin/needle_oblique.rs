//! Needles that go in oblique, beside the sample's axis, and both, against finite elements in three dimensions.
//!
//! `tests/references/needle_oblique.csv` (`needle_oblique.py` beside it): force vector and displacements per unit of a small
//! deformation coefficient, for which the problem is linear. `needle_oblique_finite.csv`: the whole ones at finite strain, for the preset's
//! coefficient of 0.4.
#![allow(clippy::unwrap_used)]

use crate::needle_sideways::{insert, targets};
use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use testkit::coarse::alone;

/// Small deformation coefficient of the tests: 40 um at the surface.
const SMALL: f64 = 0.01;
/// The preset's.
const LARGE: f64 = 0.4;

/// Of a case, per unit of the coefficient, from its finest mesh.
struct Reference {
    /// N
    force: [f64; 3],
    /// About the tip, N m.
    torque: [f64; 3],
    /// Places and their displacements, m.
    points: Vec<[[f64; 3]; 2]>,
}

fn reference(tilt: f64, entry: f64, depth_m: f64, coefficient: f64) -> Reference {
    let (file, unit) =
        if coefficient == SMALL { ("needle_oblique", 1.0) } else { ("needle_oblique_finite", coefficient) };
    let path = format!("{}/tests/references/{file}.csv", testkit::root().display());
    let text = std::fs::read_to_string(path).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let at = |name: &str| names.iter().position(|n| *n == name);
    let number = |cell: &str| cell.parse::<f64>().unwrap_or(0.0);
    let wanted = [("tilt_rad", tilt), ("entry_x_m", entry), ("depth_m", depth_m), ("coefficient", coefficient)];
    let cells = text.lines().skip(1).map(|l| l.split(',').collect::<Vec<_>>());
    let is = |r: &Vec<&str>| wanted.iter().all(|(name, x)| at(name).is_none_or(|i| (number(r[i]) - x).abs() < 1e-9));
    let of: Vec<_> = cells.filter(is).collect();
    let [elements, what, place, value] = ["elements", "what", "x_m", "x"].map(|name| at(name).unwrap());
    let finest = of.iter().map(|r| r[elements].parse::<u32>().unwrap()).max().unwrap().to_string();
    let three = |r: &Vec<&str>, from: usize| std::array::from_fn(|k| number(r[from + k]));
    let per_unit = |r: &Vec<&str>| three(r, value).map(|x| x / unit);
    let mut found = Reference { force: [0.0; 3], torque: [0.0; 3], points: Vec::new() };
    for r in of.iter().filter(|r| r[elements] == finest) {
        match r[what] {
            "force" => found.force = per_unit(r),
            "torque" => found.torque = per_unit(r),
            _ => found.points.push([three(r, place), per_unit(r)]),
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

fn compare(tilt: f64, entry: f64, depth_m: f64, coefficient: f64, within: &Within) {
    let Reference { force: wanted, torque: wanted_torque, points } = reference(tilt, entry, depth_m, coefficient);
    let preset = Scene::preset("needle_insertion").unwrap().to_toml();
    let mut text = preset[..preset.find("[[targets]]").unwrap()].to_owned();
    for (i, [p, _]) in points.iter().enumerate() {
        text += &format!("[[targets]]\nname = \"t{i}\"\nposition_m = [{:.9}, {:.9}, {:.9}]\n", p[0], p[1], p[2]);
    }
    let c = coefficient.to_string();
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
    let [force, torque] = [answer.force_n, answer.torque_nm].map(|v| v.map(|x| x / coefficient));
    let length = |a: [f64; 3]| a.iter().map(|x| x * x).sum::<f64>().sqrt();
    let apart = |a: [f64; 3], b: [f64; 3]| length(std::array::from_fn(|k| a[k] - b[k]));
    println!(
        "tilt {tilt}, entry {entry}, C_D {coefficient}: force {force:.5?} of {wanted:.5?} N: x {:+.2} %, z {:+.2} %, vector {:.2} %",
        1e2 * (force[0] / wanted[0] - 1.0),
        1e2 * (force[2] / wanted[2] - 1.0),
        1e2 * apart(force, wanted) / length(wanted)
    );
    let largest = depth_m / tilt.cos();
    println!("  torque about the tip {:.4?} of {:.4?} uN m", torque.map(|x| 1e6 * x), wanted_torque.map(|x| 1e6 * x));
    let arm = depth_m * length(wanted);
    assert!(apart(torque, wanted_torque) < within.torque * arm, "{torque:?} {wanted_torque:?}");
    for ((now, before), [_, by]) in targets(&twin).iter().zip(&before).zip(&points) {
        let found: [f64; 3] = std::array::from_fn(|k| (now[k] - before[k]) / coefficient);
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
    compare(0.0, 0.0, 4e-3, SMALL, &TWO_PER_CENT);
}

#[test]
fn an_oblique_needle_has_the_force_vector_of_finite_elements() {
    compare(0.3, 0.0, 4e-3, SMALL, &TWO_PER_CENT);
}

#[test]
fn a_needle_beside_the_axis_has_the_force_vector_of_finite_elements() {
    compare(0.0, 0.01, 4e-3, SMALL, &TWO_PER_CENT);
}

#[test]
fn an_oblique_needle_beside_the_axis_has_the_force_vector_of_finite_elements() {
    compare(0.3, 0.006, 3e-3, SMALL, &Within { vector: 0.02, lateral: 0.04, torque: 0.01, points: 0.015 });
}

/// At finite strain the surface at the shaft is drawn 0.8 to 1.6 mm down. Beyond 0.35 elements of the oblique one to 4 mm turn inside out.
/// On the axis, where there is no lateral force, it is held to 0.5 % of the whole. Torque over force times depth is 0.1 to 0.6 %, and 1.2 and
/// 1.9 % where the needle is oblique (0.8 and 1.0 % while nodes ahead of the tip were held along z alone, where the lateral force was 3 and
/// 6 % off: at the load cell, 0.1 m above, that is three to six times as much torque).
#[test]
fn at_the_presets_coefficient_the_force_vector_is_that_of_finite_elements() {
    let cases = [
        ((0.0, 0.0, 4e-3), LARGE, Within { lateral: 0.1, ..TWO_PER_CENT }),
        ((0.0, 0.01, 2e-3), LARGE, Within { lateral: 0.04, points: 0.02, ..TWO_PER_CENT }),
        ((0.0, 0.01, 4e-3), LARGE, TWO_PER_CENT),
        ((0.3, 0.0, 4e-3), 0.3, Within { torque: 0.02, ..TWO_PER_CENT }),
        ((0.3, 0.006, 3e-3), LARGE, Within { torque: 0.02, points: 0.015, ..TWO_PER_CENT }),
    ];
    for ((tilt, entry, depth_m), coefficient, within) in cases {
        compare(tilt, entry, depth_m, coefficient, &within);
    }
}
