//! Candidates for the model error. Each is a smooth Gaussian process in time, and is filtered as if it were the right
//! one.
//!
//! A block's mean y deviates from the value that the unknowns w explain by g x + noise. x has the Matern covariance
//! of order 3/2 (Rasmussen and Williams, Gaussian Processes, 2006, section 4.2) with standard deviation s and time
//! constant tau. It is the state of a Kalman filter (Hartikainen and Sarkka, MLSP 2010):
//!
//! ```text
//! cov(x(t), x(t')) = s^2 (1 + l) exp(-l),   l = sqrt(3) |t - t'| / tau,   state (x, x'),   P_inf = diag(s^2, 3 s^2 / tau^2)
//! F(k) = exp(-l) [[1 + l, k], [-3 k / tau^2, 1 - l]],   P(t + k) = P_inf + F (P - P_inf) F'
//! a, d: what the filter leaves of the row of w and of the reading,   v = g^2 P_00 + R
//! G += a a' / v,   b += a d / v,   c += d^2 / v,   e += ln v
//! ```
//!
//! The filter is linear, so it is applied to the rows in the same way as to the readings. The posterior of w depends
//! only on G, b, c and e, so readings need not be stored. g = min(1, largest force so far / s): the model error is
//! not larger than the largest predicted force, and is zero before the first contact.
//!
//! All N candidates are computed together (`batched_matrix`).

use std::array::from_fn;

use nalgebra::{DMatrix, DVector};

use super::batched_matrix::{add, at, form, scale, solve, subtract};

/// Variance of a state that is to be discarded, relative to the known one. Six digits remain in double precision.
const FORGOTTEN: f64 = 1e6;

/// The data of a block of readings: see the module.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// The mean minus its expectation, and the effect of each unknown on it.
    pub row: Vec<f64>,
    /// Variance of its noise.
    pub noise: f64,
    /// Largest magnitude that the sensor was expected to show so far; infinite if errors have no bound.
    pub largest: f64,
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Processes<const N: usize> {
    /// s, in the sensor's unit; 0: no model error.
    pub size: [f64; N],
    /// sqrt(3) / tau, times the length of a block.
    rate: [f64; N],
    /// F(1).
    next: [[[f64; N]; 2]; 2],
    /// x and x' of the reading and the row.
    x: [Vec<[f64; N]>; 2],
    /// P: 00, 01, 11.
    p: [[f64; N]; 3],
    pub g: Vec<[f64; N]>,
    pub b: Vec<[f64; N]>,
    pub c: [f64; N],
    pub e: [f64; N],
}

/// Posterior of the unknowns for each candidate.
#[derive(Clone, Debug)]
pub(super) struct Posterior<const N: usize> {
    /// Their mean.
    pub m: Vec<[f64; N]>,
    /// Their covariance.
    pub c: Vec<[f64; N]>,
    /// -2 ln of the marginal likelihood of the readings for this candidate, up to a constant. Not finite if double
    /// precision does not suffice.
    pub misfit: [f64; N],
}

impl<const N: usize> Processes<N> {
    /// From sizes, in the sensor's unit, and times, in blocks.
    pub(crate) fn new(unknowns: usize, size: [f64; N], time: [f64; N]) -> Self {
        let rate = time.map(|time| 3f64.sqrt() / time);
        let none = [0.0; N];
        let x = vec![none; unknowns + 1];
        Self {
            size,
            rate,
            next: transition(&rate, 1.0),
            x: [x.clone(), x],
            p: [from_fn(|j| stationary(size[j], rate[j])[0]), none, from_fn(|j| stationary(size[j], rate[j])[1])],
            g: vec![none; at(unknowns, 0)],
            b: vec![none; unknowns],
            c: none,
            e: none,
        }
    }

    /// Adds an unknown on which there are no data yet.
    pub(crate) fn grow(&mut self) {
        let n = self.b.len() + 1;
        self.x.iter_mut().for_each(|x| x.resize(n + 1, [0.0; N]));
        self.b.resize(n, [0.0; N]);
        self.g.resize(at(n, 0), [0.0; N]);
    }

    /// Predicts k blocks ahead.
    #[inline(always)]
    pub(crate) fn advance(&mut self, k: f64) {
        let f = if k == 1.0 { &self.next } else { &transition(&self.rate, k) };
        for j in 0..N {
            let (rest, [a, b, c]) = self.above_rest(j);
            let product = |i: usize, k: usize| {
                f[i][0][j] * (a * f[k][0][j] + b * f[k][1][j]) + f[i][1][j] * (b * f[k][0][j] + c * f[k][1][j])
            };
            (self.p[0][j], self.p[1][j], self.p[2][j]) =
                (rest[0] + product(0, 0), product(0, 1), rest[1] + product(1, 1));
        }
        let [x, speed] = &mut self.x;
        for (x, speed) in x.iter_mut().zip(speed) {
            for j in 0..N {
                let (a, b) = (x[j], speed[j]);
                x[j] = f[0][0][j] * a + f[0][1][j] * b;
                speed[j] = f[1][0][j] * a + f[1][1][j] * b;
            }
        }
    }

    /// The diagonal of P_inf, and P - P_inf.
    #[inline(always)]
    fn above_rest(&self, j: usize) -> ([f64; 2], [f64; 3]) {
        let rest = stationary(self.size[j], self.rate[j]);
        (rest, [self.p[0][j] - rest[0], self.p[1][j], self.p[2][j] - rest[1]])
    }

    #[inline(always)]
    fn gate(&self, largest: f64) -> [f64; N] {
        self.size.map(|size| if size > largest { largest / size } else { 1.0 })
    }

    /// The filter's residuals d and a of a reading and its row, for an error of f x + f' x'.
    #[inline(always)]
    fn left(&self, row: &[f64], [f, f_speed]: [&[f64; N]; 2]) -> Vec<[f64; N]> {
        let mut all: Vec<[f64; N]> = row.iter().map(|row| [*row; N]).collect();
        for (left, (x, speed)) in all.iter_mut().zip(self.x[0].iter().zip(&self.x[1])) {
            for j in 0..N {
                left[j] -= f[j] * x[j] + f_speed[j] * speed[j];
            }
        }
        all
    }

    /// Mean and variance of the deviation of a block k blocks ahead, if the unknowns have means m and covariances C.
    #[inline(always)]
    pub(crate) fn off(&self, k: f64, block: &Block, m: &[[f64; N]], c: &[[f64; N]]) -> [[f64; N]; 2] {
        let f = if k == 1.0 { &self.next } else { &transition(&self.rate, k) };
        let g = self.gate(block.largest);
        let (mut x, mut speed) = (f[0][0], f[0][1]);
        scale(&mut x, &g);
        scale(&mut speed, &g);
        let left = self.left(&block.row, [&x, &speed]);
        let (mut off, a) = (left[0], &left[1..]);
        a.iter().zip(m).for_each(|(a, m)| subtract(&mut off, a, m));
        let mut variance = form(c, a);
        for j in 0..N {
            let (rest, [a, b, c]) = self.above_rest(j);
            let ahead = x[j] * (x[j] * a + speed[j] * b) + speed[j] * (x[j] * b + speed[j] * c);
            variance[j] += g[j] * g[j] * rest[0] + ahead + block.noise;
        }
        [off, variance]
    }

    /// Mean square of the model error k blocks ahead, if the unknowns have means m.
    pub(crate) fn error(&self, k: f64, largest: f64, m: &[[f64; N]]) -> [f64; N] {
        let none = Block { row: vec![0.0; self.x[0].len()], noise: 0.0, largest };
        let [off, variance] = self.off(k, &none, m, &vec![[0.0; N]; self.g.len()]);
        from_fn(|j| off[j] * off[j] + variance[j])
    }

    /// Updates with a block.
    #[inline(always)]
    pub(crate) fn take(&mut self, block: &Block) {
        let g = self.gate(block.largest);
        let v = innovation(block, &g, &self.p[0]);
        let left = self.left(&block.row, [&g, &[0.0; N]]);
        let share = v.map(|v| 1.0 / v);
        let (d, a) = (left[0], &left[1..]);
        for i in 0..a.len() {
            let mut of_row = a[i];
            scale(&mut of_row, &share);
            for k in 0..=i {
                add(&mut self.g[at(i, k)], &of_row, &a[k]);
            }
            add(&mut self.b[i], &of_row, &d);
        }
        for j in 0..N {
            self.c[j] += d[j] * d[j] * share[j];
            self.e[j] += v[j].ln();
        }
        self.correct(&left, &g, &v);
    }

    /// Treats a block with these deviations and variances as the start of another error: it does not update the
    /// unknowns, but it updates the likelihood of processes with such deviations.
    pub(crate) fn pass(&mut self, block: &Block, distance: &[f64; N], variance: &[f64; N]) {
        let g = self.gate(block.largest);
        for j in 0..N {
            self.e[j] += variance[j].ln() + distance[j] * distance[j] / variance[j];
            if self.size[j] * g[j] > 0.0 {
                self.p[0][j] += FORGOTTEN * (self.p[0][j] + block.noise + block.row[0].powi(2)) / (g[j] * g[j]);
            }
        }
        let v = innovation(block, &g, &self.p[0]);
        let left = self.left(&block.row, [&g, &[0.0; N]]);
        self.correct(&left, &g, &v);
    }

    /// The filter's correction with the residual of a row.
    #[inline(always)]
    fn correct(&mut self, left: &[[f64; N]], g: &[f64; N], v: &[f64; N]) {
        let [p0, p1, p2] = &mut self.p;
        let mut gain = [[0.0; N]; 2];
        for j in 0..N {
            gain[0][j] = p0[j] * g[j] / v[j];
            gain[1][j] = p1[j] * g[j] / v[j];
            p2[j] -= gain[1][j] * g[j] * p1[j];
            p1[j] -= gain[0][j] * g[j] * p1[j];
            p0[j] -= gain[0][j] * g[j] * p0[j];
        }
        for (x, gain) in self.x.iter_mut().zip(&gain) {
            x.iter_mut().zip(left).for_each(|(x, left)| add(x, gain, left));
        }
    }

    /// The unknowns and the likelihood of the readings, given the prior information on the unknowns: precision, and
    /// precision times mean.
    #[inline(always)]
    pub(crate) fn posterior(&self, precision: &DMatrix<f64>, weighed: &DVector<f64>) -> Posterior<N> {
        let n = self.b.len();
        let mut c = self.g.clone();
        for i in 0..n {
            for k in 0..=i {
                c[at(i, k)].iter_mut().for_each(|p| *p += precision[(i, k)]);
            }
        }
        let mut m: Vec<[f64; N]> = self.b.iter().zip(weighed).map(|(b, more)| b.map(|b| b + more)).collect();
        let [explained, ln] = solve(&mut c, &mut m);
        let misfit = from_fn(|j| self.e[j] + (self.c[j] - explained[j]) + ln[j]);
        Posterior { m, c, misfit }
    }
}

/// F for k blocks.
#[inline(always)]
fn transition<const N: usize>(rate: &[f64; N], k: f64) -> [[[f64; N]; 2]; 2] {
    let (mut e, mut f) = ([0.0; N], [[[0.0; N]; 2]; 2]);
    for j in 0..N {
        // candidates with the same time constant are adjacent
        e[j] = if j > 0 && rate[j] == rate[j - 1] { e[j - 1] } else { (-rate[j] * k).exp() };
    }
    for j in 0..N {
        let l = rate[j] * k;
        f[0][0][j] = e[j] * (1.0 + l);
        f[0][1][j] = e[j] * k;
        f[1][0][j] = -e[j] * rate[j] * rate[j] * k;
        f[1][1][j] = e[j] * (1.0 - l);
    }
    f
}

/// The diagonal of P_inf.
#[inline(always)]
fn stationary(size: f64, rate: f64) -> [f64; 2] {
    [size * size, (size * rate).powi(2)]
}

/// v.
#[inline(always)]
fn innovation<const N: usize>(block: &Block, g: &[f64; N], p: &[f64; N]) -> [f64; N] {
    from_fn(|j| g[j] * g[j] * p[j] + block.noise)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Covariance matrix of the readings, for comparison.
    fn covariance(times: &[f64], size: f64, time: f64, noise: f64) -> DMatrix<f64> {
        DMatrix::from_fn(times.len(), times.len(), |i, j| {
            let l = 3f64.sqrt() * (times[i] - times[j]).abs() / time;
            size * size * (1.0 + l) * (-l).exp() + if i == j { noise } else { 0.0 }
        })
    }

    #[test]
    fn the_filter_is_the_regression_with_that_covariance() {
        let times = [0.0_f64, 1.0, 2.0, 5.0, 6.0, 9.0];
        let (size, time, noise) = (0.7, 4.0, 0.04);
        let rows: Vec<[f64; 3]> = times.iter().map(|t| [(0.9 * t).sin() + 0.2 * t, 1.0, 0.3 * t]).collect();
        let mut process = Processes::new(2, [size], [time]);
        let mut last = 0.0;
        for (t, row) in times.iter().zip(&rows) {
            process.advance(t - last);
            process.take(&Block { row: row.to_vec(), noise, largest: f64::INFINITY });
            last = *t;
        }
        let k = covariance(&times, size, time, noise);
        let inverse = k.clone().try_inverse().unwrap();
        let h = DMatrix::from_fn(times.len(), 2, |i, j| rows[i][j + 1]);
        let y = DVector::from_fn(times.len(), |i, _| rows[i][0]);
        let g = DMatrix::from_fn(2, 2, |i, k| process.g[at(i.max(k), i.min(k))][0]);
        let b = DVector::from_fn(2, |i, _| process.b[i][0]);
        assert!((g - h.transpose() * &inverse * &h).norm() < 1e-10);
        assert!((b - h.transpose() * &inverse * &y).norm() < 1e-10);
        assert!((process.c[0] - y.dot(&(&inverse * &y))).abs() < 1e-10);
        assert!((process.e[0] - k.determinant().ln()).abs() < 1e-10);
        // marginal likelihood of the readings, with normal unknowns of variance 1: by hand
        let posterior = process.posterior(&DMatrix::identity(2, 2), &DVector::zeros(2));
        let all = &k + &h * h.transpose();
        let likely = y.dot(&(all.clone().try_inverse().unwrap() * &y)) + all.determinant().ln();
        assert!((posterior.misfit[0] - likely).abs() < 1e-9, "{:?} {likely}", posterior.misfit);
        // forecast 1.5 blocks ahead: the same by hand
        let m = DVector::from_row_slice(&[0.3, -0.1]);
        let next = Block { row: vec![2.0, 1.0, 3.15], noise, largest: f64::INFINITY };
        let [[mean], [variance]] = process.off(1.5, &next, &[[m[0]], [m[1]]], &[[0.0]; 3]);
        let with = covariance(&[&times[..], &[10.5]].concat(), size, time, noise);
        let cross = with.view((times.len(), 0), (1, times.len())).transpose();
        let by_hand = 2.0 - 0.3 + 0.1 * 3.15 - cross.dot(&(&inverse * (&y - &h * &m)));
        let spread = with[(times.len(), times.len())] - cross.dot(&(&inverse * &cross));
        assert!(
            (mean - by_hand).abs() < 1e-10 && (variance - spread).abs() < 1e-10,
            "{mean} {by_hand}, {variance} {spread}"
        );
    }

    #[test]
    fn what_is_far_off_says_nothing_of_the_unknowns() {
        let mut process = Processes::new(1, [0.5], [8.0]);
        let block = |y: f64| Block { row: vec![y, 1.0], noise: 0.01, largest: f64::INFINITY };
        process.take(&block(0.1));
        let (g, b) = (process.g.clone(), process.b.clone());
        process.advance(1.0);
        process.pass(&block(30.0), &[1.0], &[1.0]);
        assert_eq!((&process.g, &process.b), (&g, &b));
        // the next block is expected at the same value
        let [[off], [variance]] = process.off(1.0, &block(30.0), &[[0.0]], &[[0.0]]);
        assert!(off.abs() < 1.5 && variance < 0.2, "{off} {variance}");
        // before the first force there is no error
        let mut early = Processes::new(1, [0.5], [8.0]);
        early.take(&Block { largest: 0.0, ..block(0.1) });
        assert!((early.g[0][0] - 100.0).abs() < 1e-9);
    }
}
