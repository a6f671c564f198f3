//! What readings say of the unknowns: the posterior over all candidates of how the model is wrong.
//!
//! ```text
//! P = I + sum_c sum_j p_cj G_cj,   C = P^-1,   m = C sum_c sum_j p_cj b_cj        unknowns: normal, mean m, covariance C (I before, but for the size)
//! ln p_cj = const - 1/2 (e + c - 2 b.m + m.G m + tr(G C))_cj                      channel c, candidate j (process.rs)
//! ```
//!
//! are the two halves of variational Bayes (Bishop, Pattern Recognition and Machine Learning, 2006, section 10.1), taken in turn. So the size and
//! the time of errors come from all readings at once: when they turn out larger than they had seemed, what was learnt before counts for less, too.
//! Candidates lie a factor of four apart in both, from a sensor's least noise up: no error that a blocks' mean can show lies between two of them, so a
//! finer grid gives the same.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use super::process::{Block, Process};

/// How far apart sizes and times of errors are.
const STEP: f64 = 4.0;
/// Number of sizes, from the least noise on: seven powers of ten.
const SIZES: i32 = 12;
/// Number of times, from a few blocks on.
const TIMES: i32 = 4;
/// The two halves are taken so often for each block; the next block goes on from there.
const TURNS: usize = 3;

/// Candidates of one channel.
#[derive(Clone, Debug)]
struct Errors {
    candidates: Vec<Process>,
    weights: Vec<f64>,
    /// Number of the last block.
    last: f64,
}

impl Errors {
    fn new(unknowns: usize, least: f64) -> Self {
        let right = Process::new(unknowns, 0.0, 1.0);
        let wrong = (0..SIZES).flat_map(|size| (1..=TIMES).map(move |time| (size, time)));
        let wrong = wrong.map(|(size, time)| Process::new(unknowns, least * STEP.powi(size), STEP.powi(time)));
        let candidates: Vec<Process> = std::iter::once(right).chain(wrong).collect();
        let weights = vec![1.0 / candidates.len() as f64; candidates.len()];
        Self { candidates, weights, last: 0.0 }
    }

    fn advance(&mut self, number: f64) {
        let k = number - self.last;
        if k > 0.0 {
            self.candidates.iter_mut().for_each(|process| process.advance(k));
        }
        self.last = number;
    }

    fn mean(&self, of: impl Fn(&Process) -> f64) -> f64 {
        self.candidates.iter().zip(&self.weights).map(|(process, weight)| weight * of(process)).sum()
    }
}

/// How far off a reading is, and how far it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Off {
    pub mean: f64,
    pub variance: f64,
}

impl Off {
    /// Distance in standard deviations, those of a further variance included.
    pub fn deviations(&self, more: f64) -> f64 {
        self.mean.abs() / (self.variance + more).sqrt()
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Known {
    pub m: DVector<f64>,
    pub c: DMatrix<f64>,
    /// The symmetric root of C.
    pub root: DMatrix<f64>,
    errors: Vec<Errors>,
    /// The largest force that was expected, N, and what the unknowns add to it.
    largest: (f64, DVector<f64>),
}

impl Known {
    /// Nothing, of so many unknowns.
    pub fn new(unknowns: usize) -> Self {
        let one = DMatrix::identity(unknowns, unknowns);
        let none = DVector::zeros(unknowns);
        Self { m: none.clone(), c: one.clone(), root: one, errors: Vec::new(), largest: (0.0, none) }
    }

    /// Notes the force that was expected of a block.
    pub fn measure(&mut self, force_n: f64, block: &Block) {
        if force_n.abs() > self.largest.0.abs() {
            self.largest = (force_n, block.row.rows(0, self.m.len()).into_owned());
        }
    }

    /// Standard deviation of the last unknown, the size of the force: its effect is that of the expected force, but what is uncertain is a share of
    /// the force as it has come out.
    fn size(&self) -> f64 {
        let (force_n, row) = &self.largest;
        if *force_n == 0.0 { 1.0 } else { (1.0 + row.dot(&self.m) / force_n).abs().clamp(1e-3, 1e3) }
    }

    /// Adds a channel whose sensor has at least this noise.
    pub fn add(&mut self, least: f64) {
        self.errors.push(Errors::new(self.m.len(), least));
    }

    /// How far off a block of a number, or a reading in it, is.
    pub fn off(&self, channel: usize, number: f64, block: &Block) -> Off {
        let errors = &self.errors[channel];
        let each: Vec<(f64, f64)> =
            errors.candidates.iter().map(|p| p.off(number - errors.last, block, &self.m, &self.c)).collect();
        let mean: f64 = each.iter().zip(&errors.weights).map(|((off, _), weight)| weight * off).sum();
        let spread = |((off, variance), weight): (&(f64, f64), &f64)| weight * (variance + (off - mean).powi(2));
        Off { mean, variance: each.iter().zip(&errors.weights).map(spread).sum() }
    }

    /// Mean square of what the model is off by in the block after the last, without noise and what is not known of the unknowns.
    pub fn error(&self, channel: usize, largest: f64) -> f64 {
        self.errors[channel].mean(|process| process.error(1.0, largest, &self.m))
    }

    /// Takes in a block.
    pub fn take(&mut self, channel: usize, number: f64, block: &Block) {
        let errors = &mut self.errors[channel];
        errors.advance(number);
        errors.candidates.iter_mut().for_each(|process| process.take(block));
        self.learn();
    }

    /// Takes a block that is more than `far` standard deviations off for the beginning of another error. It counts as one that is just as far off as
    /// that, so that it moves nothing more however far it is.
    pub fn pass(&mut self, channel: usize, number: f64, block: &Block, far: f64) {
        let most = far * self.off(channel, number, block).variance.sqrt();
        let errors = &mut self.errors[channel];
        errors.advance(number);
        for process in &mut errors.candidates {
            let (off, variance) = process.off(0.0, block, &self.m, &self.c);
            process.pass(block, off.clamp(-most, most), variance);
        }
        self.learn();
    }

    /// The module's two halves.
    fn learn(&mut self) {
        for _ in 0..TURNS {
            let n = self.m.len();
            let (mut p, mut b) = (DMatrix::identity(n, n), DVector::zeros(n));
            p[(n - 1, n - 1)] = self.size().powi(-2);
            for errors in &self.errors {
                for (process, weight) in
                    errors.candidates.iter().zip(&errors.weights).filter(|(_, w)| **w > f64::EPSILON)
                {
                    p.zip_apply(&process.g, |p, g| *p += weight * g);
                    b.axpy(*weight, &process.b, 1.0);
                }
            }
            let Some(p) = Cholesky::new(p) else { return };
            (self.m, self.c) = (p.solve(&b), p.inverse());
            for errors in &mut self.errors {
                let misfits: Vec<f64> =
                    errors.candidates.iter().map(|process| process.misfit(&self.m, &self.c)).collect();
                let least = misfits.iter().copied().fold(f64::INFINITY, f64::min);
                let all: f64 = misfits.iter().map(|misfit| (0.5 * (least - misfit)).exp()).sum();
                for (weight, misfit) in errors.weights.iter_mut().zip(misfits) {
                    *weight = (0.5 * (least - misfit)).exp() / all;
                }
            }
        }
        let eigen = SymmetricEigen::new(self.c.clone());
        let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
        self.root = &eigen.eigenvectors * roots * eigen.eigenvectors.transpose();
    }
}
