//! Long work without Python's lock, with Ctrl-C heard.

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use needle_estimate::compare::Cancel;
use pyo3::prelude::*;

use crate::error::NeedleTwinError;

/// How often signals are looked at: seldom enough to cost nothing, often enough for a user who waits.
const INTERVAL: Duration = Duration::from_millis(50);

/// Does long work in a pool of so many threads (0: one per core) without Python's lock. Only Python's main thread hears
/// signals, so the caller's thread waits for them while another works.
///
/// # Errors
/// What a signal's handler raised (`KeyboardInterrupt`); the work has ended then, and its result is dropped.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce(&mut Cancel) -> T + Send,
) -> PyResult<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| NeedleTwinError::new_err(format!("threads = {threads}: {e}; ask for fewer")))?;
    let cancel = Cancel::default();
    py.detach(|| {
        thread::scope(|scope| {
            let (done, wait) = sync_channel::<()>(1);
            let worker = scope.spawn(|| {
                let result = pool.install(|| work(&mut cancel.clone()));
                drop(done);
                result
            });
            let mut raised = Ok(());
            while wait.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                if raised.is_ok() {
                    raised = Python::attach(|py| py.check_signals());
                    if raised.is_err() {
                        cancel.cancel();
                    }
                }
            }
            let result: Result<T, _> = worker.join();
            raised.map(|()| result.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        })
    })
}
