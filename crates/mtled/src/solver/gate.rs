//! How helper threads enter and leave a phase of work: one word that says which phase it is, whether it is open, and
//! how many helpers are inside.
//!
//! ```text
//! owner    write the job, open (release) ── takes part ── close, wait until nobody is inside (acquire)
//! helper   enter while open (acquire) ── takes part ── leave (release)
//! ```
//!
//! The owner may read and write everything of a phase before it opens and after it has waited. A helper that comes too
//! late finds the gate closed and misses the phase: nobody waits for a thread that has no processor.

use std::time::Duration;

use super::sync::{AtomicBool, AtomicU64, AtomicUsize, Ordering, UnsafeCell, Wait};

/// One helper inside; the lowest 31 bits count them.
const HELPER: u64 = 1;
const INSIDE: u64 = CLOSED - 1;
/// Nobody may enter.
const CLOSED: u64 = 1 << 31;
/// One phase; the upper 32 bits count them, round and round.
const PHASE: u64 = 1 << 32;

/// How a phase ended.
pub(super) struct Ended {
    /// A helper panicked.
    pub panicked: bool,
    /// Time for which the owner waited for a helper that had most likely lost its processor; zero for the usual short wait.
    pub lost: Duration,
    /// Rank of the helper that left last of those that left a closed gate: the one that was waited for.
    pub late: usize,
}

/// The gate of one team. `J` is what a phase's owner tells its helpers.
pub(super) struct Gate<J> {
    state: AtomicU64,
    /// Index of the next part of the work that nobody has claimed.
    next: AtomicUsize,
    /// [`Ended::late`].
    late: AtomicUsize,
    panicked: AtomicBool,
    job: UnsafeCell<Option<J>>,
}

// SAFETY: `job` is written by the owner while the gate is closed and nobody inside, and copied by helpers inside; the
// word's release and acquire order the two. A job must be fit to be sent.
unsafe impl<J: Send> Sync for Gate<J> {}

impl<J: Copy> Gate<J> {
    /// A closed gate.
    pub(super) fn new() -> Self {
        Self {
            state: AtomicU64::new(CLOSED),
            next: AtomicUsize::new(0),
            late: AtomicUsize::new(0),
            panicked: AtomicBool::new(false),
            job: UnsafeCell::new(None),
        }
    }

    /// Opens the gate for one phase, calls `own` on this thread, and returns when no helper is inside any more. If `own`
    /// unwinds, it does so after that.
    ///
    /// # Safety
    /// One phase at a time: not while another thread is in this function, and not from within a phase.
    pub(super) unsafe fn phase(&self, job: J, own: impl FnOnce()) -> Ended {
        // SAFETY: the gate is closed and nobody inside: it was made so, or the last phase left it so.
        self.job.with_mut(|at| unsafe { *at = Some(job) });
        self.next.store(0, Ordering::Relaxed);
        let before = self.state.load(Ordering::Relaxed);
        self.state.store((before & !(PHASE - 1)).wrapping_add(PHASE), Ordering::Release);
        let mut wait = Wait::default();
        let closing = Closing(self, &mut wait);
        own();
        drop(closing);
        Ended {
            panicked: self.panicked.swap(false, Ordering::Relaxed),
            lost: wait.lost(),
            late: self.late.load(Ordering::Relaxed),
        }
    }

    /// Enters the present phase if it is open and not the one `seen` last.
    pub(super) fn enter(&self, seen: &mut u32) -> Option<J> {
        let state = self.state.load(Ordering::Relaxed);
        let phase = (state >> 32) as u32;
        if state & CLOSED != 0 || phase == *seen {
            return None;
        }
        self.state.compare_exchange(state, state + HELPER, Ordering::Acquire, Ordering::Relaxed).ok()?;
        *seen = phase;
        // SAFETY: this thread is inside, so the owner does not write; what it wrote before it opened was acquired.
        self.job.with(|at| unsafe { *at })
    }

    /// The helper of a rank leaves the phase that [`Gate::enter`] gave a job of.
    pub(super) fn leave(&self, rank: usize, panicked: bool) {
        if panicked {
            self.panicked.store(true, Ordering::Relaxed);
        }
        if self.state.load(Ordering::Relaxed) & CLOSED != 0 {
            self.late.store(rank, Ordering::Relaxed);
        }
        self.state.fetch_sub(HELPER, Ordering::Release);
    }

    /// An index below `count` that no other thread of this phase gets.
    pub(super) fn claim(&self, count: usize) -> Option<usize> {
        let i = self.next.fetch_add(1, Ordering::Relaxed);
        (i < count).then_some(i)
    }
}

/// Closes the gate and waits for the helpers, however the owner leaves: they hold references into its frame.
struct Closing<'a, J>(&'a Gate<J>, &'a mut Wait);

impl<J> Drop for Closing<'_, J> {
    fn drop(&mut self) {
        let state = &self.0.state;
        if state.fetch_or(CLOSED, Ordering::Acquire) & INSIDE == 0 {
            return;
        }
        while state.load(Ordering::Acquire) & INSIDE != 0 {
            self.1.turn();
        }
    }
}

/// The protocol in every order in which two threads' memory operations can happen (docs/lab/soundness.md).
#[cfg(all(test, loom))]
mod model {
    use super::*;
    use loom::sync::Arc;

    /// What is shared of the caller's data, unsynchronised but by the gate.
    struct Data {
        gate: Gate<u64>,
        input: UnsafeCell<u64>,
        output: [UnsafeCell<u64>; 2],
        stop: AtomicBool,
    }

    // SAFETY: what is to be shown; loom reports an access that nothing orders.
    unsafe impl Sync for Data {}
    // SAFETY: as above.
    unsafe impl Send for Data {}

    impl Data {
        fn work(&self, job: u64) {
            while let Some(i) = self.gate.claim(self.output.len()) {
                // SAFETY: only read during a phase.
                let input = self.input.with(|at| unsafe { *at });
                // SAFETY: index i is this thread's.
                self.output[i].with_mut(|at| unsafe { *at += job * input });
            }
        }
    }

    #[test]
    fn phases_are_ordered_and_every_part_is_claimed_once() {
        let mut builder = loom::model::Builder::new();
        builder.preemption_bound = Some(3);
        builder.check(|| {
            let data = Arc::new(Data {
                gate: Gate::new(),
                input: UnsafeCell::new(0),
                output: [UnsafeCell::new(0), UnsafeCell::new(0)],
                stop: AtomicBool::new(false),
            });
            let helper = {
                let data = Arc::clone(&data);
                loom::thread::spawn(move || {
                    let mut seen = 0;
                    while !data.stop.load(Ordering::Acquire) {
                        match data.gate.enter(&mut seen) {
                            Some(job) => {
                                data.work(job);
                                data.gate.leave(1, job == 2);
                            }
                            None => loom::thread::yield_now(),
                        }
                    }
                })
            };
            let mut expected = 0;
            for job in 1..=2 {
                // SAFETY: between phases everything is the owner's.
                data.input.with_mut(|at| unsafe { *at += job });
                expected += job * (1..=job).sum::<u64>();
                // SAFETY: one owner, one phase at a time.
                let panicked = unsafe { data.gate.phase(job, || data.work(job)) }.panicked;
                assert!(!panicked || job == 2);
                for output in &data.output {
                    // SAFETY: as above.
                    assert_eq!(output.with(|at| unsafe { *at }), expected);
                }
            }
            data.stop.store(true, Ordering::Release);
            helper.join().unwrap();
        });
    }
}
