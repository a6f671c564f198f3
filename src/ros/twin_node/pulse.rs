//! Detects that the solver hangs.

use std::time::Duration;

/// Counts consecutive checks that found the solver at the same work. It counts checks instead of seconds, because a
/// suspended process has not worked in the meantime, but has not hung either.
#[derive(Debug)]
pub(super) struct Pulse {
    interval: Duration,
    work: Option<u64>,
    looks: u32,
}

impl Pulse {
    /// For one check per `interval`.
    pub(crate) const fn new(interval: Duration) -> Self {
        Self { interval, work: None, looks: 0 }
    }

    /// Checks the number of the present work; returns for how long it has been the same.
    pub(crate) fn look(&mut self, work: Option<u64>) -> Duration {
        self.looks = if work.is_some() && work == self.work { self.looks.saturating_add(1) } else { 0 };
        self.work = work;
        self.interval * self.looks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_work_for_long_is_no_pulse() {
        let mut pulse = Pulse::new(Duration::from_millis(50));
        assert_eq!(pulse.look(Some(1)), Duration::ZERO);
        assert_eq!(pulse.look(Some(1)), Duration::from_millis(50));
        assert_eq!(pulse.look(Some(1)), Duration::from_millis(100));
        assert_eq!(pulse.look(Some(2)), Duration::ZERO, "it goes on");
        assert_eq!((pulse.look(None), pulse.look(None)), (Duration::ZERO, Duration::ZERO), "it waits");
        assert_eq!(pulse.look(Some(2)), Duration::ZERO);
    }
}
