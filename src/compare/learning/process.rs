//! One candidate for how a model is wrong: a smooth random function of time, and what the readings say if it is the right one.
//!
//! A block's mean y is off what the unknowns w explain by g x + noise. x has Matern's covariance of order 3/2 (Rasmussen and Williams, Gaussian
//! Processes, 2006, section 4.2) with a standard deviation s and a time tau, and is the state of a Kalman filter (Hartikainen and Sarkka, MLSP 2010):
//!
//! ```text
//! cov(x(t), x(t')) = s^2 (1 + l) exp(-l),   l = sqrt(3) |t - t'| / tau,   state (x, x'),   P_inf = diag(s^2, 3 s^2 / tau^2)
//! F(k) = exp(-l) [[1 + l, k], [-3 k / tau^2, 1 - l]],   P(t + k) = P_inf + F (P - P_inf) F'
//! a, d: what the filter leaves of the row of w and of the reading,   v = g^2 P_00 + R
//! G += a a' / v,   b += a d / v,   c += d^2 / v,   e += ln v
//! ```
//!
//! The filter is linear, so it runs on the rows as on the readings. G, b, c and e are all that the posterior of w needs, so no reading is kept.
//! g = min(1, largest force so far / s): a model is not off by more than it has said, and before the first contact by nothing.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Variance over what is known, for a state that is to be forgotten: six digits are left to double precision.
const FORGOTTEN: f64 = 1e6;

/// What a block of readings says: see the module.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// The mean, off what is expected, and the effect of each unknown on it.
    pub row: DVector<f64>,
    /// Variance of its noise.
    pub noise: f64,
    /// Largest size that the sensor was expected to show so far; infinite where errors have no bound.
    pub largest: f64,
}

impl Block {
    /// The row, the reading, of one that has been seen by a filter.
    fn parts(row: &DVector<f64>) -> (nalgebra::DVectorView<'_, f64>, f64) {
        (row.rows(1, row.len() - 1), row[0])
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Process {
    /// s, in the sensor's unit; 0: the model is right.
    pub size: f64,
    /// sqrt(3) / tau, over a block.
    rate: f64,
    /// x and x' of the row.
    x: [DVector<f64>; 2],
    /// P: 00, 01, 11.
    p: [f64; 3],
    pub g: DMatrix<f64>,
    pub b: DVector<f64>,
    pub c: f64,
    pub e: f64,
}

/// What a candidate makes of the unknowns.
pub(super) struct Posterior {
    /// Their mean.
    pub m: DVector<f64>,
    /// Their precision.
    pub p: Cholesky<f64, Dyn>,
    /// -2 ln of how likely the readings are with this candidate, whatever the unknowns; but for a constant.
    pub misfit: f64,
}

/// State of a process some blocks on.
struct Ahead {
    x: DVector<f64>,
    p: f64,
}

impl Process {
    /// Of a size, in the sensor's unit, and a time, in blocks.
    pub fn new(unknowns: usize, size: f64, time: f64) -> Self {
        let rate = 3f64.sqrt() / time;
        let zero = DVector::zeros(unknowns + 1);
        Self {
            size,
            rate,
            x: [zero.clone(), zero],
            p: [size * size, 0.0, (size * rate).powi(2)],
            g: DMatrix::zeros(unknowns, unknowns),
            b: DVector::zeros(unknowns),
            c: 0.0,
            e: 0.0,
        }
    }

    /// One unknown more, of which nothing has been said.
    pub fn grow(&mut self) {
        let n = self.b.len() + 1;
        self.x.iter_mut().for_each(|x| x.resize_vertically_mut(n + 1, 0.0));
        self.b.resize_vertically_mut(n, 0.0);
        self.g.resize_mut(n, n, 0.0);
    }

    /// F, k blocks on.
    fn transition(&self, k: f64) -> [[f64; 2]; 2] {
        let l = self.rate * k;
        let e = (-l).exp();
        [[e * (1.0 + l), e * k], [-e * self.rate * self.rate * k, e * (1.0 - l)]]
    }

    /// P - P_inf, k blocks on, and P_inf.
    fn covariance(&self, f: &[[f64; 2]; 2]) -> [f64; 3] {
        let rest = [self.size * self.size, 0.0, (self.size * self.rate).powi(2)];
        let [a, b, c] = [self.p[0] - rest[0], self.p[1], self.p[2] - rest[2]];
        let product = |i: usize, j: usize| {
            f[i][0] * (a * f[j][0] + b * f[j][1])
                + f[i][1] * (b * f[j][0] + c * f[j][1])
                + if i == j { rest[2 * i] } else { 0.0 }
        };
        [product(0, 0), product(0, 1), product(1, 1)]
    }

    /// Goes k blocks on.
    pub fn advance(&mut self, k: f64) {
        let f = self.transition(k);
        self.p = self.covariance(&f);
        let [x, speed] = &self.x;
        self.x = [f[0][0] * x + f[0][1] * speed, f[1][0] * x + f[1][1] * speed];
    }

    fn ahead(&self, k: f64) -> Ahead {
        let f = self.transition(k);
        Ahead { x: f[0][0] * &self.x[0] + f[0][1] * &self.x[1], p: self.covariance(&f)[0] }
    }

    fn gate(&self, largest: f64) -> f64 {
        if self.size > largest { largest / self.size } else { 1.0 }
    }

    /// Mean and variance of how far a block that comes k blocks on is off, if the unknowns have mean m and covariance C.
    pub fn off(&self, k: f64, block: &Block, m: &DVector<f64>, c: &DMatrix<f64>) -> (f64, f64) {
        let (ahead, g) = (self.ahead(k), self.gate(block.largest));
        let left = &block.row - g * ahead.x;
        let (a, d) = Block::parts(&left);
        (d - a.dot(m), g * g * ahead.p + block.noise + a.dot(&(c * a)))
    }

    /// Mean square of what the model itself is off by k blocks on, if the unknowns have mean m.
    pub fn error(&self, k: f64, largest: f64, m: &DVector<f64>) -> f64 {
        let (ahead, g) = (self.ahead(k), self.gate(largest));
        let (x, y) = Block::parts(&ahead.x);
        g * g * ((y - x.dot(m)).powi(2) + ahead.p)
    }

    /// Takes in a block.
    pub fn take(&mut self, block: &Block) {
        let g = self.gate(block.largest);
        let v = g * g * self.p[0] + block.noise;
        let left = &block.row - g * &self.x[0];
        let (a, d) = Block::parts(&left);
        self.g.ger(1.0 / v, &a, &a, 1.0);
        self.b.axpy(d / v, &a, 1.0);
        self.c += d * d / v;
        self.e += v.ln();
        self.correct(&left, g, v);
    }

    /// Takes a block that was far off, by a distance with a variance, for the beginning of another error: it says nothing of the unknowns, and of
    /// the process that such distances come.
    pub fn pass(&mut self, block: &Block, distance: f64, variance: f64) {
        self.e += variance.ln() + distance * distance / variance;
        let g = self.gate(block.largest);
        if self.size * g > 0.0 {
            self.p[0] += FORGOTTEN * (self.p[0] + block.noise + block.row[0].powi(2)) / (g * g);
            let v = g * g * self.p[0] + block.noise;
            let left = &block.row - g * &self.x[0];
            self.correct(&left, g, v);
        }
    }

    /// The filter's correction by what is left of a row.
    fn correct(&mut self, left: &DVector<f64>, g: f64, v: f64) {
        let gain = [self.p[0] * g / v, self.p[1] * g / v];
        for (x, gain) in self.x.iter_mut().zip(gain) {
            x.axpy(gain, left, 1.0);
        }
        let [p0, p1, p2] = self.p;
        self.p = [p0 - gain[0] * g * p0, p1 - gain[0] * g * p1, p2 - gain[1] * g * p1];
    }

    /// The unknowns, and how likely the readings are, from what else is known of the unknowns: their precision, and precision times mean. `None`
    /// where double precision can't tell.
    pub fn posterior(&self, precision: &DMatrix<f64>, weighed: &DVector<f64>) -> Option<Posterior> {
        let p = Cholesky::new(precision + &self.g)?;
        let b = weighed + &self.b;
        let m = p.solve(&b);
        let misfit = self.e + self.c - b.dot(&m) + p.ln_determinant();
        misfit.is_finite().then_some(Posterior { m, p, misfit })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Covariance of the readings, written down.
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
        let mut process = Process::new(2, size, time);
        let mut last = 0.0;
        for (t, row) in times.iter().zip(&rows) {
            process.advance(t - last);
            process.take(&Block { row: DVector::from_row_slice(row), noise, largest: f64::INFINITY });
            last = *t;
        }
        let k = covariance(&times, size, time, noise);
        let inverse = k.clone().try_inverse().unwrap();
        let h = DMatrix::from_fn(times.len(), 2, |i, j| rows[i][j + 1]);
        let y = DVector::from_fn(times.len(), |i, _| rows[i][0]);
        assert!((&process.g - h.transpose() * &inverse * &h).norm() < 1e-10);
        assert!((&process.b - h.transpose() * &inverse * &y).norm() < 1e-10);
        assert!((process.c - y.dot(&(&inverse * &y))).abs() < 1e-10);
        assert!((process.e - k.determinant().ln()).abs() < 1e-10);
        // how likely the readings are, the unknowns being normal with variance 1: by hand
        let posterior = process.posterior(&DMatrix::identity(2, 2), &DVector::zeros(2)).unwrap();
        let all = &k + &h * h.transpose();
        let likely = y.dot(&(all.clone().try_inverse().unwrap() * &y)) + all.determinant().ln();
        assert!((posterior.misfit - likely).abs() < 1e-9, "{} {likely}", posterior.misfit);
        // what comes 1.5 blocks on: the same by hand
        let m = DVector::from_row_slice(&[0.3, -0.1]);
        let next = Block { row: DVector::from_row_slice(&[2.0, 1.0, 3.15]), noise, largest: f64::INFINITY };
        let (mean, variance) = process.off(1.5, &next, &m, &DMatrix::zeros(2, 2));
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
        let mut process = Process::new(1, 0.5, 8.0);
        let block = |y: f64| Block { row: DVector::from_row_slice(&[y, 1.0]), noise: 0.01, largest: f64::INFINITY };
        process.take(&block(0.1));
        let (g, b) = (process.g.clone(), process.b.clone());
        process.advance(1.0);
        process.pass(&block(30.0), 1.0, 1.0);
        assert_eq!((&process.g, &process.b), (&g, &b));
        // and the next one is expected where it was
        let m = DVector::zeros(1);
        let (off, variance) = process.off(1.0, &block(30.0), &m, &DMatrix::zeros(1, 1));
        assert!(off.abs() < 1.5 && variance < 0.2, "{off} {variance}");
        // before the first force there is no error
        let mut early = Process::new(1, 0.5, 8.0);
        early.take(&Block { largest: 0.0, ..block(0.1) });
        assert!((early.g[(0, 0)] - 100.0).abs() < 1e-9);
    }
}
