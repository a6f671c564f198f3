//! Whole steps of a small model on three threads: small enough for Miri, which checks every access to memory
//! (docs/lab/soundness.md), and the same bits as on one thread.
#![allow(clippy::unwrap_used)]

use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings, ShapeTable};
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

/// Nodes at the bottom, at the top, and others.
fn roles(cube: &Cube, top: Role) -> Vec<Role> {
    let Cube { points, layer, .. } = cube;
    (0..points.len())
        .map(|n| match n {
            n if n < *layer => Role::Base,
            n if n >= points.len() - layer => top,
            _ => Role::Free,
        })
        .collect()
}

fn shape_table(Cube { points, cells, .. }: &Cube, role: &[Role]) -> ShapeTable {
    let held = role.iter().map(|r| *r != Role::Free).collect();
    let settings = Settings {
        // four nodes to a point, so that Miri ends
        basis: if cfg!(miri) { None } else { Some(Basis::Quadratic { penalty: 1e-2 }) },
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 1,
    };
    Approximation::new(points, cells, held, settings).table().unwrap()
}

/// Presses the top of a relaxing cube, goes back to a kept state once, and rests.
fn press(cube: &Cube, precision: Precision, threads: usize) -> (Balance, Vec<[f64; 3]>) {
    let Cube { points, cells, .. } = cube;
    let role = roles(cube, Role::Instrument);
    let table = shape_table(cube, &role);
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

/// The top goes down, and is drawn aside by springs.
fn drawn(cube: &Cube, guide: impl Fn(&mut Solver, usize, [f64; 3])) -> (Balance, Vec<[f64; 3]>) {
    let role = roles(cube, Role::Guided);
    let table = shape_table(cube, &role);
    let law = Law::neo_hookean(1678.0, 83_340.0);
    let settings = SolverSettings {
        law,
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F64,
        step_factor: 0.8,
        threads: 1,
    };
    let mut solver = Solver::new(&table, &cube.cells, &cube.points, role.clone(), &settings);
    for pose in 1..=5 {
        let to = [5e-5 * f64::from(pose), 0.0, -1e-4 * f64::from(pose)];
        (0..role.len()).filter(|&n| role[n] == Role::Guided).for_each(|n| guide(&mut solver, n, to));
        solver.advance(&Advance { steps: 4, travel: [5e-5, 0.0, -1e-4] });
    }
    (solver.balance(), solver.parameters().to_vec())
}

/// Along z both ways to guide a node are one; along another line the node is on it, and the spring acts across it.
#[test]
fn a_node_is_guided_along_its_line() {
    let cube = cube();
    let spring = 2.0;
    let (upright, u) = drawn(&cube, |solver, n, to| solver.guide(n, to, spring));
    let (along, v) = drawn(&cube, |solver, n, to| solver.guide_along(n, to, spring, [0.0, 0.0, -1.0]));
    let size = upright.instrument[2].abs();
    (0..3).for_each(|k| {
        assert!((upright.instrument[k] - along.instrument[k]).abs() < 1e-9 * size, "{upright:?} {along:?}")
    });
    u.iter().zip(&v).for_each(|(u, v)| (0..3).for_each(|k| assert!((u[k] - v[k]).abs() < 1e-12)));
    let axis = [0.6, 0.0, -0.8];
    let (_, v) = drawn(&cube, |solver, n, to| solver.guide_along(n, to, spring, axis));
    let to = [2.5e-4, 0.0, -5e-4];
    for u in &v[cube.points.len() - cube.layer..] {
        let off: f64 = (0..3).map(|k| (u[k] - to[k]) * axis[k]).sum();
        assert!(off.abs() < 1e-12, "{u:?}");
    }
    assert!(v.iter().any(|u| (u[0] - to[0]).abs() > 1e-6), "tissue holds back across the line");
}
