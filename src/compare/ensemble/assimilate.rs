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
//!
//! A block whose d^2 is above `FAR`^2 v, with the R that was known before it, is rejected: what is learnt from it is the size of errors alone. So
//! a knock, a slip or a boundary that no member has moves no key, and what lasts is taken in once R has grown to it.

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector};

use super::Band;

/// How far ahead the force is forecast, and the length of a block, s.
pub const HORIZON_S: f64 = 0.05;
/// Blocks over which the size of errors is learnt (docs/constants.md).
const MEMORY: f64 = 5.0;
/// Largest correlation of neighbouring innovations that is counted.
const LARGEST_CORRELATION: f64 = 0.98;
/// Noise that every load cell has, N.
const LEAST_NOISE_N: f64 = 1e-6;
/// A block whose mean is farther off than this, in standard deviations, is rejected.
const FAR: f64 = 3.0;
/// Second differences of the latest readings that the noise is taken from.
const SEEN: usize = 1000;
/// Fewest members.
const FEWEST: usize = 4;

/// A measured force, and what the members say it should be.
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// Of a reading about it, N.
    pub standard_deviation_n: f64,
}

impl Forecast {
    /// The band that holds 95 % of the readings.
    #[must_use]
    pub fn band(&self) -> Band {
        Band::normal(self.mean_n, self.standard_deviation_n)
    }
}

/// What a recording says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Assimilated {
    /// One for each reading; `None` in the first block and after a gap.
    pub forecasts: Vec<Option<Forecast>>,
    /// Mean and standard deviation of each key after the last reading.
    pub keys: Vec<[f64; 2]>,
    /// Blocks of readings, and how many of them were rejected.
    pub blocks: usize,
    /// See `blocks`.
    pub rejected_blocks: usize,
}

/// A mean that forgets.
#[derive(Clone, Copy, Debug, Default)]
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
    let mut filter = Assimilation::new(values.len()).filter(|_| !observed.is_empty())?;
    let forecasts = observed.iter().map(|one| filter.take(one.clone())).collect();
    filter.close();
    let key = |k: usize| filter.state(&values.iter().map(|of_member| of_member[k]).collect::<Vec<_>>());
    let keys = (0..values[0].len()).map(|k| key(k).map_or([f64::NAN; 2], |(mean, variance)| [mean, variance.sqrt()]));
    let (keys, rejected_blocks) = (keys.collect(), filter.rejected());
    Some(Assimilated { forecasts, keys, blocks: filter.blocks(), rejected_blocks })
}

/// What has been assimilated so far, reading by reading. See the module.
#[derive(Clone, Debug)]
pub struct Assimilation {
    filter: Filter,
    noise: Noise,
    /// Readings of the block that is not over yet, all with this number.
    block: Vec<Observed>,
    number: f64,
    /// Number of the block before.
    last: f64,
    first_s: Option<f64>,
    blocks: usize,
    rejected: usize,
    rejects: bool,
}

impl Assimilation {
    /// Nothing is assimilated yet; `None` of fewer than four members.
    #[must_use]
    pub fn new(members: usize) -> Option<Self> {
        (members >= FEWEST).then(|| Self {
            filter: Filter::new(members),
            noise: Noise::default(),
            block: Vec::new(),
            number: 0.0,
            last: f64::NEG_INFINITY,
            first_s: None,
            blocks: 0,
            rejected: 0,
            rejects: false,
        })
    }

    /// Takes a reading, no earlier than the one before, and gives what was forecast for it from what had been measured up to one block before;
    /// `None` in the first block and after a gap.
    pub fn take(&mut self, observed: Observed) -> Option<Forecast> {
        let first_s = *self.first_s.get_or_insert(observed.time_s);
        let number = ((observed.time_s - first_s) / HORIZON_S * (1.0 + 1e-9)).floor();
        if number != self.number {
            self.close();
            self.number = number;
        }
        let forecast = self.is_adjacent().then(|| self.filter.forecast(&observed));
        self.block.push(observed);
        forecast
    }

    /// The next reading, if the members will have these forces; `None` where one of them is not finite.
    #[must_use]
    pub fn forecast(&self, ahead: &Observed) -> Option<Forecast> {
        Some(self.filter.forecast(ahead)).filter(|f| f.mean_n.is_finite() && f.standard_deviation_n.is_finite())
    }

    fn is_adjacent(&self) -> bool {
        self.number - self.last <= 1.0
    }

    /// Ends the block that has been begun.
    pub fn close(&mut self) {
        if self.block.is_empty() {
            return;
        }
        self.filter.noise_n = self.noise.see(&self.block);
        if self.is_adjacent() {
            self.filter.learn(&self.block);
        }
        self.rejects = !self.filter.update(&self.block);
        self.blocks += 1;
        self.rejected += usize::from(self.rejects);
        self.last = self.number;
        self.block.clear();
    }

    /// Mean and variance of what the members have; `None` where a number is not finite.
    #[must_use]
    pub fn state(&self, of_members: &[f64]) -> Option<(f64, f64)> {
        self.filter.state(of_members)
    }

    /// What the members would have with the values that the measured force says: their mean moved, their spread narrowed.
    #[must_use]
    pub fn analysed(&self, of_members: &[f64]) -> Vec<f64> {
        let (mean, off) = self.filter.spread(of_members);
        off.iter().map(|x| mean + x).collect()
    }

    /// Standard deviation of what a reading is off by beyond the members' spread, N.
    #[must_use]
    pub fn error_n(&self) -> f64 {
        self.filter.error_n()
    }

    /// Blocks that were seen.
    #[must_use]
    pub const fn blocks(&self) -> usize {
        self.blocks
    }

    /// Blocks that were rejected.
    #[must_use]
    pub const fn rejected(&self) -> usize {
        self.rejected
    }

    /// Whether the last block was rejected.
    #[must_use]
    pub const fn rejects(&self) -> bool {
        self.rejects
    }
}

/// Standard deviation of the load cell's noise: second differences of neighbours hold little else.
#[derive(Clone, Debug, Default)]
struct Noise {
    last: [Option<f64>; 2],
    /// Sizes of the latest [`SEEN`] second differences over sqrt(6), N.
    seconds: VecDeque<f64>,
}

impl Noise {
    /// Sees readings; what is known then, N.
    fn see(&mut self, block: &[Observed]) -> f64 {
        for observed in block {
            let new = observed.measured_n;
            if let [Some(one), Some(two)] = self.last {
                self.seconds.push_back((two - 2.0 * one + new).abs() / 6f64.sqrt());
            }
            self.last = [Some(new), self.last[0]];
        }
        let surplus = self.seconds.len().saturating_sub(SEEN);
        self.seconds.drain(..surplus);
        let mut sorted: Vec<f64> = self.seconds.iter().copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        // the median of the size of a normal number is 0.6745 of its standard deviation
        sorted.get(sorted.len() / 2).map_or(LEAST_NOISE_N, |median| (median / 0.6745).max(LEAST_NOISE_N))
    }
}

#[derive(Clone, Debug)]
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
    fn new(members: usize) -> Self {
        Self {
            noise_n: LEAST_NOISE_N,
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

    /// Standard deviation of the forecasts' errors beyond the members' spread, N.
    fn error_n(&self) -> f64 {
        self.errors.mean().max(self.noise_n.powi(2)).sqrt()
    }

    fn forecast(&self, observed: &Observed) -> Forecast {
        let (mean_n, variance) = self.state(&observed.members_n).unwrap_or((f64::NAN, f64::NAN));
        Forecast { mean_n, standard_deviation_n: (variance + self.error_n().powi(2)).sqrt() }
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

    /// Error of a block's mean, as a variance, N^2.
    fn block_error(&self, count: f64) -> f64 {
        let alone = self.excess.mean().max(self.noise_n.powi(2) / count);
        let r = (self.products.sum / self.squared.sum).clamp(0.0, LARGEST_CORRELATION);
        if r.is_finite() { alone * (1.0 + r) / (1.0 - r) } else { alone }
    }

    /// Takes in the mean of a block; false if it was rejected.
    fn update(&mut self, block: &[Observed]) -> bool {
        let (count, n) = (block.len() as f64, self.w.len() as f64);
        let of_member = |k: usize| block.iter().map(|o| o.members_n[k]).sum::<f64>() / count;
        let (mean, a) = self.spread(&(0..self.w.len()).map(of_member).collect::<Vec<_>>());
        let d = block.iter().map(|o| o.measured_n).sum::<f64>() / count - mean;
        let variance = a.norm_squared() / (n - 1.0);
        let known = self.excess.weight > 0.0;
        let far = known && d * d > FAR * FAR * (variance + self.block_error(count));
        self.excess.add(d * d - variance, MEMORY);
        self.squared.add(d * d, MEMORY);
        if let Some(before) = self.before.replace(d) {
            self.products.add(d * before, MEMORY);
        }
        if far {
            return false;
        }
        let error = self.block_error(count);
        let v = variance + error;
        let turned = &self.t * &a;
        self.w.axpy(d / ((n - 1.0) * v), &turned, 1.0);
        self.t.ger(-1.0 / ((n - 1.0) * v * (1.0 + (error / v).sqrt())), &turned, &a, 1.0);
        true
    }
}
