//! Distributes many runs over worker threads. Each thread takes the next run that is not taken yet. The result of a
//! run does not depend on the thread or on the other runs.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::ThreadPoolBuildError;

use crate::compare::Cancel;

/// Worker threads, and a callback for progress.
pub struct Crew<'a> {
    /// Number of threads.
    pub threads: usize,
    /// Ends the runs.
    pub cancel: Cancel,
    /// Called after each run, by the thread that made it.
    pub done: &'a (dyn Fn() + Sync),
}

impl Crew<'_> {
    /// Does work 0, 1, ... and returns the results in this order. Each run uses one thread: rayon has no further
    /// threads inside it.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn each<T: Send>(
        &self,
        count: usize,
        work: impl Fn(usize) -> T + Sync,
    ) -> Result<Vec<T>, ThreadPoolBuildError> {
        let next = AtomicUsize::new(0);
        let one = |pool: rayon::ThreadPool| {
            let mut results = Vec::new();
            loop {
                let k = next.fetch_add(1, Ordering::Relaxed);
                if k >= count {
                    return results;
                }
                results.push((k, pool.install(|| work(k))));
                (self.done)();
            }
        };
        let pool = || rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pools = (0..self.threads.clamp(1, count.max(1))).map(|_| pool()).collect::<Result<Vec<_>, _>>()?;
        let mut all: Vec<(usize, T)> = std::thread::scope(|scope| {
            let crew: Vec<_> = pools.into_iter().map(|pool| scope.spawn(|| one(pool))).collect();
            crew.into_iter()
                .flat_map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
                .collect()
        });
        all.sort_unstable_by_key(|(k, _)| *k);
        Ok(all.into_iter().map(|(_, result)| result).collect())
    }
}
