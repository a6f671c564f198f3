//! Notices when the middleware has died under the node.
//!
//! RustDDS ends its event loops for good when a poll of theirs is interrupted, as by SIGSTOP and SIGCONT or a debugger
//! that attaches; no signal mask keeps those away. The process would live on deaf and mute while `publish` returns Ok.
//! Nothing in the middleware says so, but its threads are gone, which Linux shows.

use std::time::{Duration, Instant};

/// Time between two looks.
const INTERVAL: Duration = Duration::from_secs(1);
/// How the middleware's threads are called.
#[cfg(target_os = "linux")]
const THREADS: &str = "RustDDS";

/// See the module. Where the system does not show its threads, it never notices anything.
#[derive(Debug)]
pub(super) struct Watchdog {
    threads: usize,
    due: Instant,
}

impl Watchdog {
    /// After the participant was made.
    pub fn new() -> Self {
        Self { threads: threads(), due: Instant::now() + INTERVAL }
    }

    /// Looks, at most once a second. Once the threads are gone they stay gone.
    ///
    /// # Errors
    /// What has happened and what to do, if the node is deaf.
    pub fn check(&mut self) -> Result<(), String> {
        if Instant::now() < self.due {
            return Ok(());
        }
        self.due = Instant::now() + INTERVAL;
        let threads = threads();
        self.threads = self.threads.max(threads);
        if threads < self.threads {
            return Err(
                "the DDS threads have ended, so nothing is heard or said any more (the process was stopped by \
                        SIGSTOP or a debugger, or the middleware has failed): start the node again"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

#[cfg(target_os = "linux")]
fn threads() -> usize {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0 };
    let name = |task: std::fs::DirEntry| std::fs::read_to_string(task.path().join("comm")).unwrap_or_default();
    tasks.flatten().map(name).filter(|name| name.starts_with(THREADS)).count()
}

#[cfg(not(target_os = "linux"))]
fn threads() -> usize {
    0
}
