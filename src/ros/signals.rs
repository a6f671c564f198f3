//! SIGINT and SIGTERM as something to wait for, and every other signal kept away from the middleware's threads.
//!
//! RustDDS ends both its event loops for good when a poll of theirs is interrupted, and then the process lives on deaf
//! and mute while `publish` keeps returning Ok. Blocking all signals before the participant is built (its threads
//! inherit the mask) keeps handled signals and Ctrl-Z away from them.

use std::time::Duration;

/// Why the process asked itself to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// SIGINT: Ctrl-C, or `ros2 launch` stopping.
    Interrupt,
    /// SIGTERM.
    Terminate,
}

/// The process's signals, blocked in the calling thread and in every thread that it starts afterwards.
#[derive(Debug)]
pub struct Signals {
    set: libc::sigset_t,
}

impl Signals {
    /// Blocks all signals that can be blocked. Call it first of all, in the main thread.
    ///
    /// # Errors
    /// The error of `pthread_sigmask`.
    pub fn block() -> std::io::Result<Self> {
        // SAFETY: both sets are plain data that the sig*set calls initialise before anything reads them.
        unsafe {
            let mut all: libc::sigset_t = std::mem::zeroed();
            libc::sigfillset(&raw mut all);
            // Faults of the program itself must end it.
            for fault in [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT, libc::SIGTRAP] {
                libc::sigdelset(&raw mut all, fault);
            }
            let code = libc::pthread_sigmask(libc::SIG_BLOCK, &raw const all, std::ptr::null_mut());
            if code != 0 {
                return Err(std::io::Error::from_raw_os_error(code));
            }
            let mut set: libc::sigset_t = std::mem::zeroed();
            libc::sigemptyset(&raw mut set);
            libc::sigaddset(&raw mut set, libc::SIGINT);
            libc::sigaddset(&raw mut set, libc::SIGTERM);
            Ok(Self { set })
        }
    }

    /// Waits for SIGINT or SIGTERM, at most so long.
    #[must_use]
    pub fn wait(&self, timeout: Duration) -> Option<Signal> {
        let timeout = libc::timespec {
            tv_sec: libc::time_t::try_from(timeout.as_secs()).unwrap_or(libc::time_t::MAX),
            tv_nsec: i64::from(timeout.subsec_nanos()),
        };
        // SAFETY: the set was initialised by `block`, the timespec is valid, and no siginfo is asked for.
        match unsafe { libc::sigtimedwait(&raw const self.set, std::ptr::null_mut(), &raw const timeout) } {
            libc::SIGINT => Some(Signal::Interrupt),
            libc::SIGTERM => Some(Signal::Terminate),
            _ => None,
        }
    }
}
