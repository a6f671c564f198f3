//! The primitives under [`super::gate`]: the standard library's, or loom's, which tries every order of events.

#[cfg(not(all(test, loom)))]
pub(super) use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

#[cfg(all(test, loom))]
pub use loom::cell::UnsafeCell;
#[cfg(all(test, loom))]
pub use loom::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

/// The standard cell behind loom's interface.
#[cfg(not(all(test, loom)))]
pub(super) struct UnsafeCell<T>(std::cell::UnsafeCell<T>);

#[cfg(not(all(test, loom)))]
impl<T> UnsafeCell<T> {
    pub(super) fn new(x: T) -> Self {
        Self(std::cell::UnsafeCell::new(x))
    }

    #[inline(always)]
    pub(super) fn with<R>(&self, f: impl FnOnce(*const T) -> R) -> R {
        f(self.0.get())
    }

    #[inline(always)]
    pub(super) fn with_mut<R>(&self, f: impl FnOnce(*mut T) -> R) -> R {
        f(self.0.get())
    }
}

/// Spins before a waiting thread gives its time slice away: waking one up took a tenth of a step.
#[cfg(not(all(test, loom)))]
pub(super) const SPINS: u32 = 4_000;

/// One turn of a loop that waits for another thread.
#[cfg(not(all(test, loom)))]
pub(super) fn relax(spins: &mut u32) {
    *spins = spins.saturating_add(1);
    if *spins < SPINS {
        std::hint::spin_loop();
    } else {
        // more runnable threads than processors: let the one we wait for run
        std::thread::yield_now();
    }
}

/// As above: loom only has to know that another thread must run.
#[cfg(all(test, loom))]
pub fn relax(_: &mut u32) {
    loom::thread::yield_now();
}

/// A wait for another thread that measures itself once it gets long: a short one reads no clock.
#[derive(Default)]
pub(super) struct Wait {
    spins: u32,
    #[cfg(not(all(test, loom)))]
    since: Option<std::time::Instant>,
}

impl Wait {
    /// One turn of the loop that waits.
    pub(super) fn turn(&mut self) {
        relax(&mut self.spins);
        #[cfg(not(all(test, loom)))]
        if self.spins == SPINS {
            self.since = Some(std::time::Instant::now());
        }
    }

    /// Time since the spins were used up; zero for a short wait.
    pub(super) fn lost(&self) -> std::time::Duration {
        #[cfg(not(all(test, loom)))]
        return self.since.map_or(std::time::Duration::ZERO, |since| since.elapsed());
        #[cfg(all(test, loom))]
        std::time::Duration::ZERO
    }
}
