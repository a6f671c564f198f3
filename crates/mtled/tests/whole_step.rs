//! Whole steps of a small model on three threads: small enough for Miri, which checks every access to memory
//! (docs/lab/soundness.md), and the same bits as on one thread.
#![allow(clippy::unwrap_used)]

use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings};
use mtled::cloud::{self, BASE, Cloud, Domain, Spacing, TOP};
use mtled::material::{Law, Prony};
use mtled::solver::{Advance, Balance, Precision, Role, Solver, SolverSettings, VolumeRatio};

/// A few dozen nodes under Miri, else enough for several blocks.
fn cube() -> Cloud {
    let far = if cfg!(miri) { 0.009 } else { 0.0025 };
    cloud::generate(&Domain::Box { size: [0.02; 3] }, &Spacing { far, growth: 0.3, features: vec![] }).unwrap()
}

/// Presses the top of a relaxing cube, goes back to a kept state once, and rests.
fn press(cloud: &Cloud, precision: Precision, threads: usize) -> (Balance, Vec<[f64; 3]>) {
    let settings = Settings {
        // four nodes to a point, so that Miri ends
        basis: if cfg!(miri) { None } else { Some(Basis::Quadratic { penalty: 1e-2 }) },
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 1,
    };
    let role: Vec<Role> = cloud
        .faces
        .iter()
        .map(|f| match f {
            f if f & BASE != 0 => Role::Base,
            f if f & TOP != 0 => Role::Instrument,
            _ => Role::Free,
        })
        .collect();
    let held = role.iter().map(|r| *r != Role::Free).collect();
    let table = Approximation::new(&cloud.points, &cloud.cells, held, settings).table().unwrap();
    let law = Law { prony: Prony::new(&[0.3], &[1.0]).unwrap(), ..Law::neo_hookean(1678.0, 83_340.0) };
    let settings = SolverSettings { law, volume_ratio: VolumeRatio::Projected, precision, step_factor: 0.8, threads };
    let mut solver = Solver::new(&table, &cloud.cells, &cloud.points, role.clone(), &settings);
    assert_eq!(solver.threads(), threads);
    let down = |solver: &mut Solver, depth: f64| {
        (0..role.len()).filter(|&n| role[n] == Role::Instrument).for_each(|n| solver.prescribe(n, [0.0, 0.0, -depth]));
    };
    for pose in 1..=3 {
        down(&mut solver, 1e-4 * f64::from(pose));
        solver.relax_until(0.1 * f64::from(pose));
        solver.advance(&Advance { steps: 2, travel: 1e-4 });
        solver.commit(0.1 * f64::from(pose));
        if pose == 2 {
            solver.save();
        }
    }
    solver.refresh_step();
    solver.restore(2.0);
    solver.relax_again(0.3);
    solver.advance(&Advance { steps: 3, travel: 0.0 });
    (solver.balance(), solver.parameters().to_vec())
}

#[test]
fn three_threads_give_the_bits_of_one() {
    let cloud = cube();
    println!("{} nodes, {} cells", cloud.points.len(), cloud.cells.len());
    let precisions: &[Precision] = if cfg!(miri) { &[Precision::F32] } else { &[Precision::F32, Precision::F64] };
    for &precision in precisions {
        let (one, three) = (press(&cloud, precision, 1), press(&cloud, precision, 3));
        assert!(one.0.instrument[2] > 0.0, "{:?}", one.0);
        assert_eq!(one, three, "{precision:?}");
    }
}
