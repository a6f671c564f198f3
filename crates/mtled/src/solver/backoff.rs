//! When a team does without a helper: after it cost more time than it saved.
//!
//! A helper that loses its processor within a part of the work keeps the phase open for a time w, which is what the machine gives
//! to others in one turn: milliseconds, where a phase takes a tenth of one. Of T threads that share the work evenly, one saves t/T of the
//! time t since it was last called back, so that it costs more than that where t < T w. Threads share unevenly, so the bound is
//! t < [`WORTH`] T w; then the team does without it for [`FIRST`] w, twice as long after each further loss, up to [`LONGEST`] w. So on a machine
//! that takes a helper away all the time about 1 / `LONGEST` of the time is lost against a team without it, and on a quiet one nothing
//! against the whole team. Each helper is judged by itself: of sixteen one may share its core with another program.

use std::time::{Duration, Instant};

/// What one must have saved, over the time lost.
const WORTH: f64 = 2.5;
/// Time without a helper over the time lost: at the first loss,
const FIRST: u32 = 8;
/// and after many.
const LONGEST: u32 = 256;

/// Until when the team does without one helper.
#[derive(Debug)]
pub(super) struct Backoff {
    /// Since when it helps.
    since: Instant,
    until: Option<Instant>,
    /// Time without it over the time lost, at the next loss.
    share: u32,
}

impl Default for Backoff {
    fn default() -> Self {
        Self { since: Instant::now(), until: None, share: FIRST }
    }
}

impl Backoff {
    /// Learns that a phase of so many threads has just waited for this helper. Whether it is left out from now on.
    pub(super) fn after(&mut self, lost: Duration, threads: usize) -> bool {
        self.judge(lost, Instant::now(), threads)
    }

    fn judge(&mut self, lost: Duration, now: Instant, threads: usize) -> bool {
        if now.duration_since(self.since) > lost.mul_f64(WORTH * threads as f64) {
            (self.since, self.share) = (now, FIRST);
            return false;
        }
        self.until = Some(now + self.share * lost);
        self.share = (2 * self.share).min(LONGEST);
        true
    }

    /// Whether it was left out and is to help again from now on.
    fn comes_back(&mut self, now: Instant) -> bool {
        let over = self.until.is_some_and(|until| now >= until);
        if over {
            (self.since, self.until) = (now, None);
        }
        over
    }
}

/// Ranks, less 1, of the helpers that come back now.
pub(super) fn come_back(helpers: &mut [Backoff]) -> impl Iterator<Item = usize> {
    let now = Instant::now();
    helpers.iter_mut().enumerate().filter_map(move |(i, helper)| helper.comes_back(now).then_some(i))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Share of the time without a helper of so many threads that is taken away for `lost` after it has helped for `helped`.
    fn without(threads: usize, helped: Duration, lost: Duration) -> f64 {
        let mut backoff = Backoff::default();
        let (begun, mut without) = (backoff.since, Duration::ZERO);
        let mut now = begun;
        for _ in 0..1000 {
            now += helped + lost;
            if backoff.judge(lost, now, threads) {
                let until = backoff.until.unwrap_or(now);
                without += until - now;
                now = until;
                assert!(backoff.comes_back(now));
            }
        }
        without.as_secs_f64() / (now - begun).as_secs_f64()
    }

    #[test]
    fn a_helper_that_costs_more_than_it_saves_is_left_out_nearly_always() {
        assert!(without(2, 3 * MS, 3 * MS) > 0.98);
        assert!(without(2, MS, 8 * MS) > 0.98);
        assert!(without(16, 100 * MS, 3 * MS) > 0.8, "a sixteenth of 100 ms is not worth three times 3 ms");
    }

    #[test]
    fn a_helper_that_is_taken_away_now_and_then_is_kept() {
        assert!(without(2, 100 * MS, 4 * MS) < 1e-9);
        assert!(without(16, 300 * MS, 4 * MS) < 1e-9);
    }

    #[test]
    fn a_good_time_ends_the_doubling() {
        let mut backoff = Backoff::default();
        let mut now = backoff.since;
        for expected in [8, 16, 32] {
            now += 2 * MS;
            assert!(backoff.judge(MS, now, 2));
            assert_eq!(backoff.until.map(|until| until - now), Some(expected * MS));
            assert!(!backoff.comes_back(now));
            now = backoff.until.unwrap_or(now);
            assert!(backoff.comes_back(now));
        }
        now += 100 * MS;
        assert!(!backoff.judge(MS, now, 2) && backoff.until.is_none());
        now += 2 * MS;
        assert!(backoff.judge(MS, now, 2));
        assert_eq!(backoff.until.map(|until| until - now), Some(FIRST * MS));
    }
}
