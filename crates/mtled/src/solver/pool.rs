//! A persistent team of threads for the explicit step: no fork and join per step, no lock, no allocation.
//!
//! [`Pool::run`] hands one closure to every thread; inside it, [`Team::barrier`] separates the phases of a step and
//! [`Team::claim`] deals out blocks. Which thread computes a block never matters to the result, so any number of
//! threads gives the same bits.

use std::cell::UnsafeCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle, Thread};

/// Spins before a waiting thread gives its time slice away.
const SPINS: u32 = 4_000;

type Job<'a> = &'a (dyn Fn(&Team) + Sync);

struct Shared {
    threads: AtomicUsize,
    /// Address of the job's fat reference, on the caller's stack while `run` is inside.
    job: AtomicPtr<()>,
    epoch: AtomicUsize,
    running: AtomicUsize,
    stop: AtomicBool,
    panicked: AtomicBool,
    arrived: AtomicUsize,
    phase: AtomicUsize,
    next: AtomicUsize,
}

/// The threads of a pool, seen from inside a job.
pub struct Team {
    shared: Arc<Shared>,
    /// 0 for the caller's own thread.
    pub rank: usize,
    claimed: UnsafeCell<usize>,
}

/// Persistent threads; the caller takes part as rank 0.
pub struct Pool {
    shared: Arc<Shared>,
    handles: Vec<JoinHandle<()>>,
    wake: Vec<Thread>,
}

impl std::fmt::Debug for Pool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pool({} threads)", self.threads())
    }
}

impl Pool {
    /// Starts `threads - 1` helpers (at least none). A thread that can't be started is done without.
    #[must_use]
    pub fn new(threads: usize) -> Self {
        let shared = Arc::new(Shared {
            threads: AtomicUsize::new(1),
            job: AtomicPtr::new(std::ptr::null_mut()),
            epoch: AtomicUsize::new(0),
            running: AtomicUsize::new(0),
            stop: AtomicBool::new(false),
            panicked: AtomicBool::new(false),
            arrived: AtomicUsize::new(0),
            phase: AtomicUsize::new(0),
            next: AtomicUsize::new(0),
        });
        let handles: Vec<_> = (1..threads)
            .map_while(|rank| {
                let team = Team { shared: Arc::clone(&shared), rank, claimed: UnsafeCell::new(0) };
                thread::Builder::new().name(format!("solver-{rank}")).spawn(move || work(&team)).ok()
            })
            .collect();
        shared.threads.store(handles.len() + 1, Ordering::Release);
        let wake = handles.iter().map(|h| h.thread().clone()).collect();
        Self { shared, handles, wake }
    }

    /// Number of threads, the caller's included.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.shared.threads.load(Ordering::Relaxed)
    }

    /// Runs `job` once on every thread and returns when all are done.
    ///
    /// # Panics
    /// If the job panicked on a helper.
    pub fn run(&mut self, job: Job<'_>) {
        let s = &self.shared;
        s.arrived.store(0, Ordering::Relaxed);
        s.phase.store(0, Ordering::Relaxed);
        s.next.store(0, Ordering::Relaxed);
        s.running.store(self.handles.len(), Ordering::Relaxed);
        s.job.store((&raw const job).cast_mut().cast(), Ordering::Relaxed);
        s.epoch.fetch_add(1, Ordering::Release);
        for t in &self.wake {
            t.unpark();
        }
        let unwinding = Abort;
        job(&Team { shared: Arc::clone(s), rank: 0, claimed: UnsafeCell::new(0) });
        std::mem::forget(unwinding);
        let mut spins = 0;
        while s.running.load(Ordering::Acquire) != 0 {
            relax(&mut spins);
        }
        assert!(!s.panicked.load(Ordering::Relaxed), "a solver thread panicked");
    }
}

/// Helpers hold a reference into the caller's frame: it must not unwind while they run.
struct Abort;

impl Drop for Abort {
    fn drop(&mut self) {
        std::process::abort();
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        stop(&self.shared, std::mem::take(&mut self.handles));
    }
}

fn stop(shared: &Shared, handles: Vec<JoinHandle<()>>) {
    shared.stop.store(true, Ordering::Release);
    shared.epoch.fetch_add(1, Ordering::Release);
    for h in handles {
        h.thread().unpark();
        // a panic was reported by `run`
        drop(h.join());
    }
}

fn work(team: &Team) {
    let s = &team.shared;
    let mut seen = 0;
    loop {
        let mut spins = 0;
        while s.epoch.load(Ordering::Acquire) == seen {
            // waking up took a tenth of a step: the next job often comes at once
            if spins < SPINS {
                spins += 1;
                std::hint::spin_loop();
            } else {
                thread::park();
            }
        }
        seen = s.epoch.load(Ordering::Acquire);
        if s.stop.load(Ordering::Acquire) {
            return;
        }
        // SAFETY: `run` stored the address of a live `Job` before it raised the epoch (release, acquired above) and
        // does not return, so keeps it alive, until `running` is zero, which this thread lowers after its last use.
        let job: Job<'_> = unsafe { *s.job.load(Ordering::Relaxed).cast::<Job<'_>>() };
        // SAFETY: only this thread touches its own `claimed`.
        unsafe { *team.claimed.get() = 0 };
        if std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| job(team))).is_err() {
            s.panicked.store(true, Ordering::Relaxed);
        }
        s.running.fetch_sub(1, Ordering::Release);
    }
}

fn relax(spins: &mut u32) {
    *spins += 1;
    if *spins < SPINS {
        std::hint::spin_loop();
    } else {
        // more runnable threads than processors: let the one we wait for run
        thread::yield_now();
    }
}

impl Team {
    /// Waits until every thread of the team is here. Everything written before is seen after.
    pub fn barrier(&self) {
        let s = &self.shared;
        let threads = s.threads.load(Ordering::Relaxed);
        if threads == 1 {
            return;
        }
        let phase = s.phase.load(Ordering::Acquire);
        if s.arrived.fetch_add(1, Ordering::AcqRel) + 1 == threads {
            s.arrived.store(0, Ordering::Relaxed);
            s.phase.store(phase + 1, Ordering::Release);
        } else {
            let mut spins = 0;
            while s.phase.load(Ordering::Acquire) == phase && !s.panicked.load(Ordering::Relaxed) {
                relax(&mut spins);
            }
        }
    }

    /// Calls `f` for blocks 0..count, each on one thread. Every thread of the team must call it, in the same order,
    /// with a barrier between one deal and the next.
    pub fn claim(&self, count: usize, mut f: impl FnMut(usize)) {
        // SAFETY: only this thread touches its own `claimed`.
        let base = unsafe { &mut *self.claimed.get() };
        loop {
            let i = self.shared.next.fetch_add(1, Ordering::Relaxed) - *base;
            if i >= count {
                break;
            }
            f(i);
        }
        // every thread overshoots exactly once per deal, so the next deal starts at a known number
        *base += count + self.shared.threads.load(Ordering::Relaxed);
    }
}

/// A slice whose elements are written by whichever thread claimed their index.
pub struct Dealt<'a, T> {
    at: *mut T,
    len: usize,
    life: std::marker::PhantomData<&'a mut [T]>,
}

// SAFETY: access goes through `Dealt::get`, whose contract forbids two threads on one element.
unsafe impl<T: Send> Sync for Dealt<'_, T> {}

impl<'a, T> Dealt<'a, T> {
    /// Borrows a slice for the length of a job.
    pub fn new(slice: &'a mut [T]) -> Self {
        Self { at: slice.as_mut_ptr(), len: slice.len(), life: std::marker::PhantomData }
    }

    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Element `i`, exclusively.
    ///
    /// # Safety
    /// Between two barriers no other thread may hold element `i`, neither by `get` nor by `read`.
    #[expect(clippy::mut_from_ref, reason = "exclusive by the contract above")]
    pub unsafe fn get(&self, i: usize) -> &mut T {
        assert!(i < self.len);
        // SAFETY: in bounds; exclusive by the caller's promise.
        unsafe { &mut *self.at.add(i) }
    }

    /// All elements, shared.
    ///
    /// # Safety
    /// Between two barriers no thread may hold an element by `get`.
    pub unsafe fn read(&self) -> &[T] {
        // SAFETY: valid for `len` elements; nobody writes by the caller's promise.
        unsafe { std::slice::from_raw_parts(self.at, self.len) }
    }

    /// Elements `range`, exclusively.
    ///
    /// # Safety
    /// As [`Dealt::get`], for every element of the range.
    #[expect(clippy::mut_from_ref, reason = "exclusive by the contract above")]
    pub unsafe fn part(&self, range: std::ops::Range<usize>) -> &mut [T] {
        assert!(range.start <= range.end && range.end <= self.len);
        // SAFETY: in bounds; exclusive by the caller's promise.
        unsafe { std::slice::from_raw_parts_mut(self.at.add(range.start), range.len()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_is_dealt_once_in_every_phase() {
        for threads in [1, 2, 3] {
            let mut pool = Pool::new(threads);
            let counts: Vec<AtomicUsize> = (0..57).map(|_| AtomicUsize::new(0)).collect();
            for round in 1..50 {
                pool.run(&|team: &Team| {
                    for _ in 0..10 {
                        team.claim(counts.len(), |i| {
                            counts[i].fetch_add(1, Ordering::Relaxed);
                        });
                        team.barrier();
                    }
                });
                assert!(counts.iter().all(|c| c.load(Ordering::Relaxed) == 10 * round), "{threads} threads");
            }
        }
    }
}
