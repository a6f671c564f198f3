//! Noise of a sensor's readings, and of block means, from second differences. These contain little of the signal.
//!
//! ```text
//! sigma^2 = median(|r_i - 2 r_(i-l) + r_(i-2l)|)^2 / (6 * 0.6745^2),   r: reading minus the model's prediction
//! ```
//!
//! l is half a block, so that correlated neighbours (a filter, an interpolation) don't hide the noise. The same
//! formula applied to the block means gives the noise that remains in these.

/// Number of latest second differences, of readings or blocks, from which the noise is estimated.
const SEEN: usize = 1000;
/// Fewest second differences for an estimate; before it, no block is used.
const FEWEST_SEEN: usize = 3;
/// Fewest second differences of block means: a median of fewer has an error of about a half.
const FEWEST_BLOCKS: usize = 8;

/// Magnitudes of the latest second differences over sqrt(6), as bits; the order of the bits is that of the numbers.
#[derive(Clone, Debug, Default)]
struct Differences {
    latest: Vec<u64>,
    /// Index of the oldest, once the buffer is full.
    oldest: usize,
    /// The magnitudes around the median, sorted: all between these bounds.
    middle: Vec<u64>,
    bounds: [u64; 2],
    /// How many are smaller.
    smaller: usize,
}

impl Differences {
    fn see(&mut self, [one, two, three]: [f64; 3]) {
        let size = ((one - 2.0 * two + three).abs() / 6f64.sqrt()).to_bits();
        match self.place(size) {
            Some(place) => self.middle.insert(place, size),
            None => self.smaller += usize::from(size < self.bounds[0]),
        }
        if self.latest.len() < SEEN {
            self.latest.push(size);
            return;
        }
        let old = std::mem::replace(&mut self.latest[self.oldest], size);
        self.oldest = (self.oldest + 1) % SEEN;
        match self.place(old) {
            Some(place) => _ = self.middle.remove(place),
            None => self.smaller -= usize::from(old < self.bounds[0]),
        }
    }

    /// Position of a magnitude in the middle part, if it belongs there.
    fn place(&self, size: u64) -> Option<usize> {
        // A single comparison: whether a magnitude is below the middle is random, and mispredicted branches would
        // dominate the cost.
        let inside = size.wrapping_sub(self.bounds[0]) <= self.bounds[1] - self.bounds[0];
        inside.then(|| self.middle.partition_point(|other| *other < size))
    }

    /// Standard deviation, from at least this many differences.
    fn deviation(&mut self, fewest: usize) -> Option<f64> {
        if self.latest.len() < fewest.max(1) {
            return None;
        }
        let half = self.latest.len() / 2;
        if half < self.smaller || half - self.smaller >= self.middle.len() {
            self.sort(half);
        }
        // the median magnitude of a normal variable is 0.6745 standard deviations
        Some(f64::from_bits(self.middle[half - self.smaller]) / 0.6745)
    }

    /// Rebuilds the middle part: an eighth of all magnitudes, around the median.
    fn sort(&mut self, half: usize) {
        let mut all = self.latest.clone();
        all.sort_unstable();
        self.bounds = [all[half - half / 8], all[half + half / 8]];
        self.smaller = all.partition_point(|size| *size < self.bounds[0]);
        let larger = all.partition_point(|size| *size <= self.bounds[1]);
        self.middle = all[self.smaller..larger].to_vec();
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
    /// For a sensor that has at least this noise.
    pub(crate) fn new(least: f64) -> Self {
        let none = Differences::default();
        Self { least, readings: Vec::new(), means: Vec::new(), of_readings: none.clone(), of_means: none }
    }

    /// Discards the last readings after a gap.
    pub(crate) fn pause(&mut self) {
        self.readings.clear();
        self.means.clear();
    }

    /// Takes a block of readings minus the model's prediction. Returns the standard deviation of a reading and the
    /// variance of the mean, if they are known by then.
    pub(crate) fn see(&mut self, block: &[f64]) -> Option<(f64, f64)> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_the_sorted_sizes() {
        let mut differences = Differences::default();
        let mut sizes: Vec<f64> = Vec::new();
        for i in 0..6 * SEEN {
            // growing amplitude, constant, and in steps as of a quantised sensor
            let wave = (0.7 * (i * i % 9973) as f64).sin() * (1.0 + (i / 700) as f64);
            let reading = if i / 1500 == 1 { 0.0 } else { wave };
            let reading = if i / 1500 == 2 { reading.round() } else { reading };
            differences.see([reading, 0.0, 0.0]);
            sizes.push(reading.abs() / 6f64.sqrt());
            if i % 7 == 0 {
                let mut latest = sizes[sizes.len().saturating_sub(SEEN)..].to_vec();
                latest.sort_by(f64::total_cmp);
                assert_eq!(differences.deviation(1), Some(latest[latest.len() / 2] / 0.6745), "{i}");
            }
        }
        // fewer than required
        assert_eq!(Differences::default().deviation(FEWEST_SEEN), None);
    }
}
