//! Bounded non-linear least squares: the smallest 1/2 |r(x)|^2 with every x_i between its bounds.
//!
//! Levenberg-Marquardt with Marquardt's scaling (J. Soc. Ind. Appl. Math. 11, 1963). Each step is projected onto the
//! bounds. Unknowns that a bound holds are left out of it (Kanzow, Yamashita and Fukushima, J. Comput. Appl. Math.
//! 172, 2004):
//!
//! ```text
//! (D J^T J D + lambda I) y = -D J^T r,   x' = clamp(x + D y),   D = diag(1 / |J_i|)
//! ```
//!
//! A separate implementation is needed because a residual is a complete run of the twin, which may be impossible for
//! some x. Such a step is rejected like one that increases the sum. The well-kept crate `levenberg-marquardt` (0.15)
//! has no bounds, ends the search at an x that can't be evaluated, and needs a second version of nalgebra.

use nalgebra::{DMatrix, DVector};

/// Largest number of iterations.
const MOST_ITERATIONS: usize = 40;
/// A step is small if no unknown moves by more than this share of its scale.
const SMALL_STEP: f64 = 1e-6;
/// The search ends when the sum of squares falls, or is predicted to fall, by less than this share. With n readings
/// this is a shift of sqrt(n) times this share, in standard errors from noise. A run of the twin is smooth to no more
/// than that under a small change of a key.
const SMALL_GAIN: f64 = 1e-5;
/// The search also ends if a step that should reduce the sum by less than this share does not reduce it. The possible
/// gain is then within the differences between runs.
const LEFT: f64 = 3e-4;
/// Damping: start, least and largest value.
const DAMPING: [f64; 3] = [1e-3, 1e-12, 1e10];

/// The function to be minimised.
pub(crate) trait Problem {
    /// An error that ends the search at once.
    type Error;

    /// The residuals at x; `None` if they can't be evaluated.
    ///
    /// # Errors
    /// If the search must end at once.
    fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, Self::Error>;

    /// The derivatives of the residuals r by each unknown (columns) at x; `None` if they can't be evaluated.
    ///
    /// # Errors
    /// If the search must end at once.
    fn jacobian(&mut self, x: &[f64], r: &DVector<f64>) -> Result<Option<DMatrix<f64>>, Self::Error>;
}

/// Start, bounds and scale of an unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Unknown {
    /// Start value.
    pub start: f64,
    /// Least and largest value.
    pub bounds: [f64; 2],
    /// Its scale, relative to which steps are small or large.
    pub scale: f64,
    /// Largest step relative to the present value or `scale`: the range in which one linearisation is trusted.
    pub largest_step: f64,
}

/// Result of the search.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Solution {
    /// The unknowns.
    pub x: Vec<f64>,
    /// Residuals there.
    pub residuals: DVector<f64>,
    /// Their derivatives there.
    pub jacobian: DMatrix<f64>,
    /// Number of iterations.
    pub iterations: usize,
    /// Whether no step reduced the sum noticeably any more; otherwise the iteration limit was reached.
    pub converged: bool,
}

/// Searches from the start values; `None` if residuals or derivatives can't be evaluated there.
///
/// # Errors
/// Those of the problem.
pub(crate) fn solve<P: Problem>(problem: &mut P, unknowns: &[Unknown]) -> Result<Option<Solution>, P::Error> {
    let mut x: Vec<f64> = unknowns.iter().map(|u| u.start.clamp(u.bounds[0], u.bounds[1])).collect();
    let Some(mut r) = problem.residuals(&x)? else { return Ok(None) };
    let Some(mut jacobian) = problem.jacobian(&x, &r)? else { return Ok(None) };
    let [mut damping, least, most] = DAMPING;
    let mut iterations = 0;
    let mut converged = false;
    while !converged && iterations < MOST_ITERATIONS {
        iterations += 1;
        let Some(step) = step(&jacobian, &r, &x, unknowns, damping) else {
            damping *= 10.0;
            converged = damping > most;
            continue;
        };
        let trial = moved(&x, &step, unknowns);
        let change = DVector::from_fn(x.len(), |i, _| trial[i] - x[i]);
        let hoped_for = r.norm_squared() - (&r + &jacobian * change).norm_squared();
        if is_small(&x, &trial, unknowns) || hoped_for <= SMALL_GAIN * r.norm_squared() {
            converged = true;
            continue;
        }
        let better = problem.residuals(&trial)?.filter(|t| t.norm_squared() < r.norm_squared());
        let derivatives = match &better {
            Some(t) => problem.jacobian(&trial, t)?,
            None => None,
        };
        let (Some(t), Some(j)) = (better, derivatives) else {
            damping *= 10.0;
            converged = damping > most || hoped_for <= LEFT * r.norm_squared();
            continue;
        };
        converged = r.norm_squared() - t.norm_squared() <= SMALL_GAIN * r.norm_squared();
        damping = (damping / 10.0).max(least);
        (x, r, jacobian) = (trial, t, j);
    }
    Ok(Some(Solution { x, residuals: r, jacobian, iterations, converged }))
}

/// The damped step of the free unknowns; `None` if the equations can't be solved.
fn step(j: &DMatrix<f64>, r: &DVector<f64>, x: &[f64], unknowns: &[Unknown], damping: f64) -> Option<DVector<f64>> {
    let downhill = -(j.transpose() * r);
    let held = |i: usize| {
        let [low, high] = unknowns[i].bounds;
        (x[i] <= low && downhill[i] < 0.0) || (x[i] >= high && downhill[i] > 0.0)
    };
    let free: Vec<usize> = (0..x.len()).filter(|&i| !held(i)).collect();
    let columns = j.select_columns(&free);
    let scale: Vec<f64> =
        columns.column_iter().map(|c| Some(1.0 / c.norm()).filter(|s| s.is_finite()).unwrap_or(0.0)).collect();
    let n = free.len();
    let product = columns.transpose() * &columns;
    let matrix =
        DMatrix::from_fn(n, n, |a, b| scale[a] * product[(a, b)] * scale[b] + if a == b { damping } else { 0.0 });
    let right = DVector::from_fn(n, |a, _| scale[a] * downhill[free[a]]);
    let y = if n == 0 { right } else { matrix.cholesky()?.solve(&right) };
    let mut step = DVector::zeros(x.len());
    free.iter().enumerate().for_each(|(a, &i)| step[i] = scale[a] * y[a]);
    step.iter().all(|s| s.is_finite()).then_some(step)
}

/// x after a step that is limited to the largest allowed step and to the bounds.
fn moved(x: &[f64], step: &DVector<f64>, unknowns: &[Unknown]) -> Vec<f64> {
    let size = |i: usize| x[i].abs().max(unknowns[i].scale);
    let longest = (0..x.len()).map(|i| step[i].abs() / (unknowns[i].largest_step * size(i))).fold(1.0, f64::max);
    let at = |i: usize| (x[i] + step[i] / longest).clamp(unknowns[i].bounds[0], unknowns[i].bounds[1]);
    (0..x.len()).map(at).collect()
}

fn is_small(x: &[f64], trial: &[f64], unknowns: &[Unknown]) -> bool {
    let small = |((a, b), u): ((&f64, &f64), &Unknown)| (a - b).abs() <= SMALL_STEP * a.abs().max(u.scale);
    x.iter().zip(trial).zip(unknowns).all(small)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// a exp(-b t), with values of b that can't be evaluated.
    struct Decay {
        data: Vec<(f64, f64)>,
        impossible_above: f64,
        /// Number of evaluations at such a b.
        refused: u32,
    }

    impl Problem for Decay {
        type Error = ();

        fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, ()> {
            let possible = x[1] <= self.impossible_above;
            self.refused += u32::from(!possible);
            let r = self.data.iter().map(|(t, y)| x[0] * (-x[1] * t).exp() - y).collect();
            Ok(possible.then(|| DVector::from_vec(r)))
        }

        fn jacobian(&mut self, x: &[f64], _: &DVector<f64>) -> Result<Option<DMatrix<f64>>, ()> {
            Ok(Some(DMatrix::from_fn(self.data.len(), 2, |i, k| {
                let t = self.data[i].0;
                let e = (-x[1] * t).exp();
                if k == 0 { e } else { -x[0] * t * e }
            })))
        }
    }

    fn decay(impossible_above: f64) -> Decay {
        let data = (0..40).map(|i| 0.1 * f64::from(i)).map(|t| (t, 3.0 * (-1.5 * t).exp())).collect();
        Decay { data, impossible_above, refused: 0 }
    }

    fn unknown(start: f64, bounds: [f64; 2]) -> Unknown {
        Unknown { start, bounds, scale: 1.0, largest_step: 10.0 }
    }

    #[test]
    fn what_made_the_data_comes_back() {
        let free = [unknown(1.0, [-1e9, 1e9]), unknown(0.2, [-1e9, 1e9])];
        let found = solve(&mut decay(f64::INFINITY), &free).unwrap().unwrap();
        assert!(found.converged && found.iterations < 20, "{}", found.iterations);
        assert!((found.x[0] - 3.0).abs() < 1e-6 && (found.x[1] - 1.5).abs() < 1e-6, "{:?}", found.x);
    }

    #[test]
    fn a_bound_holds_and_the_others_make_the_best_of_it() {
        let bounded = [unknown(1.0, [0.0, 1e9]), unknown(0.2, [0.1, 1.0])];
        let found = solve(&mut decay(f64::INFINITY), &bounded).unwrap().unwrap();
        assert!(found.converged && found.x[1] == 1.0, "{:?}", found.x);
        // linear in a: the best for b = 1 is sum(y e) / sum(e e)
        let (mut top, mut bottom) = (0.0, 0.0);
        for (t, y) in decay(0.0).data {
            (top, bottom) = (top + y * (-t).exp(), bottom + (-2.0 * t).exp());
        }
        assert!((found.x[0] - top / bottom).abs() < 1e-2, "{:?} {}", found.x, top / bottom);
    }

    #[test]
    fn what_cannot_be_evaluated_is_gone_round() {
        let mut narrow = decay(1.6);
        let found = solve(&mut narrow, &[unknown(0.2, [-1e9, 1e9]), unknown(0.5, [-1e9, 1e9])]).unwrap().unwrap();
        assert!(narrow.refused > 0 && (found.x[1] - 1.5).abs() < 1e-6, "{:?}, refused {}", found.x, narrow.refused);
        assert!(solve(&mut decay(0.0), &[unknown(1.0, [0.0, 1.0]), unknown(0.1, [0.0, 1.0])]).unwrap().is_none());
    }

    #[test]
    fn an_unknown_without_effect_stays_where_it_is() {
        struct Flat;
        impl Problem for Flat {
            type Error = ();
            fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, ()> {
                Ok(Some(DVector::from_vec(vec![x[0] - 2.0, 0.5 * (x[0] - 2.0)])))
            }
            fn jacobian(&mut self, _: &[f64], _: &DVector<f64>) -> Result<Option<DMatrix<f64>>, ()> {
                Ok(Some(DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.5, 0.0])))
            }
        }
        let found = solve(&mut Flat, &[unknown(0.0, [-9.0, 9.0]), unknown(7.0, [0.0, 9.0])]).unwrap().unwrap();
        assert!((found.x[0] - 2.0).abs() < 1e-6 && found.x[1] == 7.0, "{:?}", found.x);
    }
}
