//! Threads with names.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

use std::io;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// The system has no thread left.
#[derive(Debug, thiserror::Error)]
#[error("the {name} thread can't be started: {source}")]
pub struct ThreadError {
    /// What it was for.
    name: String,
    /// What the system says.
    source: io::Error,
}

/// Starts a thread.
///
/// # Errors
/// [`ThreadError`] if the system has none left.
pub fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, ThreadError> {
    thread::Builder::new()
        .name(name.to_owned())
        .spawn(body)
        .map_err(|source| ThreadError { name: name.to_owned(), source })
}

/// Waits for the end of a thread and says if it was a panic.
pub fn join(thread: JoinHandle<()>) {
    let name = thread.thread().name().unwrap_or("?").to_owned();
    if thread.join().is_err() {
        tracing::error!("the {name} thread has panicked");
    }
}

/// Waits for the end of a thread until `deadline`; false if it has not come, and the thread is left to itself.
#[must_use]
pub fn join_before(thread: JoinHandle<()>, deadline: Instant) -> bool {
    while !thread.is_finished() {
        if Instant::now() >= deadline {
            tracing::warn!("the {} thread is still busy and is left behind", thread.thread().name().unwrap_or("?"));
            return false;
        }
        thread::sleep(Duration::from_millis(1));
    }
    join(thread);
    true
}

/// Lets the other threads of the machine go first. Where the system does not know priorities of threads, nothing
/// changes.
pub fn lower_priority() {
    #[cfg(target_os = "linux")]
    // On Linux no process means the calling thread. It fails only if it would raise the priority.
    let _ = rustix::process::setpriority_process(None, 3);
}
