//! Rods against closed forms: Euler-Bernoulli, the elastica, Euler's buckling load, a beam on an elastic foundation.

#![allow(clippy::unwrap_used)]

use elastic_rod::{Clamp, Force, Rod, Section, Spring};
use proptest::prelude::*;

const DOWN: Clamp = Clamp { place: [0.0, 0.0, 0.1], direction: [0.0, 0.0, -1.0] };
/// A steel needle of 20 G.
const STEEL: Section = Section { outer_diameter: 0.9e-3, inner_diameter: 0.6e-3, youngs_modulus: 2e11 };
const LENGTH: f64 = 0.1;

fn rod(segments: usize) -> Rod {
    Rod::new(&STEEL, LENGTH, segments, &DOWN)
}

fn at_tip(force: [f64; 3]) -> Force {
    Force { arc: LENGTH, force }
}

#[test]
fn a_small_force_bends_it_as_euler_and_bernoulli_say() {
    let mut rod = rod(50);
    let force = 1e-3;
    rod.settle(&DOWN, &[at_tip([force, 0.0, 0.0])], &[]).unwrap();
    let exact = |s: f64| force * s * s * (3.0 * LENGTH - s) / (6.0 * STEEL.bending_stiffness());
    for s in [0.02, 0.05, 0.08, 0.1] {
        let off = rod.at(s)[0];
        assert!((off / exact(s) - 1.0).abs() < 1e-3, "{s}: {off} against {}", exact(s));
    }
}

/// Bisshopp and Drucker, "Large deflection of cantilever beams" (1945): F L^2 / (E I) = 5 has 0.7137 L of deflection, and 0.6123 of the
/// length is left along the clamp's direction.
#[test]
fn a_large_force_makes_an_elastica() {
    let mut rod = rod(200);
    let full = 5.0 * STEEL.bending_stiffness() / LENGTH.powi(2);
    for share in 1..=10 {
        rod.settle(&DOWN, &[at_tip([full * f64::from(share) / 10.0, 0.0, 0.0])], &[]).unwrap();
    }
    let tip = rod.at(LENGTH);
    assert!((tip[0] / LENGTH - 0.71379).abs() < 5e-4, "{tip:?}");
    assert!(((0.1 - tip[2]) / LENGTH - 0.61232).abs() < 5e-4, "{tip:?}");
}

/// A fixed and a free end: pi^2 E I / (4 L^2).
#[test]
fn it_buckles_at_eulers_load() {
    let critical = std::f64::consts::PI.powi(2) * STEEL.bending_stiffness() / (4.0 * LENGTH * LENGTH);
    let deflection = |share: f64| {
        let mut rod = rod(50);
        rod.settle(&DOWN, &[at_tip([1e-6, 0.0, share * critical])], &[]).unwrap();
        rod.at(LENGTH)[0]
    };
    let (below, above) = (deflection(0.98), deflection(1.02));
    assert!(below < 1e-4 && above > 1e-2, "{below} m below the load, {above} m above it");
}

/// Hetenyi: the free end of a long beam on springs of k N/m^2, pushed by F: 2 F b / k with b = (k / (4 E I))^(1/4).
#[test]
fn on_a_foundation_it_bends_as_winklers_beam() {
    let k = 2e4;
    let beta = (k / (4.0 * STEEL.bending_stiffness())).powf(0.25);
    let length = 8.0 / beta;
    let clamp = Clamp { place: [0.0, 0.0, length], ..DOWN };
    let count = 400;
    let mut rod = Rod::new(&STEEL, length, 200, &clamp);
    let apart = length / f64::from(count);
    let springs: Vec<Spring> = (0..count)
        .map(|i| {
            let arc = (f64::from(i) + 0.5) * apart;
            Spring { arc, place: [0.0, 0.0, length - arc], axis: [0.0, 0.0, 1.0], stiffness: k * apart }
        })
        .collect();
    let force = 1e-3;
    rod.settle(&clamp, &[Force { arc: length, force: [0.0, force, 0.0] }], &springs).unwrap();
    let (tip, exact) = (rod.at(length)[1], 2.0 * force * beta / k);
    assert!((tip / exact - 1.0).abs() < 5e-3, "{tip} against {exact}");
    let back: f64 = springs.iter().map(|s| s.force(rod.at(s.arc))[1]).sum();
    assert!((back / force + 1.0).abs() < 1e-3, "the springs hold {back} of {force}");
}

#[test]
fn it_goes_with_its_clamp() {
    let mut rod = rod(40);
    rod.settle(&DOWN, &[at_tip([0.05, 0.0, 0.0])], &[]).unwrap();
    let before = rod.energy(&DOWN);
    let to = Clamp { place: [0.01, -0.02, 0.3], direction: [0.6, 0.0, -0.8] };
    rod.carry(&DOWN, &to);
    assert!((rod.energy(&to) / before - 1.0).abs() < 1e-9);
    let tip = rod.tip_direction();
    assert!((tip.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
}

#[test]
fn what_has_no_equilibrium_is_said_and_changes_nothing() {
    let mut rod = rod(20);
    let before = rod.vertices().to_vec();
    assert!(rod.settle(&DOWN, &[at_tip([f64::NAN, 0.0, 0.0])], &[]).is_err());
    assert_eq!(rod.vertices(), before);
}

proptest! {
    /// Maxwell and Betti: a force at one point moves another as far as the same force there moves the first.
    #[test]
    fn points_move_each_other_alike(a in 0.02..0.1_f64, b in 0.02..0.1_f64) {
        let moved = |by: f64, of: f64| {
            let mut rod = rod(50);
            rod.settle(&DOWN, &[Force { arc: by, force: [1e-4, 0.0, 0.0] }], &[]).unwrap();
            rod.at(of)[0]
        };
        let (there, back) = (moved(a, b), moved(b, a));
        prop_assert!((there / back - 1.0).abs() < 1e-4, "{there} {back}");
    }

    /// The work of a slowly growing force is the energy that the rod has: none is created.
    #[test]
    fn the_work_of_a_force_is_stored(angle in 0.0..6.2_f64, share in 0.1..2.0_f64) {
        let full = share * STEEL.bending_stiffness() / LENGTH.powi(2);
        let mut rod = rod(40);
        let (mut work, mut last) = (0.0, rod.at(LENGTH));
        let parts = 40;
        for i in 1..=parts {
            let force = full * f64::from(i) / f64::from(parts);
            let middle = force - 0.5 * full / f64::from(parts);
            let way = [angle.cos(), angle.sin(), 0.0];
            rod.settle(&DOWN, &[at_tip(way.map(|x| force * x))], &[]).unwrap();
            let now = rod.at(LENGTH);
            work += (0..3).map(|k| middle * way[k] * (now[k] - last[k])).sum::<f64>();
            last = now;
        }
        prop_assert!((work / rod.energy(&DOWN) - 1.0).abs() < 2e-3, "{work} {}", rod.energy(&DOWN));
    }
}
