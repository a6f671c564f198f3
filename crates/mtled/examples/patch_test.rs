//! Patch test: a linear displacement of the whole surface must come out linear inside.
//!
//! Linear tetrahedra do it to round-off. Meshless shape functions of interior nodes do not vanish on the surface between its
//! nodes, and one integration point per cell integrates their gradients with an error, so a constant stress leaves
//! small forces inside. The error is over the largest displacement.
#![allow(clippy::print_stdout)]

use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings};
use mtled::cloud::{self, Cloud, Domain, Spacing};
use mtled::material::Law;
use mtled::solver::{Advance, Precision, Role, Solver, SolverSettings, VolumeRatio};

/// Displacement gradient: stretch, compression and shear of up to 10 %.
const A: [[f64; 3]; 3] = [[0.06, 0.08, -0.03], [0.02, -0.05, 0.1], [0.04, -0.02, 0.01]];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let spacing = Spacing { far: 0.004, growth: 0.3, features: vec![] };
    let cloud = cloud::generate(&Domain::Box { size: [0.02; 3] }, &spacing)?;
    println!("{} nodes, {} cells", cloud.points.len(), cloud.cells.len());
    for (name, basis, most) in [
        ("linear tetrahedra", None, 1e-6),
        ("MLS", Some(Basis::Linear), 0.1),
        ("MMLS", Some(Basis::Quadratic { penalty: 1e-2 }), 0.1),
    ] {
        let error = patch_error(&cloud, basis)?;
        println!("{name:<18} {error:.1e}");
        assert!(error < most, "{name}: {error}");
    }
    Ok(())
}

fn linear(x: [f64; 3]) -> [f64; 3] {
    A.map(|row| row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn patch_error(cloud: &Cloud, basis: Option<Basis>) -> Result<f64, Box<dyn std::error::Error>> {
    let surface: Vec<bool> = cloud.faces.iter().map(|f| *f != 0).collect();
    let roles = surface.iter().map(|s| if *s { Role::Instrument } else { Role::Free }).collect();
    let settings = Settings { basis, support_factor: 1.8, points_per_cell: 1, cells_per_point: 1 };
    let approximation = Approximation::new(&cloud.points, &cloud.cells, surface.clone(), settings);
    let settings = SolverSettings {
        law: Law::neo_hookean(1678.0, 83_341.0),
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F64,
        step_factor: 0.9,
        threads: 1,
    };
    let mut solver = Solver::new(&approximation.table()?, &cloud.cells, &cloud.points, roles, &settings);
    for n in (0..surface.len()).filter(|n| surface[*n]) {
        solver.prescribe(n, linear(cloud.points[n]));
    }
    // two periods of the slowest mode over 2 pi to load it, then a rest, in which the deviation dies down as exp(-30)
    for times in [2.0, 30.0] {
        let steps = (times / solver.slowest()).ceil() as u32;
        solver.advance(&Advance { steps, travel: [0.0; 3] });
    }
    let field = approximation.field(&cloud.points)?;
    let largest = cloud.points.iter().map(|x| norm(linear(*x))).fold(0.0, f64::max);
    let off = |n: usize| {
        let (u, wanted) = (field.at(n, solver.parameters()), linear(cloud.points[n]));
        norm(std::array::from_fn(|k| u[k] - wanted[k]))
    };
    Ok((0..surface.len()).map(off).fold(0.0, f64::max) / largest)
}
