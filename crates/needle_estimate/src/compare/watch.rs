//! Who looks at a run while it goes on, and who ends it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Answer;

/// Asks long work to end. Clones are one flag: whoever has one can set it, from any thread or signal handler.
///
/// A run looks at it between two poses, and inside a pose that takes long.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether somebody has asked.
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
    /// One pose was answered, or refused (`None`); `done` of them in all.
    fn progress(&mut self, done: usize, answer: Option<&Answer>);

    /// What ends the run.
    fn cancel(&self) -> &Cancel;
}

/// Shows nothing.
impl Watch for Cancel {
    fn progress(&mut self, _: usize, _: Option<&Answer>) {}

    fn cancel(&self) -> &Cancel {
        self
    }
}
