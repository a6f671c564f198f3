//! Noise of a sensor's readings, and of the mean of a block of them: what second differences show, which hold little else.
//!
//! ```text
//! sigma^2 = median(|r_i - 2 r_(i-l) + r_(i-2l)|)^2 / (6 * 0.6745^2),   r: reading less what the model says
//! ```
//!
//! l is half a block, so that neighbours that are not independent (a filter, an interpolation) don't hide it. The same of blocks' means says what is left of the
//! noise in these.

use std::collections::VecDeque;

/// Second differences of the latest readings, or blocks, that the noise is taken from.
const SEEN: usize = 1000;
/// Fewest second differences that tell it: nothing is taken in before.
const FEWEST_SEEN: usize = 3;
/// Fewest second differences of blocks' means: a median of fewer is off by half.
const FEWEST_BLOCKS: usize = 8;

/// Sizes of the latest second differences over sqrt(6).
#[derive(Clone, Debug, Default)]
struct Differences(VecDeque<f64>);

impl Differences {
    fn see(&mut self, [one, two, three]: [f64; 3]) {
        self.0.push_back((one - 2.0 * two + three).abs() / 6f64.sqrt());
        if self.0.len() > SEEN {
            self.0.pop_front();
        }
    }

    /// Standard deviation, from at least so many.
    fn deviation(&self, fewest: usize) -> Option<f64> {
        if self.0.len() < fewest.max(1) {
            return None;
        }
        let mut sizes: Vec<f64> = self.0.iter().copied().collect();
        let half = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(half, f64::total_cmp);
        // the median of the size of a normal number is 0.6745 of its standard deviation
        Some(*median / 0.6745)
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Noise {
    least: f64,
    readings: Vec<f64>,
    means: Vec<f64>,
    of_readings: Differences,
    of_means: Differences,
}

impl Noise {
    /// Of a sensor that has at least this noise.
    pub fn new(least: f64) -> Self {
        let none = Differences::default();
        Self { least, readings: Vec::new(), means: Vec::new(), of_readings: none.clone(), of_means: none }
    }

    /// Forgets the last readings, since none came for a while.
    pub fn pause(&mut self) {
        self.readings.clear();
        self.means.clear();
    }

    /// Sees a block of readings, less what the model says. Standard deviation of a reading and variance of the mean, if they are known then.
    pub fn see(&mut self, block: &[f64]) -> Option<(f64, f64)> {
        let lag = block.len().div_ceil(2);
        for reading in block {
            self.readings.push(*reading);
            let i = self.readings.len() - 1;
            if i >= 2 * lag {
                self.of_readings.see([0, lag, 2 * lag].map(|back| self.readings[i - back]));
            }
        }
        let surplus = self.readings.len().saturating_sub(3 * block.len());
        self.readings.drain(..surplus);
        let count = block.len() as f64;
        self.means.push(block.iter().sum::<f64>() / count);
        if let [one, two, three] = self.means[..] {
            self.of_means.see([one, two, three]);
            self.means.remove(0);
        }
        let of_one = self.of_readings.deviation(FEWEST_SEEN)?.max(self.least);
        let of_mean = self.of_means.deviation(FEWEST_BLOCKS).unwrap_or(0.0);
        Some((of_one, (of_one * of_one / count).max(of_mean * of_mean)))
    }
}
