//! Residual of the measured readings against a run with shifted contact and clock: linear least squares for factor,
//! zero and drift, and the derivatives by the shifts.

use nalgebra::{DMatrix, DVector};

use crate::compare::components::take_load_cell_off;
use crate::compare::path::ForcePath;
use crate::compare::rows::Rows;

/// Largest shifts of the grid: share of the recording's time, and the upper limit in s; and steps of the grid on
/// either side.
const MOST_S: (f64, f64) = (0.25, 3.0);
const MOST_M: (f64, f64) = (0.3, 3e-3);
const STEPS: [i32; 2] = [40, 20];
/// Share of the largest depth within which a contact can lie, and the number of additional contact depths of the
/// grid.
const WAY: f64 = 0.9;
const DEEPER: usize = 400;
/// Unknowns in addition to the two shifts: factor, zero and drift, in which the force is linear.
pub(super) const LINEAR: usize = 3;

/// A component across the axis: the run's, its measured values at the rows, and its weight.
#[derive(Clone, Debug)]
pub struct Beside {
    /// Predicted component.
    pub path: ForcePath,
    /// Measured values, N.
    pub measured_n: Vec<f64>,
    /// Noise of the force along the axis divided by its own noise.
    pub weight: f64,
}

/// The readings to be aligned.
pub(super) struct Problem<'a> {
    pub path: &'a ForcePath,
    pub time_s: Vec<f64>,
    measured_n: Vec<f64>,
    /// Components across the axis at the same times.
    pub beside: Vec<(&'a ForcePath, Vec<f64>, f64)>,
    /// How many of factor, zero and drift are free.
    pub free: usize,
}

impl<'a> Problem<'a> {
    pub(crate) fn new(path: &'a ForcePath, rows: &Rows, beside: &'a [Beside], most: usize) -> Self {
        let step = rows.len().div_ceil(most).max(1);
        let every = |v: &[f64]| v.iter().copied().step_by(step).collect();
        let free = LINEAR - rows.known.min(LINEAR - 1);
        let beside = beside.iter().map(|b| (&b.path, every(&b.measured_n), b.weight)).collect();
        Self { path, time_s: every(&rows.time_s), measured_n: every(&rows.measured_n), beside, free }
    }

    /// Readings that the run covers for these shifts.
    fn used(&self, at: [f64; 2]) -> Vec<usize> {
        (0..self.time_s.len()).filter(|&i| self.path.covers(self.time_s[i] - at[1])).collect()
    }

    /// A column of a component across the axis, with zero and drift projected out.
    fn beside_column(&self, used: &[usize], weight: f64, of: impl Fn(usize) -> f64) -> Vec<f64> {
        let times: Vec<f64> = used.iter().map(|&i| self.time_s[i]).collect();
        let mut column: Vec<f64> = used.iter().map(|&i| weight * of(i)).collect();
        take_load_cell_off(&mut column, &times, self.free - 1);
        column
    }

    fn force(&self, i: usize, [c, tau]: [f64; 2]) -> f64 {
        self.path.force_n(self.time_s[i] - tau, c)
    }

    /// Factor, zero and drift for given shifts, and the mean square residual per reading. Readings that the shifted
    /// run does not cover are left out.
    pub(crate) fn linear(&self, at: [f64; 2]) -> Option<([f64; LINEAR], f64)> {
        let (mut n, mut y, mut squares, mut count) = ([[0.0; LINEAR]; LINEAR], [0.0; LINEAR], 0.0, 0.0);
        let start = self.time_s[0];
        for i in (0..self.time_s.len()).filter(|&i| self.path.covers(self.time_s[i] - at[1])) {
            let (columns, m) = ([self.force(i, at), 1.0, self.time_s[i] - start], self.measured_n[i]);
            for a in 0..self.free {
                (0..self.free).for_each(|b| n[a][b] += columns[a] * columns[b]);
                y[a] += columns[a] * m;
            }
            squares += m * m;
            count += 1.0;
        }
        for (path, measured, weight) in &self.beside {
            let used = self.used(at);
            let f = self.beside_column(&used, *weight, |i| path.force_n(self.time_s[i] - at[1], at[0]));
            let m = self.beside_column(&used, *weight, |i| measured[i]);
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            n[0][0] += product(&f, &f);
            y[0] += product(&f, &m);
            squares += product(&m, &m);
            count += used.len() as f64;
        }
        // fixed parameters stay 0
        (self.free..LINEAR).for_each(|a| n[a][a] = 1.0);
        let x = nalgebra::Matrix3::from_fn(|a, b| n[a][b]).cholesky()?.solve(&nalgebra::Vector3::from(y));
        let left = squares - (0..LINEAR).map(|a| x[a] * y[a]).sum::<f64>();
        (x[0] > 0.0 && count > 2.0 * LINEAR as f64).then_some(([x[0], x[1], x[2]], left.max(0.0) / count))
    }

    /// The shifts of the grid with the smallest residual. If the clock offset is given, s, only the contact is
    /// varied.
    pub(crate) fn grid(&self, deepest_m: f64, clock: Option<f64>) -> Option<[f64; 2]> {
        let whole = self.time_s.last()? - self.time_s.first()?;
        let most = [most_m(deepest_m), (MOST_S.0 * whole).min(MOST_S.1)];
        let value = |k: usize, i: i32| most[k] * f64::from(i) / f64::from(STEPS[1 - k]);
        let shifts = (-STEPS[1]..=STEPS[1]).flat_map(|i| {
            let only = |j: &i32| clock.is_none() || *j == 0;
            (-STEPS[0]..=STEPS[0]).filter(only).map(move |j| [value(0, i), clock.unwrap_or(0.0) + value(1, j)])
        });
        // also try deeper contacts, up to the largest depth, without a variation of the clock
        let widest = reach_m(deepest_m)[1];
        let deeper = (STEPS[1]..).map(|i| value(0, i)).take_while(|c| *c < widest).take(DEEPER);
        let shifts = shifts.chain(deeper.map(|c| [c, clock.unwrap_or(0.0)]));
        let left = shifts.filter_map(|at| self.linear(at).map(|(_, left)| (at, left)));
        left.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
    }

    /// Residuals and their derivatives by contact depth, time offset, factor, zero and drift.
    pub(crate) fn jacobian(&self, at: [f64; 2], linear: [f64; LINEAR]) -> (DVector<f64>, DMatrix<f64>) {
        let used = self.used(at);
        let since = |i: usize| self.time_s[i] - self.time_s[0];
        let residual =
            |&i: &usize| linear[0] * self.force(i, at) + linear[1] + linear[2] * since(i) - self.measured_n[i];
        let along = DVector::from_iterator(used.len(), used.iter().map(residual));
        let j_along = DMatrix::from_fn(used.len(), 2 + LINEAR, |row, k| {
            let i = used[row];
            let time = self.time_s[i] - at[1];
            match k {
                0 => -linear[0] * self.path.stiffness(time, at[0]),
                1 => -linear[0] * self.path.rate(time, at[0]),
                2 => self.force(i, at),
                3 => 1.0,
                _ => since(i),
            }
        });
        let rows = used.len() * (1 + self.beside.len());
        let (mut r, mut j) = (along.resize_vertically(rows, 0.0), j_along.resize_vertically(rows, 0.0));
        for (n, (path, measured, weight)) in self.beside.iter().enumerate() {
            let then = |i: usize| self.time_s[i] - at[1];
            let force = |i: usize| path.force_n(then(i), at[0]);
            let mut put = |k: Option<usize>, column: Vec<f64>| {
                let from = used.len() * (1 + n);
                for (row, value) in column.into_iter().enumerate() {
                    match k {
                        Some(k) => j[(from + row, k)] = value,
                        None => r[from + row] = value,
                    }
                }
            };
            put(None, self.beside_column(&used, *weight, |i| linear[0] * force(i) - measured[i]));
            put(Some(0), self.beside_column(&used, *weight, |i| -linear[0] * path.stiffness(then(i), at[0])));
            put(Some(1), self.beside_column(&used, *weight, |i| -linear[0] * path.rate(then(i), at[0])));
            put(Some(2), self.beside_column(&used, *weight, force));
        }
        (r, j)
    }
}

/// Range of the contact's shift, m: up to the largest depth.
pub(in crate::compare) fn reach_m(deepest_m: f64) -> [f64; 2] {
    [-most_m(deepest_m), (WAY * deepest_m).max(most_m(deepest_m))]
}

/// Largest shift of the contact for which the clock offset is varied as well, m.
fn most_m(deepest_m: f64) -> f64 {
    (MOST_M.0 * deepest_m).min(MOST_M.1)
}
