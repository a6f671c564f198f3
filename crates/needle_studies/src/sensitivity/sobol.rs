//! Sobol's indices of a function of independent inputs.
//!
//! ```text
//! S_i  = mean(f(B) (f(A_B^i) - f(A))) / V        first order, Saltelli et al., Comput. Phys. Commun. 181 (2010), table 2 (b)
//! T_i  = mean((f(A) - f(A_B^i))^2) / (2 V)       total, Jansen, Comput. Phys. Commun. 117 (1999)
//! ```
//! A and B are halves of one low-discrepancy point of twice the dimension, A_B^i is A with coordinate i from B, and V
//! is the variance over A and B. The mean over A and B is subtracted from f. This changes no S_i and reduces its
//! scatter.

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;

use needle_estimate::compare::ensemble::points::coordinate;

/// Number of resamplings for the standard errors.
const RESAMPLED: usize = 200;
/// Fewest points for an estimate of the indices.
const FEWEST: usize = 4;

/// An estimate with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    /// Value of the index.
    pub value: f64,
    /// Standard error from resampling the points; an upper bound, since low-discrepancy points are more accurate.
    pub error: f64,
}

/// Results for a design.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Indices {
    /// Mean over A and B.
    pub mean: f64,
    /// Variance over A and B.
    pub variance: f64,
    /// First-order indices, one for each input; 0 if nothing varies.
    pub first: Vec<Estimate>,
    /// Total indices.
    pub total: Vec<Estimate>,
}

/// Rows of A, then those of B, then those of A_B^i for each of the `keys` inputs; each row has its coordinates in (0, 1).
#[must_use]
pub(crate) fn design(keys: usize, points: usize, seed: u64) -> Vec<Vec<f64>> {
    let half = |j: usize, from: usize| -> Vec<f64> { (0..keys).map(|i| coordinate(j, from + i, seed)).collect() };
    let rows = |from: usize| (0..points).map(move |j| half(j, from));
    let mixed = (0..keys).flat_map(|i| {
        (0..points).map(move |j| {
            let mut row = half(j, 0);
            row[i] = half(j, keys)[i];
            row
        })
    });
    rows(0).chain(rows(keys)).chain(mixed).collect()
}

/// Indices from the values at a design. `blocks` has those of A, of B, and of each A_B^i, in equal numbers; `None`
/// for fewer than four.
#[must_use]
pub(crate) fn indices(blocks: &[Vec<f64>]) -> Option<Indices> {
    let points = blocks.first()?.len();
    let keys = blocks.len().checked_sub(2)?;
    if points < FEWEST {
        return None;
    }
    let all: Vec<usize> = (0..points).collect();
    let (mean, variance) = moments(blocks, &all);
    let found: Vec<[f64; 2]> = (0..keys).map(|i| of_input(blocks, i, &all)).collect();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let resampled: Vec<Vec<[f64; 2]>> = (0..RESAMPLED)
        .map(|_| {
            let again: Vec<usize> = (0..points).map(|_| random.random_range(0..points)).collect();
            (0..keys).map(|i| of_input(blocks, i, &again)).collect()
        })
        .collect();
    let estimate = |i: usize, which: usize| {
        let values: Vec<f64> = resampled.iter().map(|one| one[i][which]).collect();
        let mean = values.iter().sum::<f64>() / RESAMPLED as f64;
        let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
        Estimate { value: found[i][which], error: (squares / RESAMPLED as f64).sqrt() }
    };
    let of = |which: usize| (0..keys).map(|i| estimate(i, which)).collect();
    Some(Indices { mean, variance, first: of(0), total: of(1) })
}

/// Mean and variance over A and B.
fn moments(blocks: &[Vec<f64>], rows: &[usize]) -> (f64, f64) {
    let n = 2.0 * rows.len() as f64;
    let values = || rows.iter().flat_map(|&j| [blocks[0][j], blocks[1][j]]);
    let mean = values().sum::<f64>() / n;
    (mean, values().map(|f| (f - mean) * (f - mean)).sum::<f64>() / n)
}

/// First-order and total index of an input from some rows.
fn of_input(blocks: &[Vec<f64>], i: usize, rows: &[usize]) -> [f64; 2] {
    let (mean, variance) = moments(blocks, rows);
    if variance == 0.0 {
        return [0.0; 2];
    }
    let n = rows.len() as f64;
    let (a, b, mixed) = (&blocks[0], &blocks[1], &blocks[2 + i]);
    let first: f64 = rows.iter().map(|&j| (b[j] - mean) * (mixed[j] - a[j])).sum();
    let total: f64 = rows.iter().map(|&j| (a[j] - mixed[j]) * (a[j] - mixed[j])).sum();
    [first / n / variance, 0.5 * total / n / variance]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Values of a function of coordinates in (0, 1) at a design.
    fn blocks(keys: usize, points: usize, f: impl Fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
        let values: Vec<f64> = design(keys, points, 0).iter().map(|row| f(row)).collect();
        values.chunks(points).map(<[f64]>::to_vec).collect()
    }

    /// Ishigami and Homma's function with a = 7, b = 0.1, whose indices are known.
    #[test]
    fn the_indices_of_ishigamis_function_are_met() {
        let f = |u: &[f64]| {
            let x: Vec<f64> = u.iter().map(|u| PI * (2.0 * u - 1.0)).collect();
            x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
        };
        let (a, b) = (7.0_f64, 0.1);
        let variance = a * a / 8.0 + b * PI.powi(4) / 5.0 + b * b * PI.powi(8) / 18.0 + 0.5;
        let one = 0.5 * (1.0 + b * PI.powi(4) / 5.0).powi(2) / variance;
        let both = b * b * PI.powi(8) * 8.0 / 225.0 / variance;
        let (first, total) = ([one, a * a / 8.0 / variance, 0.0], [one + both, a * a / 8.0 / variance, both]);
        let found = indices(&blocks(3, 2048, f)).unwrap();
        assert!((found.variance / variance - 1.0).abs() < 0.01 && (found.mean - 3.5).abs() < 0.02, "{found:?}");
        for i in 0..3 {
            assert!((found.first[i].value - first[i]).abs() < 0.01, "{i}: {found:?}, {first:?}");
            assert!((found.total[i].value - total[i]).abs() < 0.01, "{i}: {found:?}, {total:?}");
            // the errors must be of the estimated size
            assert!((found.first[i].value - first[i]).abs() < 3.0 * found.first[i].error, "{i}: {found:?}");
            assert!(found.total[i].error < 0.03, "{i}: {found:?}");
        }
    }

    #[test]
    fn a_sum_has_no_interactions_and_a_constant_nothing() {
        let found = indices(&blocks(2, 256, |u| 3.0 * u[0] + u[1])).unwrap();
        for (i, share) in [0.9, 0.1].into_iter().enumerate() {
            assert!(
                (found.first[i].value - share).abs() < 0.01 && (found.total[i].value - share).abs() < 0.01,
                "{found:?}"
            );
        }
        let constant = indices(&blocks(2, 16, |_| 5.0)).unwrap();
        assert_eq!((constant.variance, constant.first[0].value, constant.total[1].value), (0.0, 0.0, 0.0));
        assert!(indices(&blocks(2, 3, |u| u[0])).is_none());
    }
}
