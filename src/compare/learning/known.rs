//! What readings say of the unknowns: the posterior over all candidates of how the model is wrong.
//!
//! ```text
//! P_j = P + G_j,   C_j = P_j^-1,   m_j = C_j (b + b_j)                candidate j of a channel (process.rs)
//! -2 ln p_j = const + e_j + c_j - (b + b_j) . m_j + ln |P_j|
//! m = sum_j p_j m_j,   C = sum_j p_j (C_j + (m_j - m)(m_j - m)')      unknowns: mean m, covariance C
//! ```
//!
//! P is the identity before the first reading, but for the size of the force, and b is 0. Each p_j is how likely all readings are with that candidate,
//! the unknowns integrated out (Rasmussen and Williams, Gaussian Processes, 2006, section 2.7), so the size and the time of errors come from all readings
//! at once: when errors turn out larger than they had seemed, what was learnt before counts for less, too. With one channel this is exact. With more, P
//! and b hold the means of G_j and b_j of the others, and C what their m_j differ by, too.
//! No candidate is larger than the largest force so far: it would be the same for all sizes, an error in proportion to the force, and so a modulus.
//! Candidates lie a factor of four apart in both, from a sensor's least noise up: no error that a blocks' mean can show lies between two of them, so a
//! finer grid gives the same.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::process::{Block, Process};

/// How far apart sizes and times of errors are.
const STEP: f64 = 4.0;
/// Number of sizes, from the least noise on: seven powers of ten.
const SIZES: i32 = 12;
/// Number of times, from one block on.
const TIMES: i32 = 5;
/// A candidate less likely than this says nothing that is seen in double precision.
const LEAST_WEIGHT: f64 = 1e-9;

/// What a candidate makes of the unknowns.
#[derive(Clone, Debug)]
struct View {
    weight: f64,
    m: DVector<f64>,
    c: DMatrix<f64>,
}

/// Candidates of one channel.
#[derive(Clone, Debug)]
struct Errors {
    candidates: Vec<Process>,
    /// The smallest size that is not none.
    least: f64,
    /// Of each candidate; `None` for one that is too unlikely.
    views: Vec<Option<View>>,
    /// Means of G and b.
    g: DMatrix<f64>,
    b: DVector<f64>,
    /// What the means differ by.
    spread: DMatrix<f64>,
    /// Number of the last block.
    last: f64,
    /// Largest force when it was learnt last, N.
    largest: f64,
}

impl Errors {
    fn new(unknowns: usize, least: f64, m: &DVector<f64>, c: &DMatrix<f64>) -> Self {
        let right = Process::new(unknowns, 0.0, 1.0);
        let wrong = (0..SIZES).flat_map(|size| (0..TIMES).map(move |time| (size, time)));
        let wrong = wrong.map(|(size, time)| Process::new(unknowns, least * STEP.powi(size), STEP.powi(time)));
        let candidates: Vec<Process> = std::iter::once(right).chain(wrong).collect();
        let weight = 1.0 / candidates.len() as f64;
        let views = candidates.iter().map(|_| Some(View { weight, m: m.clone(), c: c.clone() })).collect();
        let none = DMatrix::zeros(unknowns, unknowns);
        Self {
            candidates,
            least,
            views,
            g: none.clone(),
            b: DVector::zeros(unknowns),
            spread: none,
            last: 0.0,
            largest: 0.0,
        }
    }

    fn grow(&mut self) {
        let n = self.b.len() + 1;
        self.candidates.iter_mut().for_each(Process::grow);
        for view in self.views.iter_mut().flatten() {
            view.m.resize_vertically_mut(n, 0.0);
            add_one(&mut view.c);
        }
        self.b.resize_vertically_mut(n, 0.0);
        self.g.resize_mut(n, n, 0.0);
        self.spread.resize_mut(n, n, 0.0);
    }

    fn advance(&mut self, number: f64) {
        let k = number - self.last;
        if k > 0.0 {
            self.candidates.iter_mut().for_each(|process| process.advance(k));
        }
        self.last = number;
    }

    fn seen(&self) -> impl Iterator<Item = (&Process, &View)> {
        self.candidates.iter().zip(&self.views).filter_map(|(process, view)| Some((process, view.as_ref()?)))
    }

    /// Whether an error of this size is one of those that are looked for.
    fn possible(&self, process: &Process, largest: f64) -> bool {
        process.size <= largest.max(self.least)
    }

    /// Whether there are more of them at a larger force.
    fn widens(&self, largest: f64) -> bool {
        self.candidates.iter().any(|process| self.possible(process, largest) && !self.possible(process, self.largest))
    }

    /// The module's formulas, with P and b; mean and covariance of the unknowns. `None`, and nothing is learnt, where double precision can't tell.
    fn learn(&mut self, largest: f64, p: &DMatrix<f64>, b: &DVector<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        self.largest = largest;
        let posterior = |process: &Process| self.possible(process, largest).then(|| process.posterior(p, b)).flatten();
        let each: Vec<_> = self.candidates.iter().map(posterior).collect();
        let least = each.iter().flatten().map(|posterior| posterior.misfit).fold(f64::INFINITY, f64::min);
        if least == f64::INFINITY {
            return None;
        }
        let likely = |misfit: f64| (0.5 * (least - misfit)).exp();
        let all: f64 = each.iter().flatten().map(|posterior| likely(posterior.misfit)).sum();
        self.views = each
            .into_iter()
            .map(|posterior| {
                let posterior = posterior?;
                let weight = likely(posterior.misfit) / all;
                (weight > LEAST_WEIGHT).then(|| View { weight, m: posterior.m, c: posterior.p.inverse() })
            })
            .collect();
        let n = b.len();
        let (mut g, mut own, mut m) = (DMatrix::zeros(n, n), DVector::zeros(n), DVector::zeros(n));
        for (process, view) in self.seen() {
            g.zip_apply(&process.g, |mean, g| *mean += view.weight * g);
            own.axpy(view.weight, &process.b, 1.0);
            m.axpy(view.weight, &view.m, 1.0);
        }
        let (mut c, mut spread) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (_, view) in self.seen() {
            let d = &view.m - &m;
            spread.ger(view.weight, &d, &d, 1.0);
            c.zip_apply(&view.c, |mean, c| *mean += view.weight * c);
        }
        c += &spread;
        (self.g, self.b, self.spread) = (g, own, spread);
        Some((m, c))
    }
}

/// One unknown more, of variance 1.
fn add_one(covariance: &mut DMatrix<f64>) {
    let n = covariance.nrows();
    covariance.resize_mut(n + 1, n + 1, 0.0);
    covariance[(n, n)] = 1.0;
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
    /// Nothing, of the size of the force alone.
    pub fn new() -> Self {
        let one = DMatrix::identity(1, 1);
        let none = DVector::zeros(1);
        Self { m: none.clone(), c: one.clone(), root: one, errors: Vec::new(), largest: (0.0, none) }
    }

    /// One unknown more, of which nothing is known.
    pub fn grow(&mut self) {
        let n = self.m.len() + 1;
        [&mut self.m, &mut self.largest.1].into_iter().for_each(|vector| vector.resize_vertically_mut(n, 0.0));
        [&mut self.c, &mut self.root].into_iter().for_each(add_one);
        self.errors.iter_mut().for_each(Errors::grow);
    }

    /// Notes the force that was expected of a block.
    pub fn measure(&mut self, force_n: f64, block: &Block) {
        if force_n.abs() > self.largest.0.abs() {
            self.largest = (force_n, block.row.rows(1, self.m.len()).into_owned());
        }
    }

    /// Standard deviation of the first unknown, the size of the force: its effect is that of the expected force, but what is uncertain is a share of
    /// the force as it has come out.
    fn size(&self) -> f64 {
        let (force_n, row) = &self.largest;
        if *force_n == 0.0 { 1.0 } else { (1.0 + row.dot(&self.m) / force_n).abs().clamp(1e-3, 1e3) }
    }

    /// Adds a channel whose sensor has at least this noise.
    pub fn add(&mut self, least: f64) {
        self.errors.push(Errors::new(self.m.len(), least, &self.m, &self.c));
    }

    /// How far off a block of a number, or a reading in it, is.
    pub fn off(&self, channel: usize, number: f64, block: &Block) -> Off {
        let errors = &self.errors[channel];
        let k = number - errors.last;
        let each: Vec<_> =
            errors.seen().map(|(process, view)| (view.weight, process.off(k, block, &view.m, &view.c))).collect();
        let mean: f64 = each.iter().map(|(weight, (off, _))| weight * off).sum();
        let spread = |(weight, (off, variance)): &(f64, (f64, f64))| weight * (variance + (off - mean).powi(2));
        Off { mean, variance: each.iter().map(spread).sum() }
    }

    /// Mean square of what the model is off by in the block after the last, without noise and what is not known of the unknowns.
    pub fn error(&self, channel: usize, largest: f64) -> f64 {
        self.errors[channel].seen().map(|(process, view)| view.weight * process.error(1.0, largest, &view.m)).sum()
    }

    /// Takes in a block.
    pub fn take(&mut self, channel: usize, number: f64, block: &Block) {
        let errors = &mut self.errors[channel];
        errors.advance(number);
        errors.candidates.iter_mut().for_each(|process| process.take(block));
        self.learn(channel, block.largest);
    }

    /// Takes a block that is more than `far` standard deviations off for the beginning of another error. It counts as one that is just as far off as
    /// that, so that it moves nothing more however far it is.
    pub fn pass(&mut self, channel: usize, number: f64, block: &Block, far: f64) {
        let most = far * self.off(channel, number, block).variance.sqrt();
        let errors = &mut self.errors[channel];
        errors.advance(number);
        for (process, view) in errors.candidates.iter_mut().zip(&errors.views) {
            let (m, c) = view.as_ref().map_or((&self.m, &self.c), |view| (&view.m, &view.c));
            let (off, variance) = process.off(0.0, block, m, c);
            process.pass(block, off.clamp(-most, most), variance);
        }
        self.learn(channel, block.largest);
    }

    /// The same readings, seen with errors as large as the force has become.
    pub fn widen(&mut self, channel: usize, largest: f64) {
        if self.errors[channel].widens(largest) {
            self.learn(channel, largest);
        }
    }

    /// What is known after a block of a channel.
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
        let Some((m, c)) = self.errors[channel].learn(largest, &p, &b) else { return };
        (self.m, self.c) = (m, c + spread);
        let eigen = SymmetricEigen::new(self.c.clone());
        let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
        self.root = &eigen.eigenvectors * roots * eigen.eigenvectors.transpose();
    }
}
