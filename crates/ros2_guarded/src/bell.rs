//! Wakes the thread that answers services when one is called, so that it need not poll often.

use std::time::Instant;

use crossbeam_channel::{Receiver, Sender};

/// See the module. Clones are the same bell.
#[derive(Clone, Debug)]
pub struct Bell {
    ring: Sender<()>,
    rung: Receiver<()>,
}

impl Default for Bell {
    fn default() -> Self {
        let (ring, rung) = crossbeam_channel::bounded(1);
        Self { ring, rung }
    }
}

impl Bell {
    /// Rings; never waits.
    pub fn ring(&self) {
        // Full: it has been rung already.
        let _ = self.ring.try_send(());
    }

    /// Waits until it is rung or the time has come; false once `stop` is closed.
    pub fn wait(&self, stop: &Receiver<()>, until: Instant) -> bool {
        crossbeam_channel::select! {
            recv(stop) -> _ => false,
            recv(self.rung) -> _ => true,
            default(until.saturating_duration_since(Instant::now())) => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_ring_before_the_wait_is_heard_and_an_end_too() {
        let (end, stop) = crossbeam_channel::bounded(0);
        let (bell, long) = (Bell::default(), Duration::from_secs(60));
        let begun = Instant::now();
        bell.ring();
        bell.ring();
        assert!(bell.wait(&stop, begun + long), "rung");
        assert!(bell.wait(&stop, begun + Duration::from_millis(1)), "two rings are one");
        drop(end);
        assert!(!bell.wait(&stop, begun + long) && begun.elapsed() < long);
    }
}
