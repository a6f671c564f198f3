//! What an answer must not depend on: the axes of the frame, the numbers of the nodes, the unit of length.
#![allow(clippy::unwrap_used)]

use crate::clouds;
use crate::clouds::{KAPPA, METHODS, MU, minus, norm, settings, uniform};
use mtled::approximation::table::Approximation;
use mtled::cloud::Cloud;
use mtled::material::Law;
use mtled::solver::{Advance, Role, Solver, SolverSettings};
use mtled::solver::{Kernel, Pool};
use mtled::solver::{Precision, VolumeRatio};
use needle_core::twin::Twin;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use testkit::coarse::{press, scene};

const RATIOS: [VolumeRatio; 4] =
    [VolumeRatio::Projected, VolumeRatio::Mixed, VolumeRatio::Averaged, VolumeRatio::Pointwise];

fn internal_force(
    points: &[[f64; 3]],
    cells: &[[u32; 4]],
    interpolating: &[bool],
    basis: Option<mtled::approximation::Basis>,
    ratio: VolumeRatio,
    u: &[[f64; 3]],
) -> Vec<[f64; 3]> {
    let table = Approximation::new(points, cells, interpolating.to_vec(), settings(basis, 1)).table().unwrap();
    let kernel = Kernel::<f64>::of_materials(&table, cells, points, &[Law::neo_hookean(MU, KAPPA)], ratio);
    kernel.internal_force(&mut Pool::new(1), u).force
}

/// A displacement that turns, stretches and bends the body, and shakes every node.
fn motion(points: &[[f64; 3]], random: &mut ChaCha8Rng) -> Vec<[f64; 3]> {
    let of = |x: &[f64; 3], noise: [f64; 3]| {
        [0.1 * x[2] + 20.0 * x[0] * x[2], 0.05 * x[0] - 0.08 * x[1], 10.0 * x[1] * x[1] - 0.1 * x[2] + 0.04 * x[0]]
            .iter()
            .zip(noise)
            .map(|(u, n)| u + 1e-4 * (n - 0.5))
            .collect::<Vec<f64>>()
    };
    points
        .iter()
        .map(|x| {
            let noise = std::array::from_fn(|_| uniform(random));
            let u = of(x, noise);
            [u[0], u[1], u[2]]
        })
        .collect()
}

fn random_rotation(random: &mut ChaCha8Rng) -> impl Fn(&[f64; 3]) -> [f64; 3] + use<> {
    let axis = nalgebra::Vector3::from_fn(|_, _| uniform(random) - 0.5).normalize();
    let r = nalgebra::Rotation3::from_scaled_axis(axis * (0.3 + 2.0 * uniform(random)));
    move |x| (r * nalgebra::Vector3::from(*x)).into()
}

/// Largest difference between two fields of forces over the largest force.
fn off(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let largest = a.iter().map(|f| norm(*f)).fold(0.0, f64::max);
    a.iter().zip(b).map(|(a, b)| norm(minus(*a, *b))).fold(0.0, f64::max) / largest
}

#[test]
fn a_rotated_cloud_has_rotated_forces() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let u = motion(&cloud.points, &mut random);
    for _ in 0..3 {
        let turn = random_rotation(&mut random);
        let turned = |v: &[[f64; 3]]| v.iter().map(&turn).collect::<Vec<_>>();
        for (name, basis) in METHODS {
            for ratio in RATIOS {
                let here = internal_force(&cloud.points, &cloud.cells, &interpolating, basis, ratio, &u);
                let there =
                    internal_force(&turned(&cloud.points), &cloud.cells, &interpolating, basis, ratio, &turned(&u));
                let off = off(&turned(&here), &there);
                println!("{name}, {ratio:?}: {off:.1e}");
                assert!(off < 1e-9, "{name}, {ratio:?}: {off:.1e}");
            }
        }
    }
}

#[test]
fn renumbered_nodes_and_cells_have_the_same_forces() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let u = motion(&cloud.points, &mut random);
    let shuffled = |count: usize, random: &mut ChaCha8Rng| {
        let mut order: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            order.swap(i, (uniform(random) * (i + 1) as f64) as usize);
        }
        order
    };
    // new node i is old node from[i]
    let from = shuffled(cloud.points.len(), &mut random);
    let mut to = vec![0; from.len()];
    from.iter().enumerate().for_each(|(new, &old)| to[old] = new as u32);
    let points: Vec<_> = from.iter().map(|&i| cloud.points[i]).collect();
    let held: Vec<_> = from.iter().map(|&i| interpolating[i]).collect();
    let moved: Vec<_> = from.iter().map(|&i| u[i]).collect();
    let cells: Vec<_> =
        shuffled(cloud.cells.len(), &mut random).into_iter().map(|c| cloud.cells[c].map(|n| to[n as usize])).collect();
    for (name, basis) in METHODS {
        // the projected dilatation chooses its coarse nodes in the nodes' order, which is geometric in every twin
        for ratio in [VolumeRatio::Averaged, VolumeRatio::Pointwise] {
            let old = internal_force(&cloud.points, &cloud.cells, &interpolating, basis, ratio, &u);
            let new = internal_force(&points, &cells, &held, basis, ratio, &moved);
            let back: Vec<_> = to.iter().map(|&n| new[n as usize]).collect();
            let off = off(&old, &back);
            println!("{name}, {ratio:?}: {off:.1e}");
            assert!(off < 1e-11, "{name}, {ratio:?}: {off:.1e}");
        }
    }
}

/// The whole solution, not one evaluation: lengths in metres and in millimetres (Pa -> N/mm^2, N stays N).
#[test]
fn metres_and_millimetres_give_the_same_force() {
    let force = |unit: f64| {
        let mut cloud: Cloud = clouds::cylinder_with_path().0;
        cloud.points.iter_mut().flatten().for_each(|x| *x *= unit);
        let top = clouds::HEIGHT * unit;
        let role: Vec<Role> = cloud
            .points
            .iter()
            .map(|p| match p[2] {
                z if z <= 0.0 => Role::Base,
                z if z >= top * (1.0 - 1e-9) => Role::Instrument,
                _ => Role::Free,
            })
            .collect();
        let held: Vec<bool> = role.iter().map(|r| *r != Role::Free).collect();
        let table = Approximation::new(&cloud.points, &cloud.cells, held, settings(clouds::MMLS, 1)).table().unwrap();
        let settings = SolverSettings {
            law: Law::neo_hookean(MU / (unit * unit), KAPPA / (unit * unit)),
            volume_ratio: VolumeRatio::Projected,
            precision: Precision::F64,
            step_factor: 0.9,
            threads: 2,
        };
        let mut solver = Solver::new(&table, &cloud.cells, &cloud.points, role.clone(), &settings);
        for _ in 0..10 {
            for n in (0..role.len()).filter(|&n| role[n] == Role::Instrument) {
                let u = solver.parameters()[n][2] - 5e-5 * unit;
                solver.prescribe(n, [0.0, 0.0, u]);
            }
            solver.advance(&Advance { steps: 40, travel: [0.0, 0.0, 5e-5 * unit] });
        }
        solver.balance().instrument[2]
    };
    let (metres, millimetres) = (force(1.0), force(1e3));
    println!("{metres:.12} N in metres, {millimetres:.12} N in millimetres");
    assert!(metres > 0.05, "{metres}");
    assert!((millimetres / metres - 1.0).abs() < 1e-9, "{:.1e}", millimetres / metres - 1.0);
}

/// The same scene beside the frame's origin: a box whose indenter stands off its centre by some way, mirrored.
#[test]
fn quarter_turns_of_the_scene_turn_the_force() {
    let force = |x: &str, y: &str| {
        let changes = [("instrument.entry_x_m", x), ("instrument.entry_y_m", y)];
        press(&mut Twin::new(&scene("indentation", &changes)).unwrap(), 1e-3).force_n
    };
    let (right, back) = (force("0.005", "0"), force("0", "0.005"));
    println!("{right:?} {back:?}");
    assert!((right[2] / back[2] - 1.0).abs() < 0.02, "{right:?} {back:?}");
    assert!((right[0] - back[1]).abs() < 0.02 * right[2] && (right[1] + back[0]).abs() < 0.02 * right[2]);
}
