//! A message that could be said a thousand times a second, said once.

use std::time::{Duration, Instant};

/// Lets a message through at most once per interval, and counts what it held back.
#[derive(Debug)]
pub struct Throttle {
    interval: Duration,
    last: Option<Instant>,
    held: u64,
}

impl Throttle {
    /// One message per `interval`.
    #[must_use]
    pub const fn new(interval: Duration) -> Self {
        Self { interval, last: None, held: 0 }
    }

    /// `Some(held back since the last one)` if a message may go out now.
    pub fn pass(&mut self) -> Option<u64> {
        let now = Instant::now();
        if self.last.is_some_and(|last| now.duration_since(last) < self.interval) {
            self.held += 1;
            return None;
        }
        self.last = Some(now);
        Some(std::mem::take(&mut self.held))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn throttle_counts_what_it_holds_back() {
        let mut throttle = Throttle::new(Duration::from_secs(60));
        assert_eq!(throttle.pass(), Some(0));
        assert_eq!(throttle.pass(), None);
        throttle.last = None;
        assert_eq!(throttle.pass(), Some(1));
    }
}
