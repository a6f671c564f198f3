//! SIGINT, SIGTERM and SIGHUP as something to wait for, and every other signal kept away from the middleware's threads.
//!
//! RustDDS ends both its event loops for good when a poll of theirs is interrupted, and then the process neither
//! receives nor sends while `publish` keeps returning Ok. Blocking all signals before the participant is built (its threads
//! inherit the mask) keeps handled signals and Ctrl-Z away from them.

use std::os::fd::AsFd;
use std::time::Duration;

use nix::sys::signal::SigSet;
use nix::sys::signal::Signal::{SIGABRT, SIGBUS, SIGFPE, SIGHUP, SIGILL, SIGINT, SIGSEGV, SIGTERM, SIGTRAP};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Why the process asked itself to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// SIGINT: Ctrl-C, or `ros2 launch` stopping.
    Interrupt,
    /// SIGTERM.
    Terminate,
    /// SIGHUP: the terminal is gone.
    Hangup,
}

/// The process's signals, blocked in the calling thread and in every thread that it starts afterwards.
#[derive(Debug)]
pub struct Signals {
    /// Readable when SIGINT, SIGTERM or SIGHUP is pending.
    asked: SignalFd,
}

impl Signals {
    /// Blocks all signals that can be blocked. Call it first of all, in the main thread.
    ///
    /// # Errors
    /// The error of `pthread_sigmask` or of `signalfd`.
    pub fn block() -> std::io::Result<Self> {
        let mut all = SigSet::all();
        // Faults of the program itself must end it.
        [SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP].into_iter().for_each(|fault| all.remove(fault));
        all.thread_block()?;
        let mut asked: SigSet = [SIGINT, SIGTERM].into_iter().collect();
        // one that is blocked is pending even if it is ignored
        if !terminal::hangup_is_ignored() {
            asked.add(SIGHUP);
        }
        Ok(Self { asked: SignalFd::with_flags(&asked, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC)? })
    }

    /// Waits for SIGINT, SIGTERM or SIGHUP, at most so long.
    #[must_use]
    pub fn wait(&self, timeout: Duration) -> Option<Signal> {
        let fd = self.asked.as_fd();
        // Interrupted or not: what is pending is read. A timeout beyond what the system counts is for ever.
        let _ = poll(&mut [PollFd::from_borrowed_fd(fd, PollFlags::IN)], Timespec::try_from(timeout).ok().as_ref());
        match self.asked.read_signal() {
            Ok(Some(signal)) if signal.ssi_signo == SIGINT as u32 => Some(Signal::Interrupt),
            Ok(Some(signal)) if signal.ssi_signo == SIGHUP as u32 => Some(Signal::Hangup),
            Ok(Some(_)) => Some(Signal::Terminate),
            _ => None,
        }
    }
}
