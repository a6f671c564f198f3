//! One thread of a process stands still, as if it hung, while the others go on.

use nix::errno::Errno;
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;

/// A thread of a child process that stands still until this is dropped, by the thread that made it.
pub(super) struct Hung(Pid);

impl Hung {
    /// Stops the thread with a name.
    ///
    /// # Errors
    /// There is none of that name, or the system does not let a program trace its children.
    pub fn new(process: rustix::process::Pid, name: &str) -> Result<Self, String> {
        let fail = |error: Errno| format!("thread {name} can't be stopped: {error} (ptrace is not allowed here?)");
        let thread = thread(process, name).ok_or_else(|| format!("there is no thread {name}"))?;
        ptrace::seize(thread, ptrace::Options::empty()).map_err(fail)?;
        ptrace::interrupt(thread).map_err(fail)?;
        waitpid(thread, Some(WaitPidFlag::__WALL)).map_err(fail)?;
        Ok(Self(thread))
    }
}

impl Drop for Hung {
    fn drop(&mut self) {
        if ptrace::detach(self.0, None).is_err() {
            // its process has ended: nobody else may wait for a thread that is traced
            let _ = waitpid(self.0, Some(WaitPidFlag::__WALL | WaitPidFlag::WNOHANG));
        }
    }
}

fn thread(process: rustix::process::Pid, name: &str) -> Option<Pid> {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", process.as_raw_nonzero())).ok()?;
    let mut tasks = tasks.flatten();
    let is_it =
        |path: &std::path::Path| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name);
    let task = tasks.find(|task| is_it(&task.path()))?;
    task.file_name().to_str()?.parse().ok().map(Pid::from_raw)
}
