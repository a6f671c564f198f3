//! Uniaxial compression against its formula.
//!
//! A homogeneous state with free sides: axial stretch l, lateral stretch l_t, J = l l_t^2, I1 = l^2 + 2 l_t^2,
//!
//! ```text
//! mu J^-2/3 (l_t^2 - I1/3) + kappa J (J - 1) = 0              gives l_t
//! P = mu J^-2/3 (l - I1/(3 l)) + kappa J (J - 1)/l            nominal stress, Pa
//! ```
//!
//! The surface of a cube is moved by that state; the points inside have to find it, and their mean stress is P, up to what
//! MMLS misses on a cloud this coarse (see the example `patch_test`): 1.8 %.
#![allow(clippy::print_stdout)]

use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings};
use mtled::cloud::{self, Cloud, Domain, Spacing};
use mtled::material::Law;
use mtled::solver::{Advance, Precision, Role, Solver, SolverSettings, VolumeRatio};

const MU: f64 = 1678.0;
const KAPPA: f64 = 83_341.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let spacing = Spacing { far: 0.004, growth: 0.3, features: vec![] };
    let cloud = cloud::generate(&Domain::Box { size: [0.02; 3] }, &spacing)?;
    let mut solver = solver(&cloud)?;
    println!("compression   l_t       P by the formula   P of the points   difference");
    for percent in [1, 5, 10, 15, 20] {
        let l = 1.0 - 0.01 * f64::from(percent);
        let lateral = lateral_stretch(l);
        for (n, x) in cloud.points.iter().enumerate().filter(|(n, _)| cloud.faces[*n] != 0) {
            solver.prescribe(n, [(lateral - 1.0) * x[0], (lateral - 1.0) * x[1], (l - 1.0) * x[2]]);
        }
        solver.advance(&Advance { steps: 400, travel: [0.0; 3] });
        let (formula, points) = (nominal_stress(l, lateral), mean_stress(&solver));
        let off = 100.0 * (points / formula - 1.0);
        println!("{percent:>9} % {lateral:>9.5} {formula:>16.2} Pa {points:>14.2} Pa {off:>10.3} %");
        assert!(off.abs() < 2.0, "the points' stress is off by {off} %");
    }
    Ok(())
}

/// The whole surface is held, the inside is free.
fn solver(cloud: &Cloud) -> Result<Solver, Box<dyn std::error::Error>> {
    let surface: Vec<bool> = cloud.faces.iter().map(|f| *f != 0).collect();
    let roles = surface.iter().map(|s| if *s { Role::Instrument } else { Role::Free }).collect();
    let settings = Settings {
        basis: Some(Basis::Quadratic { penalty: 1e-2 }),
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 1,
    };
    let table = Approximation::new(&cloud.points, &cloud.cells, surface, settings).table()?;
    let settings = SolverSettings {
        law: Law::neo_hookean(MU, KAPPA),
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F64,
        step_factor: 0.9,
        threads: 2,
    };
    Ok(Solver::new(&table, &cloud.cells, &cloud.points, roles, &settings))
}

/// J^-2/3, I1 and J.
fn invariants(l: f64, lateral: f64) -> (f64, f64, f64) {
    let j = l * lateral * lateral;
    (j.cbrt().powi(-2), l * l + 2.0 * lateral * lateral, j)
}

/// l_t by bisection: the lateral stress rises with it.
fn lateral_stretch(l: f64) -> f64 {
    let (mut low, mut high) = (0.5, 2.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let (scale, i1, j) = invariants(l, middle);
        let stress = MU * scale * (middle * middle - i1 / 3.0) + KAPPA * j * (j - 1.0);
        if stress > 0.0 { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}

fn nominal_stress(l: f64, lateral: f64) -> f64 {
    let (scale, i1, j) = invariants(l, lateral);
    MU * scale * (l - i1 / (3.0 * l)) + KAPPA * j * (j - 1.0) / l
}

/// Mean of P_33 over the volume, Pa.
fn mean_stress(solver: &Solver) -> f64 {
    let (mut sum, mut volume) = (0.0, 0.0);
    solver.for_points(|_, _, stress, v| {
        sum += v * stress[8];
        volume += v;
    });
    sum / volume
}
