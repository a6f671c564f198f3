//! When a team does without its helpers: after they cost more time than they saved.
//!
//! A helper that loses its processor within a part of the work keeps the phase open for a time w, which is what the machine gives
//! to others in one turn: milliseconds, where a phase takes a tenth of one. Since the helpers were last called, a time t ago, they
//! saved at most t / 2 (two threads) to t (many). Where t < [`WORTH`] w they cost more than that, and the caller works alone for
//! [`FIRST`] w, twice as long after each further loss, up to [`LONGEST`] w. So on a machine that takes helpers away all the time
//! about 1 / `LONGEST` of the time is lost against one thread, and on a quiet one nothing against many.

use std::time::{Duration, Instant};

/// Time with helpers over the time lost, below which they were not worth it.
const WORTH: u32 = 4;
/// Time without helpers over the time lost: at the first loss,
const FIRST: u32 = 8;
/// and after many.
const LONGEST: u32 = 256;

/// Until when the caller works alone.
#[derive(Debug)]
pub struct Backoff {
    /// Since when there are helpers.
    since: Instant,
    until: Option<Instant>,
    /// Time without helpers over the time lost, at the next loss.
    share: u32,
}

impl Default for Backoff {
    fn default() -> Self {
        Self { since: Instant::now(), until: None, share: FIRST }
    }
}

impl Backoff {
    /// Learns what a phase has lost. Reads the clock after a loss only.
    pub fn after(&mut self, lost: Duration) {
        if !lost.is_zero() {
            self.judge(lost, Instant::now());
        }
    }

    fn judge(&mut self, lost: Duration, now: Instant) {
        if now.duration_since(self.since) > (WORTH + 1) * lost {
            (self.since, self.share) = (now, FIRST);
        } else {
            self.until = Some(now + self.share * lost);
            self.share = (2 * self.share).min(LONGEST);
        }
    }

    /// Whether the next phase is to do without helpers. Reads the clock only while they are left out.
    pub fn is_on(&mut self) -> bool {
        self.until.is_some() && !self.is_over(Instant::now())
    }

    fn is_over(&mut self, now: Instant) -> bool {
        let over = self.until.is_none_or(|until| now >= until);
        if over {
            (self.since, self.until) = (now, None);
        }
        over
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Share of the time without helpers, where each is taken away for `lost` after it has helped for `helped`.
    fn alone(helped: Duration, lost: Duration) -> f64 {
        let mut backoff = Backoff::default();
        let (begun, mut without) = (backoff.since, Duration::ZERO);
        let mut now = begun;
        for _ in 0..1000 {
            now += helped + lost;
            backoff.judge(lost, now);
            if let Some(until) = backoff.until {
                without += until - now;
                now = until;
                assert!(backoff.is_over(now));
            }
        }
        without.as_secs_f64() / (now - begun).as_secs_f64()
    }

    #[test]
    fn helpers_that_cost_more_than_they_save_are_left_out_nearly_always() {
        assert!(alone(3 * MS, 3 * MS) > 0.98);
        assert!(alone(MS, 8 * MS) > 0.98);
    }

    #[test]
    fn helpers_that_are_taken_away_now_and_then_are_kept() {
        assert!(alone(100 * MS, 4 * MS) < 1e-9);
    }

    #[test]
    fn a_good_time_ends_the_doubling() {
        let mut backoff = Backoff::default();
        let mut now = backoff.since;
        for expected in [8, 16, 32] {
            now += 2 * MS;
            backoff.judge(MS, now);
            assert_eq!(backoff.until.map(|until| until - now), Some(expected * MS));
            now = backoff.until.unwrap_or(now);
            assert!(backoff.is_over(now));
        }
        now += 100 * MS;
        backoff.judge(MS, now);
        assert!(backoff.until.is_none());
        now += 2 * MS;
        backoff.judge(MS, now);
        assert_eq!(backoff.until.map(|until| until - now), Some(FIRST * MS));
    }
}
