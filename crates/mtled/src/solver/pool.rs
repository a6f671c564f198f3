//! A persistent team of threads for the explicit step: no lock, no allocation, no thread started per step.
//!
//! A step is a sequence of phases. [`Pool::each`] is one phase: it hands every part of some work to one thread and returns
//! when all are done. Which thread computes a part never matters to the result, so any number of threads gives the
//! same bits. The work is borrowed exclusively for the phase, and the pool too, so neither a second pool on the same
//! memory nor a phase within a phase compiles.
//!
//! On a busy machine a helper may lose its processor within a part, and the caller waits for as long as others run there.
//! What such a wait cost says for how long the team goes on without that helper (see [`super::backoff`]).
//!
//! A phase that panics poisons the pool: the panic goes on in the caller, the helpers wait, and every later phase panics.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::backoff::{Backoff, come_back};
use super::disjoint::{Disjoint, Each};
use super::gate::Gate;
use super::sync::relax;

/// Turns of a helper's waiting loop, spins included, after which it sleeps until the next phase.
const PATIENCE: u32 = 5_000;

/// A phase's closure by its address.
#[derive(Clone, Copy)]
struct Job {
    closure: *const (),
    /// Calls the closure with the gate and the thread's rank.
    call: unsafe fn(*const (), &Gate<Job>, usize),
}

// SAFETY: `Job::new` takes closures that may be called from several threads.
unsafe impl Send for Job {}

impl Job {
    fn new<F: Fn(&Gate<Self>, usize) + Sync>(closure: &F) -> Self {
        /// # Safety
        /// `closure` is the address of a live `F`.
        unsafe fn call<F: Fn(&Gate<Job>, usize)>(closure: *const (), gate: &Gate<Job>, rank: usize) {
            // SAFETY: by the caller's promise.
            let closure = unsafe { &*closure.cast::<F>() };
            closure(gate, rank);
        }
        Self { closure: std::ptr::from_ref(closure).cast(), call: call::<F> }
    }
}

struct Shared {
    gate: Gate<Job>,
    stop: AtomicBool,
    /// Helpers that have begun.
    begun: AtomicUsize,
    /// Of each helper, whether it is left out and sleeps.
    left_out: Vec<AtomicBool>,
}

/// Persistent threads; the caller takes part as rank 0.
pub struct Pool {
    shared: Arc<Shared>,
    helpers: Vec<JoinHandle<()>>,
    backoff: Vec<Backoff>,
    /// Helpers that are left out.
    out: usize,
    poisoned: bool,
}

impl std::fmt::Debug for Pool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pool({} threads)", self.threads())
    }
}

impl Pool {
    /// Starts `threads - 1` helpers (at least none), and returns when they have begun: what the start of a thread allocates is no part of
    /// a step. A thread that can't be started is done without.
    #[must_use]
    pub fn new(threads: usize) -> Self {
        let shared = Arc::new(Shared {
            gate: Gate::new(),
            stop: AtomicBool::new(false),
            begun: AtomicUsize::new(0),
            left_out: (1..threads).map(|_| AtomicBool::new(false)).collect(),
        });
        let start = |rank: usize| {
            let shared = Arc::clone(&shared);
            thread::Builder::new().name(format!("solver-{rank}")).spawn(move || help(&shared, rank)).ok()
        };
        let helpers: Vec<_> = (1..threads).map_while(start).collect();
        while shared.begun.load(Ordering::Acquire) < helpers.len() {
            thread::yield_now();
        }
        let backoff = helpers.iter().map(|_| Backoff::default()).collect();
        Self { shared, helpers, backoff, out: 0, poisoned: false }
    }

    /// Number of threads, the caller's included.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.helpers.len() + 1
    }

    /// Calls `f(i, part)` for every part of some work, each on one thread, and returns when all are done.
    ///
    /// # Panics
    /// If `f` panicked on any thread, now or in an earlier phase.
    pub(crate) fn each<D: Disjoint>(&mut self, work: D, f: impl Fn(usize, D::Part) + Sync) {
        let count = work.len();
        if self.is_alone() {
            // SAFETY: each index once; `work` is used up.
            return self.alone(|| (0..count).for_each(|i| f(i, unsafe { work.part(i) })));
        }
        self.phase(&|gate, _| {
            while let Some(i) = gate.claim(count) {
                // SAFETY: `i` is below `count`, and the gate gives it to one thread of this phase; `work` is used up.
                f(i, unsafe { work.part(i) });
            }
        });
    }

    /// [`Pool::each`] with memory of each thread's own, `f(memory, i, part)`.
    ///
    /// # Panics
    /// As [`Pool::each`], and with less memory than threads.
    pub(crate) fn each_with<M: Send, D: Disjoint>(
        &mut self,
        memory: &mut [M],
        work: D,
        f: impl Fn(&mut M, usize, D::Part) + Sync,
    ) {
        assert!(memory.len() >= self.threads(), "memory for {} of {} threads", memory.len(), self.threads());
        let count = work.len();
        if self.is_alone() {
            let own = &mut memory[0];
            // SAFETY: as in `each`.
            return self.alone(|| (0..count).for_each(|i| f(own, i, unsafe { work.part(i) })));
        }
        let memory = Each::new(memory);
        self.phase(&|gate, rank| {
            // SAFETY: there is memory for every rank (checked above), and each is one thread's, once per phase.
            let own = unsafe { memory.part(rank) };
            while let Some(i) = gate.claim(count) {
                // SAFETY: as in `each`.
                f(own, i, unsafe { work.part(i) });
            }
        });
    }

    /// Calls back whom the team has done without for long enough, and says whether nobody helps the next phase. Reads the clock only
    /// while somebody is left out.
    fn is_alone(&mut self) -> bool {
        if self.out > 0 {
            for helper in come_back(&mut self.backoff) {
                self.shared.left_out[helper].store(false, Ordering::Relaxed);
                self.out -= 1;
            }
        }
        self.out == self.helpers.len()
    }

    /// Learns from a phase that a helper kept open for a time. Reads the clock after a loss only.
    fn learn(&mut self, rank: usize, lost: Duration) {
        let Some(helper) = rank.checked_sub(1).filter(|_| !lost.is_zero()) else { return };
        let (threads, left_out) = (self.threads() - self.out, &self.shared.left_out[helper]);
        // one that is left out already had entered before it saw that
        if !left_out.load(Ordering::Relaxed) && self.backoff[helper].after(lost, threads) {
            left_out.store(true, Ordering::Relaxed);
            self.out += 1;
        }
    }

    /// Runs a phase without helpers, and without the gate, whose atomic instructions are a twentieth of a half plane's step.
    fn alone(&mut self, work: impl FnOnce()) {
        self.begin();
        work();
        self.poisoned = false;
    }

    /// Poisons the pool until the phase has ended well.
    fn begin(&mut self) {
        assert!(!self.poisoned, "a solver thread panicked before: this solver's state is lost, build a new one");
        self.poisoned = true;
    }

    /// Runs `job` on this thread, and on every helper that comes before it is done.
    fn phase<F: Fn(&Gate<Job>, usize) + Sync>(&mut self, job: &F) {
        self.begin();
        let gate = &self.shared.gate;
        for (helper, left_out) in self.helpers.iter().zip(&self.shared.left_out) {
            if !left_out.load(Ordering::Relaxed) {
                helper.thread().unpark();
            }
        }
        // SAFETY: `&mut self` keeps other threads out, and `f` of `each` has no pool to call. The job outlives the call.
        let ended = unsafe { gate.phase(Job::new(job), || job(gate, 0)) };
        assert!(!ended.panicked, "a solver thread panicked");
        self.learn(ended.late, ended.lost);
        self.poisoned = false;
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        for helper in self.helpers.drain(..) {
            helper.thread().unpark();
            // a panic was reported by the phase
            drop(helper.join());
        }
    }
}

fn help(shared: &Shared, rank: usize) {
    shared.begun.fetch_add(1, Ordering::Release);
    let (mut seen, mut turns) = (0, 0);
    while !shared.stop.load(Ordering::Acquire) {
        if shared.left_out[rank - 1].load(Ordering::Relaxed) {
            thread::park();
            continue;
        }
        let Some(job) = shared.gate.enter(&mut seen) else {
            wait(&mut turns);
            continue;
        };
        turns = 0;
        // SAFETY: inside the gate, so the owner waits in `Pool::phase`, whose job is alive.
        let call = AssertUnwindSafe(|| unsafe { (job.call)(job.closure, &shared.gate, rank) });
        shared.gate.leave(rank, catch_unwind(call).is_err());
    }
}

/// Phases of a step follow each other at once, so a helper stays awake for a while.
fn wait(turns: &mut u32) {
    if *turns < PATIENCE {
        relax(turns);
    } else {
        thread::park();
        *turns = 0;
    }
}

#[cfg(all(test, not(loom)))]
#[allow(clippy::panic)]
mod tests {
    use std::panic::catch_unwind;
    use std::sync::atomic::AtomicUsize;

    use super::*;

    #[test]
    fn every_part_is_handed_out_once_in_every_phase() {
        let rounds = if cfg!(miri) { 3 } else { 500 };
        for threads in [1, 2, 3] {
            let mut pool = Pool::new(threads);
            let mut counts = [0_usize; 57];
            let mut calls = vec![0; threads];
            for round in 1..=rounds {
                pool.each(Each::new(&mut counts), |i, count| *count += i);
                pool.each_with(&mut calls, Each::new(&mut counts), |calls, _, count| {
                    *count += 1;
                    *calls += 1;
                });
                assert!(counts.iter().enumerate().all(|(i, c)| *c == round * (i + 1)), "{threads} threads");
            }
            assert_eq!(calls.iter().sum::<usize>(), rounds * counts.len(), "{threads} threads");
        }
    }

    /// Panics in the caller's own share, alone and among three, and in a helper's.
    #[test]
    fn a_panic_poisons_the_pool_and_no_later_phase_begins() {
        for (threads, in_helper) in [(1, false), (3, false), (3, true)] {
            let mut pool = Pool::new(threads);
            let arrived = AtomicUsize::new(0);
            let mut parts = [0; 64];
            let panicked = catch_unwind(AssertUnwindSafe(|| {
                pool.each(Each::new(&mut parts), |_, part| {
                    let helper = thread::current().name().is_some_and(|name| name.starts_with("solver-"));
                    if helper == in_helper {
                        arrived.fetch_add(1, Ordering::Relaxed);
                        panic!("the panic that is wanted");
                    }
                    // the other threads hold their first part until the one that panics is there
                    while arrived.load(Ordering::Relaxed) == 0 {
                        thread::yield_now();
                    }
                    *part += 1;
                });
            }));
            assert!(panicked.is_err(), "in a helper: {in_helper}");
            let begun = AtomicUsize::new(0);
            for _ in 0..2 {
                let later = catch_unwind(AssertUnwindSafe(|| {
                    pool.each(Each::new(&mut parts), |_, _| {
                        begun.fetch_add(1, Ordering::Relaxed);
                    });
                }));
                let message = later.err().and_then(|p| p.downcast_ref::<&str>().map(ToString::to_string));
                assert!(message.is_some_and(|m| m.contains("panicked before")), "in a helper: {in_helper}");
            }
            assert_eq!(begun.load(Ordering::Relaxed), 0, "in a helper: {in_helper}");
            // helpers end: this returns
            drop(pool);
        }
    }

    /// The first of two helpers stays away in the middle of its part: it is left out of the phases after that, for many times as long, and the
    /// other is not.
    #[test]
    #[cfg(not(miri))]
    fn a_helper_that_kept_the_team_waiting_is_left_out_for_a_while() {
        let mut pool = Pool::new(3);
        let is_first = || thread::current().name() == Some("solver-1");
        let helped = AtomicUsize::new(0);
        let mut parts = [0; 64];
        pool.each(Each::new(&mut parts), |_, _| {
            if is_first() {
                helped.fetch_add(1, Ordering::Relaxed);
                thread::sleep(Duration::from_millis(500));
            }
            while helped.load(Ordering::Relaxed) == 0 {
                thread::yield_now();
            }
        });
        assert!(helped.swap(0, Ordering::Relaxed) > 0);
        let left_out: Vec<bool> = pool.shared.left_out.iter().map(|out| out.load(Ordering::Relaxed)).collect();
        assert_eq!((left_out, pool.out), (vec![true, false], 1));
        for _ in 0..100 {
            pool.each(Each::new(&mut parts), |_, part| {
                helped.fetch_add(usize::from(is_first()), Ordering::Relaxed);
                *part += 1;
            });
        }
        assert_eq!(helped.load(Ordering::Relaxed), 0);
        assert_eq!(parts, [100; 64]);
    }

    #[test]
    #[should_panic(expected = "memory for 1 of 2 threads")]
    fn memory_for_too_few_threads_is_refused() {
        Pool::new(2).each_with(&mut [0], Each::new(&mut [0; 3]), |_, _, _| {});
    }
}
