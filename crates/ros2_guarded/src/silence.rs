//! How long a process has said nothing.

use std::time::{Duration, Instant};

/// Time between two looks at a silent socket, a little longer than that between two pulses.
const LOOK: Duration = Duration::from_millis(300);

/// Looks in a row between which a process has said nothing. What the node does meanwhile is no sign of the process's life.
///
/// Looks are counted and not time: a node that was stopped itself must not take its own sleep for silence.
pub(super) struct Silence {
    /// How many.
    pub looks: u32,
    heard: bool,
    due: Instant,
}

impl Silence {
    pub(crate) fn new(now: Instant) -> Self {
        Self { looks: 0, heard: false, due: now + LOOK }
    }

    /// Time until the next look.
    pub(crate) fn left(&self, now: Instant) -> Duration {
        self.due.saturating_duration_since(now)
    }

    /// The process has said something, or not.
    pub(crate) fn look(&mut self, heard: bool, now: Instant) {
        self.heard |= heard;
        if self.heard {
            self.looks = 0;
        }
        if now >= self.due {
            self.looks += u32::from(!self.heard);
            (self.heard, self.due) = (false, now + LOOK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_node_does_is_no_sign_of_life() {
        let begun = Instant::now();
        let mut silence = Silence::new(begun);
        // a large message every millisecond: the node wakes for each, and the process says nothing
        let at = |ms: u64| begun + Duration::from_millis(ms);
        (1..=3000).for_each(|ms| silence.look(false, at(ms)));
        assert_eq!(silence.looks, 10);
        silence.look(true, at(3001));
        assert_eq!(silence.looks, 0);
        // the node itself has slept for an hour: that is one look
        silence.look(false, at(3_600_000));
        silence.look(false, at(3_600_001));
        assert!(silence.looks <= 1);
    }
}
