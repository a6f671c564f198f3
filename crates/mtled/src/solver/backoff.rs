//! When a team does without its helpers: after one of them kept the others waiting.
//!
//! A helper that loses its processor within a part of the work keeps the phase open for a time w, which is what the machine gives to others
//! in one turn: milliseconds, where a phase takes a tenth of one. The caller then goes on alone for `SHARE` w before it opens a phase to helpers
//! again. On a machine where that happens all the time, at most about 1 / `SHARE` of the time is lost against one thread; on a quiet one, where it
//! happens f times a second, at most `SHARE` w f / 2 against two.

use std::time::{Duration, Instant};

/// Time without helpers over the time that was lost.
const SHARE: u32 = 16;

/// Until when the caller works alone.
#[derive(Debug, Default)]
pub struct Backoff(Option<Instant>);

impl Backoff {
    /// Learns what a phase has lost. Reads the clock after a loss only.
    pub fn after(&mut self, lost: Duration) {
        if !lost.is_zero() {
            self.0 = Some(Instant::now() + lost.saturating_mul(SHARE));
        }
    }

    /// Whether the next phase is to do without helpers.
    pub fn is_on(&mut self) -> bool {
        self.0 = self.0.filter(|until| Instant::now() < *until);
        self.0.is_some()
    }
}
