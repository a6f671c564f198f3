//! Contract of the shape functions: partition of unity, linear reproduction, exact derivatives, interpolation where
//! it is promised. On the presets' cylinder with a needle's path, whose graded and interpolating nodes are the hard case.
#![allow(clippy::unwrap_used)]

mod clouds;

use approx::assert_abs_diff_eq;
use clouds::{METHODS, MLS, MMLS, inside, minus, norm, settings};
use mtled::approximation::Basis;
use mtled::approximation::mls::Fit;
use mtled::approximation::support::{Supports, distance, radii};
use mtled::approximation::table::Approximation;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// What linear reproduction may be off by, relative to the size of the cylinder.
const LINEAR: f64 = 1e-10;
const SIZE: f64 = 0.03;

/// Random points, and points at 1 nm to 0.1 mm from interpolating nodes, where the weight is almost singular.
fn probes(cloud: &mtled::cloud::Cloud, interpolating: &[bool]) -> Vec<[f64; 3]> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut at: Vec<_> = (0..400).map(|_| inside(cloud, &mut random)).collect();
    let held = cloud.points.iter().zip(interpolating).filter(|(_, i)| **i).map(|(p, _)| *p);
    for (n, p) in held.step_by(7).enumerate() {
        let towards = minus([0.0, 0.0, 0.5 * clouds::HEIGHT], p);
        let off = 10f64.powi(-9 + (n % 6) as i32) / norm(towards);
        at.push(std::array::from_fn(|k| p[k] + off * towards[k]));
    }
    at
}

#[test]
fn values_sum_to_one_and_reproduce_linear_fields() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let mut at = probes(&cloud, &interpolating);
    at.extend(&cloud.points);
    for (name, basis) in METHODS {
        let settings = settings(basis, 1);
        let field =
            Approximation::new(&cloud.points, &cloud.cells, interpolating.clone(), settings).field(&at).unwrap();
        assert_eq!(field.len(), at.len());
        for (i, x) in at.iter().enumerate() {
            let sum: f64 = field.value[field.start[i] as usize..field.start[i + 1] as usize].iter().sum();
            assert_abs_diff_eq!(sum, 1.0, epsilon = LINEAR);
            let off = norm(minus(field.at(i, &cloud.points), *x)) / SIZE;
            assert!(off < LINEAR, "{name}: x is reproduced with {off:.1e} at {x:?}");
        }
    }
}

#[test]
fn gradients_sum_to_zero_and_reproduce_linear_fields() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let rules = [1, 4, 5];
    for (name, basis) in METHODS {
        for rule in rules {
            let settings = settings(basis, rule);
            let table =
                Approximation::new(&cloud.points, &cloud.cells, interpolating.clone(), settings).table().unwrap();
            let volume: f64 = table.volume.iter().sum();
            assert_abs_diff_eq!(volume, cloud.volumes().iter().sum::<f64>(), epsilon = 1e-12 * volume);
            for point in 0..table.volume.len() {
                let range = table.start[point] as usize..table.start[point + 1] as usize;
                for k in 0..3 {
                    let sum: f64 = table.gradient[range.clone()].iter().map(|g| g[k]).sum();
                    assert!((sum * SIZE).abs() < LINEAR, "{name} {rule:?}: sum of gradients {sum:.1e} 1/m");
                    for m in 0..3 {
                        let e = range.clone().map(|e| table.gradient[e][k] * cloud.points[table.nodes[e] as usize][m]);
                        let off = (e.sum::<f64>() - f64::from(k == m)).abs();
                        assert!(off < LINEAR, "{name} {rule:?}: gradient of x_{m} along {k} is off by {off:.1e}");
                    }
                }
            }
        }
    }
}

/// Tables against differences of [`Approximation::field`], at the cells' centres.
#[test]
fn gradients_of_the_table_are_the_derivatives_of_the_values() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    for (name, basis) in METHODS {
        let settings = settings(basis, 1);
        let approximation = Approximation::new(&cloud.points, &cloud.cells, interpolating.clone(), settings);
        let table = approximation.table().unwrap();
        let (mut compared, mut skipped) = (0, 0);
        for point in (0..table.volume.len()).step_by(41) {
            let corners = cloud.cells[table.cell[point] as usize].map(|n| cloud.points[n as usize]);
            let x: [f64; 3] = std::array::from_fn(|k| corners.iter().map(|c| c[k]).sum::<f64>() / 4.0);
            let size = distance(x, corners[0]);
            let h = 1e-4 * size;
            for k in 0..3 {
                let moved = |h: f64| std::array::from_fn(|m| if m == k { x[m] + h } else { x[m] });
                let field = approximation.field(&[moved(-h), moved(h)]).unwrap();
                // a node whose reach ends between the two places makes a step there, of 0.05 % of its weight, and no slope
                let row = |r: usize| &field.nodes[field.start[r] as usize..field.start[r + 1] as usize];
                if row(0) != row(1) {
                    skipped += 1;
                    continue;
                }
                compared += 1;
                let mut slope = vec![0.0; cloud.points.len()];
                for (row, sign) in [(0, -1.0), (1, 1.0)] {
                    for e in field.start[row] as usize..field.start[row + 1] as usize {
                        slope[field.nodes[e] as usize] += sign * field.value[e] / (2.0 * h);
                    }
                }
                for e in table.start[point] as usize..table.start[point + 1] as usize {
                    let off = (slope[table.nodes[e] as usize] - table.gradient[e][k]).abs() * size;
                    // truncation (h / size)^2 = 1e-8, times third derivatives of some tens
                    assert!(off < 1e-5, "{name}: d phi / d x_{k} of point {point} is off by {off:.1e}");
                }
            }
        }
        assert!(compared > 20 * skipped, "{name}: {skipped} of {compared} places are at the end of a node's reach");
    }
}

/// The same where the weight is almost singular.
#[test]
fn derivatives_hold_next_to_interpolating_nodes() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let supports = Supports::new(&cloud.points, radii(&cloud.points, &cloud.cells, 1.8), interpolating.clone());
    let evaluate = |x: [f64; 3], basis: Basis| {
        let (mut neighbours, mut fit) = (Vec::new(), Fit::default());
        supports.at(x, &mut neighbours);
        fit.evaluate(&neighbours, basis, true).unwrap();
        (neighbours.iter().map(|n| n.node).collect::<Vec<_>>(), fit)
    };
    let held: Vec<usize> = (0..cloud.points.len()).filter(|&n| interpolating[n]).collect();
    for basis in [MMLS, MLS].into_iter().flatten() {
        for (i, &n) in held.iter().step_by(5).enumerate() {
            let towards = minus([0.0, 0.0, 0.5 * clouds::HEIGHT], cloud.points[n]);
            let near = supports.radii()[n] * [1e-3, 1e-2, 0.1][i % 3];
            let x: [f64; 3] = std::array::from_fn(|k| cloud.points[n][k] + near * towards[k] / norm(towards));
            let (nodes, fit) = evaluate(x, basis);
            let h = 1e-4 * near;
            for k in 0..3 {
                let moved = |h: f64| std::array::from_fn(|m| if m == k { x[m] + h } else { x[m] });
                let ((a_nodes, a), (b_nodes, b)) = (evaluate(moved(-h), basis), evaluate(moved(h), basis));
                for (j, node) in nodes.iter().enumerate() {
                    let value =
                        |nodes: &[u32], fit: &Fit| nodes.iter().position(|m| m == node).map_or(0.0, |at| fit.value[at]);
                    let slope = (value(&b_nodes, &b) - value(&a_nodes, &a)) / (2.0 * h);
                    let off = (slope - fit.gradient[j][k]).abs() * near;
                    assert!(off < 1e-5, "{basis:?}: d phi / d x_{k} at {near:.1e} m from node {n} is off by {off:.1e}");
                }
            }
        }
    }
}

/// The almost singular weight leaves phi_i(x_j) - delta_ij of the order of its regularisation.
#[test]
fn interpolating_nodes_carry_the_value_of_the_field() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let held: Vec<usize> = (0..cloud.points.len()).filter(|&n| interpolating[n]).collect();
    let at: Vec<[f64; 3]> = held.iter().map(|&n| cloud.points[n]).collect();
    for (name, basis) in METHODS {
        let settings = settings(basis, 1);
        let field =
            Approximation::new(&cloud.points, &cloud.cells, interpolating.clone(), settings).field(&at).unwrap();
        let mut worst: f64 = 0.0;
        for (row, &j) in held.iter().enumerate() {
            for e in field.start[row] as usize..field.start[row + 1] as usize {
                let delta = f64::from(field.nodes[e] as usize == j);
                worst = worst.max((field.value[e] - delta).abs());
            }
        }
        println!("{name}: phi_i(x_j) is off delta_ij by up to {worst:.2e}");
        // 2e-5 was seen: the regularisation 1e-6 over the weights of close neighbours
        assert!(worst < 5e-5, "{name}: phi_i(x_j) is off delta_ij by {worst:.1e}");
    }
}
