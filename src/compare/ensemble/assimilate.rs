//! What a measured force says of the members: a square-root ensemble Kalman filter, without perturbed observations.
//!
//! Members have constant values and answer every reading already, so the filter needs no runs: mean and spread after a reading are a vector w
//! and a matrix T in the space of the members, the same for forces and for values of keys.
//!
//! ```text
//! x = mean(x_k) + X w,  cov = X T T' X' / (n - 1)          X: members' x_k less their mean, a row
//! a = T' Y',  s^2 = a' a / (n - 1),  d = y - y_mean - Y w   y: mean measured force of a block, Y: the members' less their mean
//! w += T a d / ((n - 1) v),  T -= T a a' / ((n - 1) v (1 + sqrt(R / v))),  v = s^2 + R     (Whitaker and Hamill, Mon. Weather Rev. 130, 2002)
//! ```
//!
//! The error of a block's mean is what the innovations d show beyond the members' own spread: R = mean(d^2 - s^2), no less than noise alone
//! would make it, times (1 + r) / (1 - r) for the correlation r of neighbouring innovations, since a model that is wrong is wrong for a while.
//! Means forget with `MEMORY` blocks. The band of what comes next has the spread of the members and of the last forecasts' errors. So a model that
//! is wrong, or a load cell that drifts, makes forecast bands wide; intervals of the keys hold where the model is right.

use nalgebra::{DMatrix, DVector};

/// How far ahead the force is forecast, and the length of a block, s.
pub const HORIZON_S: f64 = 0.05;
/// Blocks over which the size of errors is learnt (docs/constants.md).
const MEMORY: f64 = 5.0;
/// Largest correlation of neighbouring innovations that is counted.
const LARGEST_CORRELATION: f64 = 0.98;
/// Noise that every load cell has, N.
const LEAST_NOISE_N: f64 = 1e-6;
/// Half a band of 95 %, in standard deviations of a normal distribution.
const HALF: f64 = 1.959_963_984_540_054;
/// Fewest members.
const FEWEST: usize = 4;

/// A measured force, and what the members say it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    /// s
    pub time_s: f64,
    /// N
    pub measured_n: f64,
    /// Of each member, N.
    pub members_n: Vec<f64>,
}

/// A force that was forecast from what had been measured up to one block before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Forecast {
    /// N
    pub mean_n: f64,
    /// 2.5 % lie below, N.
    pub low_n: f64,
    /// 97.5 % lie below, N.
    pub high_n: f64,
}

/// What a recording says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Assimilated {
    /// One for each reading; `None` in the first block and after a gap.
    pub forecasts: Vec<Option<Forecast>>,
    /// Mean and standard deviation of each key after the last reading.
    pub keys: Vec<[f64; 2]>,
}

/// A mean that forgets.
#[derive(Clone, Copy, Default)]
struct Recent {
    weight: f64,
    sum: f64,
}

impl Recent {
    fn add(&mut self, value: f64, memory: f64) {
        let kept = 1.0 - 1.0 / memory.max(1.0);
        (self.weight, self.sum) = (kept * self.weight + 1.0, kept * self.sum + value);
    }

    fn mean(&self) -> f64 {
        if self.weight > 0.0 { self.sum / self.weight } else { 0.0 }
    }
}

/// Assimilates readings in the order of time; `values` has the keys' values of each member. `None` of fewer than four members, or
/// without a reading.
#[must_use]
pub fn assimilate(observed: &[Observed], values: &[Vec<f64>]) -> Option<Assimilated> {
    let first = observed.first()?;
    if values.len() < FEWEST {
        return None;
    }
    let block_of = |o: &Observed| ((o.time_s - first.time_s) / HORIZON_S * (1.0 + 1e-9)).floor();
    let mut filter = Filter::new(values.len(), noise_n(observed));
    let (mut forecasts, mut last) = (Vec::with_capacity(observed.len()), f64::NEG_INFINITY);
    for block in observed.chunk_by(|a, b| block_of(a) == block_of(b)) {
        let number = block_of(&block[0]);
        let adjacent = number - last <= 1.0;
        last = number;
        forecasts.extend(block.iter().map(|o| adjacent.then(|| filter.forecast(o))));
        if adjacent {
            filter.learn(block);
        }
        filter.update(block);
    }
    let key = |k: usize| filter.state(&values.iter().map(|of_member| of_member[k]).collect::<Vec<_>>());
    let keys = (0..values[0].len()).map(|k| key(k).map_or([f64::NAN; 2], |(mean, variance)| [mean, variance.sqrt()]));
    Some(Assimilated { forecasts, keys: keys.collect() })
}

/// Standard deviation of the load cell's noise, N: second differences of neighbours hold little else.
fn noise_n(observed: &[Observed]) -> f64 {
    let mut seconds: Vec<f64> = observed
        .windows(3)
        .map(|w| (w[0].measured_n - 2.0 * w[1].measured_n + w[2].measured_n).abs() / 6f64.sqrt())
        .collect();
    seconds.sort_unstable_by(f64::total_cmp);
    // the median of the size of a normal number is 0.6745 of its standard deviation
    seconds.get(seconds.len() / 2).map_or(LEAST_NOISE_N, |median| (median / 0.6745).max(LEAST_NOISE_N))
}

struct Filter {
    noise_n: f64,
    w: DVector<f64>,
    t: DMatrix<f64>,
    /// Of blocks: innovations squared less the members' variance, squared, and times the one before.
    excess: Recent,
    squared: Recent,
    products: Recent,
    before: Option<f64>,
    /// Of readings: forecast errors squared less the members' variance.
    errors: Recent,
}

impl Filter {
    fn new(members: usize, noise_n: f64) -> Self {
        Self {
            noise_n,
            w: DVector::zeros(members),
            t: DMatrix::identity(members, members),
            excess: Recent::default(),
            squared: Recent::default(),
            products: Recent::default(),
            before: None,
            errors: Recent::default(),
        }
    }

    /// Members less their mean, as T' makes them; and the mean with w.
    fn spread(&self, of_members: &[f64]) -> (f64, DVector<f64>) {
        let mean = of_members.iter().sum::<f64>() / of_members.len() as f64;
        let off = DVector::from_iterator(of_members.len(), of_members.iter().map(|x| x - mean));
        (mean + off.dot(&self.w), self.t.tr_mul(&off))
    }

    /// Mean and variance of what the members have; `None` where a number is not finite.
    fn state(&self, of_members: &[f64]) -> Option<(f64, f64)> {
        let (mean, a) = self.spread(of_members);
        let variance = a.norm_squared() / (of_members.len() - 1) as f64;
        (mean.is_finite() && variance.is_finite()).then_some((mean, variance))
    }

    fn forecast(&self, observed: &Observed) -> Forecast {
        let (mean_n, variance) = self.state(&observed.members_n).unwrap_or((f64::NAN, f64::NAN));
        let half = HALF * (variance + self.errors.mean().max(self.noise_n.powi(2))).sqrt();
        Forecast { mean_n, low_n: mean_n - half, high_n: mean_n + half }
    }

    /// Learns from the errors of the forecasts of a block.
    fn learn(&mut self, block: &[Observed]) {
        for observed in block {
            if let Some((mean, variance)) = self.state(&observed.members_n) {
                let error = observed.measured_n - mean;
                self.errors.add(error * error - variance, MEMORY * block.len() as f64);
            }
        }
    }

    /// Takes in the mean of a block.
    fn update(&mut self, block: &[Observed]) {
        let (count, n) = (block.len() as f64, self.w.len() as f64);
        let of_member = |k: usize| block.iter().map(|o| o.members_n[k]).sum::<f64>() / count;
        let (mean, a) = self.spread(&(0..self.w.len()).map(of_member).collect::<Vec<_>>());
        let d = block.iter().map(|o| o.measured_n).sum::<f64>() / count - mean;
        let variance = a.norm_squared() / (n - 1.0);
        self.excess.add(d * d - variance, MEMORY);
        self.squared.add(d * d, MEMORY);
        if let Some(before) = self.before.replace(d) {
            self.products.add(d * before, MEMORY);
        }
        let alone = self.excess.mean().max(self.noise_n.powi(2) / count);
        let r = (self.products.sum / self.squared.sum).clamp(0.0, LARGEST_CORRELATION);
        let error = if r.is_finite() { alone * (1.0 + r) / (1.0 - r) } else { alone };
        let v = variance + error;
        let turned = &self.t * &a;
        self.w.axpy(d / ((n - 1.0) * v), &turned, 1.0);
        self.t.ger(-1.0 / ((n - 1.0) * v * (1.0 + (error / v).sqrt())), &turned, &a, 1.0);
    }
}
