//! Which readings were answered.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::compare::{Answer, Watch};

/// Watches a run for another, and notes the index of the reading of each answer.
pub struct Answered<'a> {
    watch: &'a mut dyn Watch,
    /// Indices of readings, one for each answer.
    pub at: Vec<usize>,
}

impl<'a> Answered<'a> {
    /// Hands everything on.
    pub fn new(watch: &'a mut dyn Watch) -> Self {
        Self { watch, at: Vec::new() }
    }
}

impl Watch for Answered<'_> {
    fn progress(&mut self, done: usize, answer: Option<&Answer>) {
        if answer.is_some() {
            self.at.push(done - 1);
        }
        self.watch.progress(done, answer);
    }

    fn stop(&self) -> bool {
        self.watch.stop()
    }

    fn stop_flag(&self) -> Option<Arc<AtomicBool>> {
        self.watch.stop_flag()
    }
}
