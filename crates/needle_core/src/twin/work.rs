//! Counts of what is computed besides the force, which show that outputs nobody asked for are not computed.

use std::sync::atomic::{AtomicU64, Ordering};

/// What a twin has computed beside the force since it was built, in values of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Displacements of shown points.
    pub displacements: u64,
    /// Places of targets.
    pub targets: u64,
    /// Volume ratios, averaged to shown points.
    pub volume_ratios: u64,
    /// Stresses, averaged to shown points.
    pub stresses: u64,
}

/// The counters; shared references to a twin count as well.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub displacements: Counter,
    pub targets: Counter,
    pub volume_ratios: Counter,
    pub stresses: Counter,
}

/// A number that only grows.
#[derive(Debug, Default)]
pub(super) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn add(&self, values: usize) {
        self.0.fetch_add(values as u64, Ordering::Relaxed);
    }

    fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

impl Counters {
    pub(crate) fn work(&self) -> Work {
        Work {
            displacements: self.displacements.get(),
            targets: self.targets.get(),
            volume_ratios: self.volume_ratios.get(),
            stresses: self.stresses.get(),
        }
    }
}
