//! Sensor latency: readings are delivered after a delay.

use std::collections::VecDeque;

/// A delay line: readings come out in order, a fixed number of steps later.
#[derive(Clone, Debug)]
pub struct Delay<T> {
    line: VecDeque<T>,
    steps: usize,
}

impl<T> Delay<T> {
    /// A line with the delay `latency_s`, rounded to whole steps of `step_s`.
    #[must_use]
    pub fn new(latency_s: f64, step_s: f64) -> Self {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a count; negative and NaN become 0
        let steps = (latency_s / step_s).round() as usize;
        Self { line: VecDeque::with_capacity(steps + 1), steps }
    }

    /// Inserts a reading and returns the oldest one, once the line is full.
    pub fn pass(&mut self, reading: T) -> Option<T> {
        self.line.push_back(reading);
        if self.line.len() > self.steps { self.line.pop_front() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_comes_out_after_the_latency_and_none_is_lost() {
        let mut delay = Delay::new(0.003, 0.001);
        let out: Vec<Option<u32>> = (0..6).map(|i| delay.pass(i)).collect();
        assert_eq!(out, [None, None, None, Some(0), Some(1), Some(2)]);
        assert_eq!(Delay::new(0.0, 0.001).pass(7), Some(7));
    }
}
