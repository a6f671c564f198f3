//! The force is right: the presets at their own speed against independent finite elements, as they ship (in the half
//! plane) to the full depths, in three dimensions to less.
//!
//! `needle_twin study verification` shows the same figures.
#![allow(clippy::unwrap_used)]

use needle_core::scene::Override;
use needle_estimate::compare::Cancel;
use needle_studies::verification::{self, Verification};
use testkit::coarse;

fn verify(preset: &'static str, depth_m: f64, changes: &[(&str, &str)]) -> Verification {
    let keys: Vec<Override> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    let done = coarse::alone(|| Verification::run(preset, &keys, Some(depth_m), &mut Cancel::default()).unwrap());
    println!("{}", verification::table(&done));
    done
}

const SPACE: (&str, &str) = ("discretisation.dimension", "full");
const WALL: (&str, &str) = ("instrument.wall_contact", "false");

/// Largest |relative error of the force| from a depth on.
fn largest(verification: &Verification, from_m: f64) -> f64 {
    assert_eq!(verification.compared.len(), verification.asked, "every depth was reached");
    let deep = verification.compared.iter().filter(|c| c.depth_m >= from_m * (1.0 - 1e-9));
    deep.map(|c| c.error().abs()).fold(0.0, f64::max)
}

fn reached(verification: &Verification, what: &str) -> f64 {
    verification.verdicts().iter().find(|v| v.what.starts_with(what)).unwrap().reached
}

/// Every target of every preset.
#[test]
fn the_presets_as_they_ship_meet_their_targets() {
    for (preset, depth_m) in [("compression", 2.5e-3), ("indentation", 1e-2), ("needle_insertion", 1e-2)] {
        let done = verify(preset, depth_m, &[]);
        assert_eq!(done.compared.len(), done.asked, "{preset}: every depth was reached");
        let missed: Vec<_> = done.verdicts().into_iter().filter(|v| !v.met()).collect();
        assert!(missed.is_empty(), "{preset}: {missed:?}");
    }
}

#[test]
fn compression_is_within_1_percent() {
    let done = verify("compression", 2.5e-3, &[SPACE]);
    assert!(largest(&done, 0.0) < 0.01);
    assert!(reached(&done, "force + base reaction") < 0.005);
}

#[test]
fn indentation_is_within_1_percent() {
    let done = verify("indentation", 4e-3, &[SPACE]);
    assert!(largest(&done, 0.0) < 0.01);
    assert!(reached(&done, "force + base reaction") < 0.005);
}

/// The reference of the displacements knows no wall.
#[test]
fn indentation_without_a_wall_moves_the_tissue_right() {
    for dimension in [&[WALL][..], &[WALL, SPACE]] {
        let done = verify("indentation", 4e-3, dimension);
        assert!(reached(&done, "displacement at 4 mm") < 0.01, "of the depth");
    }
}

#[test]
fn needle_is_within_3_percent_from_2_mm_on() {
    let done = verify("needle_insertion", 5e-3, &[SPACE]);
    assert!(largest(&done, 2e-3) < 0.03);
    assert!(reached(&done, "saw-tooth") < 0.02);
    assert!(reached(&done, "force + base reaction") < 0.005);
}

#[test]
fn double_precision_gives_the_same_force() {
    let force = |precision: &str| {
        let done = verify("needle_insertion", 2e-3, &[SPACE, ("discretisation.precision", precision)]);
        done.compared.last().unwrap().predicted_n
    };
    let (single, double) = (force("f32"), force("f64"));
    assert!((single / double - 1.0).abs() < 1e-4, "{single} {double}");
}

/// A discretisation that locks stiffens faster than the reference when Poisson's ratio comes near 1/2.
#[test]
fn the_force_rises_with_poissons_ratio_as_the_reference_does() {
    // depth in m and rise of the reference's force from nu = 0.49 to 0.495 and 0.499
    let references = [
        ("compression", 2.5e-3, [0.0128, 0.0233]),
        ("indentation", 4e-3, [0.0085, 0.0150]),
        ("needle_insertion", 1e-2, [0.0028, 0.0050]),
    ];
    for (preset, depth_m, rises) in references {
        let force =
            |nu: &str| verify(preset, depth_m, &[("material.poisson_ratio", nu)]).compared.last().unwrap().predicted_n;
        let soft = force("0.49");
        for (nu, rise) in ["0.495", "0.499"].into_iter().zip(rises) {
            let found = force(nu) / soft - 1.0;
            println!("{preset}, nu {nu}: rise {:.2} %, reference {:.2} %", 100.0 * found, 100.0 * rise);
            assert!((found - rise).abs() < 0.005, "{preset}, nu {nu}: {found}");
        }
    }
}

/// Other cases have no reference: the preset's cloud is held against one of half the spacing.
#[test]
fn other_cases_are_within_3_percent_of_a_finer_cloud() {
    let cases: [(&str, &[(&str, &str)]); 5] = [
        ("indentation", &[("instrument.diameter_m", "0.006")]),
        ("indentation", &[("instrument.diameter_m", "0.016")]),
        ("indentation", &[("sample.diameter_m", "0.05"), ("sample.height_m", "0.025")]),
        ("needle_insertion", &[("instrument.capture_radius_m", "0.001")]),
        ("needle_insertion", &[("instrument.deformation_coefficient", "0.7")]),
    ];
    for (preset, changes) in cases {
        let force = |finer: &[(&str, &str)]| {
            verify(preset, 4e-3, &[changes, finer].concat()).compared.last().unwrap().predicted_n
        };
        let spacing = if preset == "indentation" { "0.00095" } else { "0.001165" };
        let (own, finer) = (force(&[]), force(&[("discretisation.spacing_m", spacing)]));
        println!("{preset}, {changes:?}: {own:.6} N, with half the spacing {finer:.6} N");
        assert!((own / finer - 1.0).abs() < 0.03, "{preset}, {changes:?}: {own} {finer}");
    }
}
