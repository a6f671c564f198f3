//! Threads with names.

use std::thread::{self, JoinHandle};

use super::start::NodeError;

/// Starts a thread.
///
/// # Errors
/// [`NodeError::Other`] if the system has none left.
pub(super) fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, NodeError> {
    thread::Builder::new()
        .name(name.to_owned())
        .spawn(body)
        .map_err(|e| NodeError::Other(format!("the {name} thread can't be started: {e}")))
}

/// Waits for the end of a thread and says if it was a panic.
pub(super) fn join(thread: JoinHandle<()>) {
    let name = thread.thread().name().unwrap_or("?").to_owned();
    if thread.join().is_err() {
        tracing::error!("the {name} thread has panicked");
    }
}

/// Lets the other threads of the machine go first. Where the system does not know priorities of threads, nothing
/// changes.
pub(super) fn lower_priority() {
    #[cfg(target_os = "linux")]
    // SAFETY: takes three integers; 0 is the calling thread, on Linux.
    unsafe {
        libc::setpriority(libc::PRIO_PROCESS, 0, 3);
    }
}
