//! Posterior of the unknowns, averaged over all candidates of the model error.
//!
//! ```text
//! P_j = P + G_j,   C_j = P_j^-1,   m_j = C_j (b + b_j)                candidate j of a channel (process.rs)
//! -2 ln p_j = const + e_j + c_j - (b + b_j) . m_j + ln |P_j|
//! m = sum_j p_j m_j,   C = sum_j p_j (C_j + (m_j - m)(m_j - m)')      unknowns: mean m, covariance C
//! ```
//!
//! A priori P is the identity, except for the element of the force's size, and b is 0. Each p_j is the marginal
//! likelihood of all readings for that candidate, with the unknowns integrated out (Rasmussen and Williams, Gaussian
//! Processes, 2006, section 2.7). So the size and the time constant of the error are estimated from all readings at
//! once. When errors turn out larger than before, earlier readings lose weight too. With one channel this is exact.
//! With several channels, P and b contain the means of G_j and b_j of the other channels, and C contains the
//! differences between their m_j.
//!
//! No candidate is larger than the largest force so far. An error of that size would be proportional to the force and
//! so be equivalent to a modulus. Candidates are spaced by a factor of four in size and in time, starting from the
//! sensor's least noise. A finer grid gives the same result, because block means can't resolve errors in between.

use std::array::from_fn;
use std::sync::OnceLock;

use mtled::number::{Loop, run};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::batched_matrix::{at, mean};
use super::process::{Block, Posterior, Processes};

/// Ratio of neighbouring sizes and times of the candidates.
const STEP: f64 = 4.0;
/// Number of sizes, from the least noise on: seven powers of ten.
const SIZES: i32 = 12;
/// Number of times, from one block on.
const TIMES: i32 = 5;
/// A candidate with a smaller weight has no effect in double precision.
const LEAST_WEIGHT: f64 = 1e-9;

/// Candidates of one channel.
#[derive(Clone, Debug)]
struct Errors<const N: usize> {
    candidates: Processes<N>,
    /// The smallest non-zero size.
    least: f64,
    /// p_j; 0 for a candidate that is too unlikely. Its m_j and C_j are not used.
    weight: [f64; N],
    m: Vec<[f64; N]>,
    c: Vec<[f64; N]>,
    /// Means of G and b.
    g: DMatrix<f64>,
    b: DVector<f64>,
    /// Covariance of the m_j.
    spread: DMatrix<f64>,
    /// Number of the last block.
    last: f64,
    /// Largest force at the last update, N.
    largest: f64,
}

/// All sizes and times, and the candidate without error.
type All = Errors<{ 1 + (SIZES * TIMES) as usize }>;

impl<const N: usize> Errors<N> {
    fn new(unknowns: usize, least: f64, m: &DVector<f64>, c: &DMatrix<f64>) -> Self {
        let grid = |j: usize| j.checked_sub(1).map(|j| (j as i32 % SIZES, j as i32 / SIZES));
        let size = from_fn(|j| grid(j).map_or(0.0, |(size, _)| least * STEP.powi(size)));
        let time = from_fn(|j| grid(j).map_or(1.0, |(_, time)| STEP.powi(time)));
        let none = DMatrix::zeros(unknowns, unknowns);
        Self {
            candidates: Processes::new(unknowns, size, time),
            least,
            weight: [1.0 / N as f64; N],
            m: m.iter().map(|m| [*m; N]).collect(),
            c: triangle(c).map(|c| [c; N]).collect(),
            g: none.clone(),
            b: DVector::zeros(unknowns),
            spread: none,
            last: 0.0,
            largest: 0.0,
        }
    }

    fn grow(&mut self) {
        let n = self.b.len() + 1;
        self.candidates.grow();
        self.m.resize(n, [0.0; N]);
        self.c.resize(at(n, 0) - 1, [0.0; N]);
        self.c.push([1.0; N]);
        self.b.resize_vertically_mut(n, 0.0);
        self.g.resize_mut(n, n, 0.0);
        self.spread.resize_mut(n, n, 0.0);
    }

    #[inline(always)]
    fn advance(&mut self, number: f64) {
        let k = number - self.last;
        if k > 0.0 {
            self.candidates.advance(k);
        }
        self.last = number;
    }

    /// The largest error that is considered at a force.
    fn bound(&self, largest: f64) -> f64 {
        largest.max(self.least)
    }

    /// Whether a larger force admits further candidates.
    fn widens(&self, largest: f64) -> bool {
        let (before, now) = (self.bound(self.largest), self.bound(largest));
        self.candidates.size.iter().any(|size| before < *size && *size <= now)
    }

    /// Evaluates the module's formulas with P and b. Returns mean and covariance of the unknowns; `None`, without an
    /// update, if double precision does not suffice.
    #[inline(always)]
    fn learn(&mut self, largest: f64, p: &DMatrix<f64>, b: &DVector<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        self.largest = largest;
        let bound = self.bound(largest);
        let Posterior { m: each_m, c: each_c, mut misfit } = self.candidates.posterior(p, b);
        for (misfit, size) in misfit.iter_mut().zip(&self.candidates.size) {
            *misfit = if *size <= bound && misfit.is_finite() { *misfit } else { f64::INFINITY };
        }
        let least = misfit.into_iter().fold(f64::INFINITY, f64::min);
        if least == f64::INFINITY {
            return None;
        }
        let likely = misfit.map(|misfit| (0.5 * (least - misfit)).exp());
        let all: f64 = likely.iter().sum();
        self.weight = likely.map(|likely| if likely / all > LEAST_WEIGHT { likely / all } else { 0.0 });
        (self.m, self.c) = (each_m, each_c);
        let (n, candidates) = (b.len(), &self.candidates);
        let mean = |each: &[f64; N]| mean(&self.weight, each);
        let m = DVector::from_fn(n, |i, _| mean(&self.m[i]));
        let off = |i: usize, j: usize| self.m[i][j] - m[i];
        let spread = symmetric(n, |i, k| mean(&from_fn(|j| off(i, j) * off(k, j))));
        let c = symmetric(n, |i, k| mean(&self.c[at(i, k)]));
        self.g = symmetric(n, |i, k| mean(&candidates.g[at(i, k)]));
        self.b = DVector::from_fn(n, |i, _| mean(&candidates.b[i]));
        self.spread = spread;
        Some((m, c + &self.spread))
    }
}

/// [`Errors::learn`] and its result.
struct Learn<'a>(&'a mut All, f64, &'a DMatrix<f64>, &'a DVector<f64>, &'a mut Option<(DVector<f64>, DMatrix<f64>)>);

impl Loop for Learn<'_> {
    #[inline(always)]
    fn go(self) {
        let Self(errors, largest, p, b, known) = self;
        *known = errors.learn(largest, p, b);
    }
}

/// Computes the deviation of a block with this number.
struct Judge<'a>(&'a All, f64, &'a Block, &'a mut Off);

impl Loop for Judge<'_> {
    #[inline(always)]
    fn go(self) {
        let Self(errors, number, block, Off { mean: middle, variance }) = self;
        let [off, mut each] = errors.candidates.off(number - errors.last, block, &errors.m, &errors.c);
        *middle = mean(&errors.weight, &off);
        for (each, off) in each.iter_mut().zip(&off) {
            *each += (*off - *middle).powi(2);
        }
        *variance = mean(&errors.weight, &each);
    }
}

/// Elements of the lower triangle.
fn triangle(c: &DMatrix<f64>) -> impl Iterator<Item = f64> {
    (0..c.nrows()).flat_map(move |i| (0..=i).map(move |k| c[(i, k)]))
}

/// The matrix of a lower triangle.
#[inline(always)]
fn symmetric(n: usize, of: impl Fn(usize, usize) -> f64) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(n, n);
    for i in 0..n {
        for k in 0..=i {
            all[(i, k)] = of(i, k);
            all[(k, i)] = all[(i, k)];
        }
    }
    all
}

/// Adds an unknown with variance 1.
fn add_one(covariance: &mut DMatrix<f64>) {
    let n = covariance.nrows();
    covariance.resize_mut(n + 1, n + 1, 0.0);
    covariance[(n, n)] = 1.0;
}

/// Deviation of a reading from its expectation: mean and variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Off {
    pub mean: f64,
    pub variance: f64,
}

impl Off {
    /// Deviation in standard deviations, with a further variance added.
    pub(crate) fn deviations(&self, more: f64) -> f64 {
        self.mean.abs() / (self.variance + more).sqrt()
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Known {
    pub m: DVector<f64>,
    pub c: DMatrix<f64>,
    /// The symmetric square root of C, computed at the first use.
    root: OnceLock<DMatrix<f64>>,
    errors: Vec<All>,
    /// The largest expected force, N, and the effects of the unknowns on it.
    largest: (f64, DVector<f64>),
}

impl Known {
    /// The prior, with the size of the force as the only unknown.
    pub(crate) fn new() -> Self {
        let (none, one) = (DVector::zeros(1), DMatrix::identity(1, 1));
        Self { m: none.clone(), c: one, root: OnceLock::new(), errors: Vec::new(), largest: (0.0, none) }
    }

    /// Adds an unknown with its prior.
    pub(crate) fn grow(&mut self) {
        let n = self.m.len() + 1;
        [&mut self.m, &mut self.largest.1].into_iter().for_each(|vector| vector.resize_vertically_mut(n, 0.0));
        add_one(&mut self.c);
        self.root.take();
        self.errors.iter_mut().for_each(All::grow);
    }

    /// The symmetric square root of C.
    pub(crate) fn root(&self) -> &DMatrix<f64> {
        self.root.get_or_init(|| {
            let eigen = SymmetricEigen::new(self.c.clone());
            let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
            &eigen.eigenvectors * roots * eigen.eigenvectors.transpose()
        })
    }

    /// Notes the expected force of a block, for the largest one.
    pub(crate) fn measure(&mut self, force_n: f64, block: &Block) {
        if force_n.abs() > self.largest.0.abs() {
            self.largest = (force_n, DVector::from_column_slice(&block.row[1..]));
        }
    }

    /// Prior standard deviation of the first unknown, the size of the force. Its effect is the expected force, but
    /// the uncertainty is relative to the updated force. So this is the ratio of the updated to the expected force at
    /// the largest force.
    fn size(&self) -> f64 {
        let (force_n, row) = &self.largest;
        if *force_n == 0.0 { 1.0 } else { (1.0 + row.dot(&self.m) / force_n).abs().clamp(1e-3, 1e3) }
    }

    /// Adds a channel whose sensor has at least this noise.
    pub(crate) fn add(&mut self, least: f64) {
        self.errors.push(All::new(self.m.len(), least, &self.m, &self.c));
    }

    /// Deviation of a block, or of a reading in it.
    pub(crate) fn off(&self, channel: usize, number: f64, block: &Block) -> Off {
        let mut off = Off { mean: 0.0, variance: 0.0 };
        run(Judge(&self.errors[channel], number, block, &mut off));
        off
    }

    /// Mean square of the model error in the block after the last, without the noise and the uncertainty of the
    /// unknowns.
    pub(crate) fn error(&self, channel: usize, largest: f64) -> f64 {
        let errors = &self.errors[channel];
        mean(&errors.weight, &errors.candidates.error(1.0, largest, &errors.m))
    }

    /// Updates with a block.
    pub(crate) fn take(&mut self, channel: usize, number: f64, block: &Block) {
        let errors = &mut self.errors[channel];
        errors.advance(number);
        errors.candidates.take(block);
        self.learn(channel, block.largest);
    }

    /// Treats a block that is more than `far` standard deviations off as the start of another model error. Its
    /// deviation is clipped to `far`, so that outliers have a bounded effect.
    pub(crate) fn pass(&mut self, channel: usize, number: f64, block: &Block, far: f64) {
        let most = far * self.off(channel, number, block).variance.sqrt();
        let errors = &mut self.errors[channel];
        errors.advance(number);
        // candidates that are too unlikely use the mean posterior
        let all = self.m.iter().copied().chain(triangle(&self.c));
        for (each, all) in errors.m.iter_mut().chain(&mut errors.c).zip(all) {
            each.iter_mut().zip(&errors.weight).for_each(|(x, weight)| *x = if *weight > 0.0 { *x } else { all });
        }
        let [off, variance] = errors.candidates.off(0.0, block, &errors.m, &errors.c);
        errors.candidates.pass(block, &off.map(|off| off.clamp(-most, most)), &variance);
        self.learn(channel, block.largest);
    }

    /// Repeats the update with the candidates that a larger force admits.
    pub(crate) fn widen(&mut self, channel: usize, largest: f64) {
        if self.errors[channel].widens(largest) {
            self.learn(channel, largest);
        }
    }

    /// Updates the posterior after a block of a channel.
    fn learn(&mut self, channel: usize, largest: f64) {
        let n = self.m.len();
        let (mut p, mut b) = (DMatrix::identity(n, n), DVector::zeros(n));
        p[(0, 0)] = self.size().powi(-2);
        let mut spread = DMatrix::zeros(n, n);
        for (_, other) in self.errors.iter().enumerate().filter(|(k, _)| *k != channel) {
            p += &other.g;
            b += &other.b;
            spread += &other.spread;
        }
        let mut known = None;
        run(Learn(&mut self.errors[channel], largest, &p, &b, &mut known));
        let Some((m, c)) = known else { return };
        (self.m, self.c) = (m, c + spread);
        self.root.take();
    }
}
