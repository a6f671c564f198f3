//! One thread of a process stands still, as if it hung, while the others go on: for tests and studies of faults.

use nix::errno::Errno;
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;

/// A thread of a child process that stands still until this is dropped, by the thread that made it.
pub struct Hung(Pid);

impl Hung {
    /// Stops the thread with a name.
    ///
    /// # Errors
    /// There is none of that name, or the system does not let a program trace its children.
    pub fn new(process: u32, name: &str) -> Result<Self, String> {
        let fail = |error: Errno| format!("thread {name} can't be stopped: {error} (ptrace is not allowed here?)");
        let thread = thread(process, name).ok_or_else(|| format!("there is no thread {name}"))?;
        ptrace::seize(thread, ptrace::Options::empty()).map_err(fail)?;
        ptrace::interrupt(thread).map_err(fail)?;
        waitpid(thread, Some(WaitPidFlag::__WALL)).map_err(fail)?;
        Ok(Self(thread))
    }

    /// Whether it has gone with its process.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        match waitpid(self.0, Some(WaitPidFlag::__WALL | WaitPidFlag::WNOHANG)) {
            Ok(status) => matches!(status, WaitStatus::Exited(..) | WaitStatus::Signaled(..)),
            Err(_) => true,
        }
    }
}

impl Drop for Hung {
    fn drop(&mut self) {
        if ptrace::detach(self.0, None).is_err() {
            // its process has ended, and is not gone before whoever traces the thread has waited for it
            let _ = self.has_ended();
        }
    }
}

fn thread(process: u32, name: &str) -> Option<Pid> {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).ok()?;
    let mut tasks = tasks.flatten();
    let is_it =
        |path: &std::path::Path| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name);
    let task = tasks.find(|task| is_it(&task.path()))?;
    task.file_name().to_str()?.parse().ok().map(Pid::from_raw)
}
