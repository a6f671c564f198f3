//! A square-root ensemble Kalman filter, without perturbed observations, one number after the other.
//!
//! Members have constant values and answer every reading already, so the filter needs no runs: mean and spread after a reading are a vector w
//! and a matrix T in the space of the members, the same for forces, places of targets and values of keys.
//!
//! ```text
//! x = mean(x_k) + X w,  cov = X T T' X' / (n - 1)          X: members' x_k less their mean, a row
//! a = T' Y',  s^2 = a' a / (n - 1),  d = y - y_mean - Y w   y: mean of a block of readings, Y: the members' less their mean
//! w += T a d / ((n - 1) v),  T -= T a a' / ((n - 1) v (1 + sqrt(R / v))),  v = s^2 + R     (Whitaker and Hamill, Mon. Weather Rev. 130, 2002)
//! ```
//!
//! The error of a block's mean is what the innovations d of its channel show beyond the members' own spread: R = mean(d^2 - s^2), no less than
//! noise alone would make it, times (1 + r) / (1 - r) for the correlation r of neighbouring innovations, since a model that is wrong is wrong
//! for a while. Means forget with `MEMORY` blocks.
//!
//! A block whose d^2 is above `FAR`^2 v, with the R that was known before it, is rejected: what is learnt from it is the size of errors alone. So
//! a knock, a slip or a boundary that no member has moves no key, and what lasts is taken in once R has grown to it.
//!
//! For the same reason a reading k blocks after the last one is forecast to be off the members' mean as that was, as far as such things
//! have lasted of late: by r^k d. How far off such forecasts were, beyond the members' spread, is the error of the next one.

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector};

use super::assimilate::{Forecast, HORIZON_S};

/// Blocks over which the size of errors is learnt (docs/constants.md).
const MEMORY: f64 = 5.0;
/// Largest correlation of neighbouring innovations that is counted.
const LARGEST_CORRELATION: f64 = 0.98;
/// A block whose mean is farther off than this, in standard deviations, is rejected.
const FAR: f64 = 3.0;
/// Second differences of the latest readings that the noise is taken from.
const SEEN: usize = 1000;
/// Fewest second differences that tell it: nothing is taken in before.
const FEWEST_SEEN: usize = 3;

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

/// Standard deviation of a channel's noise: second differences of neighbours hold little else.
#[derive(Clone, Debug)]
struct Noise {
    least: f64,
    last: [Option<f64>; 2],
    /// Sizes of the latest [`SEEN`] second differences over sqrt(6).
    seconds: VecDeque<f64>,
}

impl Noise {
    /// Sees readings; what is known then, if it is.
    fn see(&mut self, block: &[Reading]) -> Option<f64> {
        for reading in block {
            let new = reading.measured;
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
        let median = sorted.get(sorted.len() / 2).filter(|_| sorted.len() >= FEWEST_SEEN)?;
        Some((median / 0.6745).max(self.least))
    }
}

/// Where the members stand: see the module.
#[derive(Clone, Debug)]
pub(super) struct Filter {
    w: DVector<f64>,
    t: DMatrix<f64>,
}

impl Filter {
    pub fn new(members: usize) -> Self {
        Self { w: DVector::zeros(members), t: DMatrix::identity(members, members) }
    }

    /// Members less their mean, as T' makes them; and the mean with w.
    pub fn spread(&self, of_members: &[f64]) -> (f64, DVector<f64>) {
        let mean = of_members.iter().sum::<f64>() / of_members.len() as f64;
        let off = DVector::from_iterator(of_members.len(), of_members.iter().map(|x| x - mean));
        (mean + off.dot(&self.w), self.t.tr_mul(&off))
    }

    /// Mean and variance of what the members have; `None` where a number is not finite.
    pub fn state(&self, of_members: &[f64]) -> Option<(f64, f64)> {
        let (mean, a) = self.spread(of_members);
        let variance = a.norm_squared() / (of_members.len() - 1) as f64;
        (mean.is_finite() && variance.is_finite()).then_some((mean, variance))
    }

    /// Takes in that a number is off its mean by d with an error of variance R; a and v are the module's.
    fn take(&mut self, a: &DVector<f64>, d: f64, v: f64, error: f64) {
        let n = self.w.len() as f64;
        let turned = &self.t * a;
        self.w.axpy(d / ((n - 1.0) * v), &turned, 1.0);
        self.t.ger(-1.0 / ((n - 1.0) * v * (1.0 + (error / v).sqrt())), &turned, a, 1.0);
    }
}

/// Number of the block at a time after the first reading, s.
fn block_of(since_s: f64) -> f64 {
    (since_s / HORIZON_S * (1.0 + 1e-9)).floor()
}

/// A number that was measured, and what the members say it should be.
#[derive(Clone, Debug)]
pub(super) struct Reading {
    pub measured: f64,
    pub members: Vec<f64>,
}

/// A sensor's number, whose readings come in blocks of [`HORIZON_S`].
#[derive(Clone, Debug)]
pub(super) struct Channel {
    noise: Noise,
    /// What it is known to be, of a reading.
    noise_of_one: f64,
    /// Of blocks: innovations squared less the members' variance, squared, and times the one before.
    excess: Recent,
    squared: Recent,
    products: Recent,
    before: Option<f64>,
    /// Of readings: distances from the members' mean squared, less the members' variance.
    errors: Recent,
    /// The same of distances from what was forecast.
    misses: Recent,
    /// Readings of the block that is not over yet, all with this number.
    block: Vec<Reading>,
    number: f64,
    /// Number of the block before.
    last: f64,
    first_s: Option<f64>,
    /// Blocks that were seen, how many of them were rejected, and whether the last one was.
    pub blocks: usize,
    pub rejected: usize,
    pub rejects: bool,
}

impl Channel {
    /// Of a sensor that has at least this noise.
    pub fn new(least_noise: f64) -> Self {
        Self {
            noise: Noise { least: least_noise, last: [None; 2], seconds: VecDeque::new() },
            noise_of_one: least_noise,
            excess: Recent::default(),
            squared: Recent::default(),
            products: Recent::default(),
            before: None,
            errors: Recent::default(),
            misses: Recent::default(),
            block: Vec::new(),
            number: 0.0,
            last: f64::NEG_INFINITY,
            first_s: None,
            blocks: 0,
            rejected: 0,
            rejects: false,
        }
    }

    /// Takes a reading, no earlier than the one before, and gives what was forecast for it from what had been measured up to one block before;
    /// `None` in the first block and after a gap.
    pub fn take(&mut self, time_s: f64, reading: Reading, filter: &mut Filter) -> Option<Forecast> {
        let first_s = *self.first_s.get_or_insert(time_s);
        let number = block_of(time_s - first_s);
        if number != self.number {
            self.close(filter);
            self.number = number;
        }
        let forecast = self.is_adjacent().then(|| self.forecast(time_s, &reading.members, filter));
        self.block.push(reading);
        forecast
    }

    fn is_adjacent(&self) -> bool {
        self.number - self.last <= 1.0
    }

    /// Ends the block that has been begun.
    pub fn close(&mut self, filter: &mut Filter) {
        if self.block.is_empty() {
            return;
        }
        if let Some(noise) = self.noise.see(&self.block) {
            self.noise_of_one = noise;
            if self.is_adjacent() {
                self.learn(filter);
            }
            self.rejects = !self.update(filter);
            self.blocks += 1;
            self.rejected += usize::from(self.rejects);
        }
        self.last = self.number;
        self.block.clear();
    }

    /// A reading at a time that has not been measured yet, s, if the members have these numbers.
    pub fn forecast(&self, time_s: f64, members: &[f64], filter: &Filter) -> Forecast {
        let (mean, variance) = filter.state(members).unwrap_or((f64::NAN, f64::NAN));
        let error = self.misses.mean().max(self.noise_of_one.powi(2));
        let blocks = self.first_s.map_or(1.0, |first_s| block_of(time_s - first_s) - self.last);
        Forecast { mean_n: mean + self.offset(blocks), standard_deviation_n: (variance + error).sqrt() }
    }

    /// r^k d: what readings k blocks after the last one will be off the members' mean by.
    fn offset(&self, blocks: f64) -> f64 {
        self.correlation().powf(blocks.max(1.0)) * self.before.unwrap_or(0.0)
    }

    /// r: correlation of neighbouring innovations, 0 where none is known.
    fn correlation(&self) -> f64 {
        let r = (self.products.sum / self.squared.sum).clamp(0.0, LARGEST_CORRELATION);
        if r.is_finite() { r } else { 0.0 }
    }

    /// Standard deviation of what readings are off the members' mean by, beyond their spread.
    pub fn error(&self) -> f64 {
        self.errors.mean().max(self.noise_of_one.powi(2)).sqrt()
    }

    /// Learns from the errors of the forecasts of the block.
    fn learn(&mut self, filter: &Filter) {
        let (offset, memory) = (self.offset(1.0), MEMORY * self.block.len() as f64);
        for reading in &self.block {
            if let Some((mean, variance)) = filter.state(&reading.members) {
                let error = reading.measured - mean;
                self.errors.add(error.powi(2) - variance, memory);
                self.misses.add((error - offset).powi(2) - variance, memory);
            }
        }
    }

    /// Error of a block's mean, as a variance.
    fn block_error(&self, count: f64) -> f64 {
        let alone = self.excess.mean().max(self.noise_of_one.powi(2) / count);
        let r = self.correlation();
        alone * (1.0 + r) / (1.0 - r)
    }

    /// Takes in the mean of the block; false if it was rejected.
    fn update(&mut self, filter: &mut Filter) -> bool {
        let (count, members) = (self.block.len() as f64, filter.w.len());
        let of_member = |k: usize| self.block.iter().map(|o| o.members[k]).sum::<f64>() / count;
        let (mean, a) = filter.spread(&(0..members).map(of_member).collect::<Vec<_>>());
        let d = self.block.iter().map(|o| o.measured).sum::<f64>() / count - mean;
        let variance = a.norm_squared() / (members as f64 - 1.0);
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
        filter.take(&a, d, variance + error, error);
        true
    }
}
