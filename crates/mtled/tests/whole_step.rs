//! Whole steps of a small model on three threads: small enough for Miri, which checks every access to memory
//! (docs/lab/soundness.md), and the same bits as on one thread.
#![allow(clippy::unwrap_used)]

use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings};
use mtled::material::{Law, Prony};
use mtled::solver::{Advance, Balance, Precision, Role, Solver, SolverSettings, VolumeRatio};

/// A cube of 20 mm: points in layers from the base up, and tetrahedra.
struct Cube {
    points: Vec<[f64; 3]>,
    cells: Vec<[u32; 4]>,
    layer: usize,
}

/// So many points along each edge: 27 in all under Miri, else enough for several blocks. Each small cube is six
/// tetrahedra round its diagonal.
fn cube() -> Cube {
    let n: usize = if cfg!(miri) { 3 } else { 9 };
    let at = |i: usize| 0.02 * i as f64 / (n - 1) as f64;
    let index = |i: [usize; 3]| ((i[2] * n + i[1]) * n + i[0]) as u32;
    let all = |count: usize| (0..count.pow(3)).map(move |m| [m % count, m / count % count, m / count / count]);
    let paths = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let cells = all(n - 1).flat_map(|corner| {
        (0..6).map(move |p| {
            let mut i = corner;
            let mut cell = [index(i); 4];
            for (step, axis) in paths[p].into_iter().enumerate() {
                i[axis] += 1;
                cell[step + 1] = index(i);
            }
            // odd orders of the axes turn a tetrahedron inside out
            if p > 2 {
                cell.swap(0, 1);
            }
            cell
        })
    });
    Cube { points: all(n).map(|i| i.map(at)).collect(), cells: cells.collect(), layer: n * n }
}

/// Presses the top of a relaxing cube, goes back to a kept state once, and rests.
fn press(cube: &Cube, precision: Precision, threads: usize) -> (Balance, Vec<[f64; 3]>) {
    let Cube { points, cells, layer } = cube;
    let role: Vec<Role> = (0..points.len())
        .map(|n| match n {
            n if n < *layer => Role::Base,
            n if n >= points.len() - layer => Role::Instrument,
            _ => Role::Free,
        })
        .collect();
    let held = role.iter().map(|r| *r != Role::Free).collect();
    let settings = Settings {
        // four nodes to a point, so that Miri ends
        basis: if cfg!(miri) { None } else { Some(Basis::Quadratic { penalty: 1e-2 }) },
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 1,
    };
    let table = Approximation::new(points, cells, held, settings).table().unwrap();
    let law = Law { prony: Prony::new(&[0.3], &[1.0]).unwrap(), ..Law::neo_hookean(1678.0, 83_340.0) };
    let settings = SolverSettings { law, volume_ratio: VolumeRatio::Projected, precision, step_factor: 0.8, threads };
    let mut solver = Solver::new(&table, cells, points, role.clone(), &settings);
    assert_eq!(solver.threads(), threads);
    let down = |solver: &mut Solver, depth: f64| {
        (0..role.len()).filter(|&n| role[n] == Role::Instrument).for_each(|n| solver.prescribe(n, [0.0, 0.0, -depth]));
    };
    for pose in 1..=3 {
        down(&mut solver, 1e-4 * f64::from(pose));
        solver.relax_until(0.1 * f64::from(pose));
        solver.advance(&Advance { steps: 2, travel: [0.0, 0.0, 1e-4] });
        solver.commit(0.1 * f64::from(pose));
        if pose == 2 {
            solver.save();
        }
    }
    solver.refresh_step();
    solver.restore(2.0);
    solver.relax_again(0.3);
    solver.advance(&Advance { steps: 3, travel: [0.0; 3] });
    (solver.balance(), solver.parameters().to_vec())
}

#[test]
fn three_threads_give_the_bits_of_one() {
    let cube = cube();
    let precisions: &[Precision] = if cfg!(miri) { &[Precision::F32] } else { &[Precision::F32, Precision::F64] };
    for &precision in precisions {
        let (one, three) = (press(&cube, precision, 1), press(&cube, precision, 3));
        assert!(one.0.instrument[2] > 0.0, "{:?}", one.0);
        assert_eq!(one, three, "{precision:?}");
    }
}
