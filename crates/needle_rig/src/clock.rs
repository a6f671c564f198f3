//! The playback clock: converts between wall time and bag time.
//!
//! It is arithmetic only, so that it can be tested without sleeping: the caller passes the wall time.

use std::time::{Duration, Instant};

/// Time of a recording that is being played, ns since 1970.
#[derive(Clone, Copy, Debug)]
pub struct PlaybackClock {
    /// Reference pair of wall time and bag time.
    wall: Instant,
    bag_ns: i64,
    /// Bag seconds per wall second.
    rate: f64,
    paused: bool,
}

impl PlaybackClock {
    /// A clock that shows `bag_ns` at `wall`.
    #[must_use]
    pub(crate) const fn new(wall: Instant, bag_ns: i64, rate: f64, paused: bool) -> Self {
        Self { wall, bag_ns, rate, paused }
    }

    /// Bag time at a wall time.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss)] // 2^53 ns are 104 days of playing
    pub(crate) fn now_ns(&self, wall: Instant) -> i64 {
        if self.paused {
            return self.bag_ns;
        }
        let elapsed = wall.saturating_duration_since(self.wall).as_nanos() as f64;
        self.bag_ns + (elapsed * self.rate) as i64
    }

    /// Wall time at which a bag time is reached; `None` while paused. A past time is due now.
    #[must_use]
    #[allow(clippy::cast_precision_loss)] // 2^53 ns are 104 days of playing
    pub fn due(&self, bag_ns: i64) -> Option<Instant> {
        let ahead = (bag_ns - self.bag_ns).max(0) as f64 / self.rate;
        let ahead = Duration::try_from_secs_f64(ahead * 1e-9).unwrap_or(Duration::from_secs(86_400 * 365));
        (!self.paused).then(|| self.wall + ahead)
    }

    /// Bag seconds per wall second.
    #[must_use]
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// Whether it is paused.
    #[must_use]
    pub const fn is_paused(&self) -> bool {
        self.paused
    }

    /// Changes the rate from now on. Returns false, without a change, unless it is a positive finite number.
    pub(crate) fn set_rate(&mut self, wall: Instant, rate: f64) -> bool {
        let usable = rate.is_finite() && rate > 0.0;
        if usable {
            self.jump(wall, self.now_ns(wall));
            self.rate = rate;
        }
        usable
    }

    /// Pauses or resumes.
    pub(crate) fn set_paused(&mut self, wall: Instant, paused: bool) {
        self.jump(wall, self.now_ns(wall));
        self.paused = paused;
    }

    /// Goes to a bag time.
    pub(crate) fn jump(&mut self, wall: Instant, bag_ns: i64) {
        self.wall = wall;
        self.bag_ns = bag_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn rate_pause_and_jump() {
        let t0 = Instant::now();
        let mut clock = PlaybackClock::new(t0, 1_000, 2.0, false);
        assert_eq!(clock.now_ns(t0 + SECOND), 2_000_001_000);
        assert_eq!(clock.due(2_000_001_000), Some(t0 + SECOND));
        assert_eq!(clock.due(0), Some(t0), "what is past is due now");
        clock.set_paused(t0 + SECOND, true);
        assert_eq!(clock.now_ns(t0 + 5 * SECOND), 2_000_001_000);
        assert_eq!(clock.due(i64::MAX), None);
        clock.set_paused(t0 + 5 * SECOND, false);
        assert!(clock.set_rate(t0 + 6 * SECOND, 0.5));
        assert_eq!(clock.now_ns(t0 + 8 * SECOND), 5_000_001_000);
        clock.jump(t0 + 8 * SECOND, 7);
        assert_eq!(clock.now_ns(t0 + 8 * SECOND), 7);
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(!clock.set_rate(t0, bad));
        }
    }
}
