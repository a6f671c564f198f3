//! Observation and cancellation of a run.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Answer;

/// A request to end long work. Clones share one flag: any of them can set it, from any thread or signal handler.
///
/// A run checks it between two poses, and inside a pose that takes long.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Requests the end.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the end was requested.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The flag itself, for [`needle_core::twin::Twin::stop_on`].
    #[must_use]
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.0)
    }
}

/// Observes a run.
pub trait Watch {
    /// Called after each pose, with its answer or `None` if it was refused; `done` is the number of poses so far.
    fn progress(&mut self, done: usize, answer: Option<&Answer>);

    /// The cancellation of the run.
    fn cancel(&self) -> &Cancel;
}

/// Shows no progress.
impl Watch for Cancel {
    fn progress(&mut self, _: usize, _: Option<&Answer>) {}

    fn cancel(&self) -> &Cancel {
        self
    }
}
