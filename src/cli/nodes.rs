//! Twin and rig as processes of their own: this same program, started again as a node.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use super::CliError;

/// Lines of a node's log that an error shows.
const TAIL: usize = 8;

/// A started node. It is killed if it is dropped while it runs.
pub(super) struct Node {
    name: &'static str,
    child: Child,
    log: PathBuf,
}

impl Node {
    /// Starts `needle_twin COMMAND ARGUMENTS...` in a domain of the loopback. Its log goes into a file.
    pub(crate) fn start(command: &'static str, arguments: &[&str], domain: u16, logs: &Path) -> Result<Self, CliError> {
        let log = logs.join(format!("{}.log", command.replace('-', "_")));
        let fail = |reason: String| CliError::Nodes(format!("{command} can't be started: {reason}"));
        // The built program itself: an installed twin_node beside it may be of another version.
        let program = std::env::current_exe().map_err(|e| fail(e.to_string()))?;
        let stderr = File::create(&log).map_err(|e| fail(format!("{}: {e}", log.display())))?;
        let mut process = Command::new(program);
        // What the user's shell says of ROS is meant for his own nodes, not for these two.
        for (name, _) in std::env::vars_os() {
            let name = name.to_string_lossy();
            if ["ROS_", "RMW_", "RCUTILS_"].iter().any(|prefix| name.starts_with(prefix)) {
                process.env_remove(&*name);
            }
        }
        let child = process
            .arg(command)
            .args(arguments)
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("ROS_LOCALHOST_ONLY", "1")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(stderr)
            .spawn()
            .map_err(|e| fail(e.to_string()))?;
        Ok(Self { name: command, child, log })
    }

    /// Its process.
    pub(crate) fn process(&self) -> Pid {
        Pid::from_child(&self.child)
    }

    /// Its middleware process, a child of its own.
    pub(crate) fn middleware(&self) -> Option<Pid> {
        let parent = self.child.id();
        let all = std::fs::read_dir("/proc").ok()?.flatten();
        let of_parent = |process: &i32| {
            let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
            let fields = stat.rsplit_once(") ").map(|(_, rest)| rest.split(' ').nth(1).unwrap_or_default().to_owned());
            fields.is_some_and(|id| id == parent.to_string())
        };
        all.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).find(of_parent).and_then(Pid::from_raw)
    }

    /// The exit status, if it has ended.
    pub(crate) fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// An error with the end of the node's log.
    pub(crate) fn failure(&self, what: &str) -> CliError {
        let text = std::fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        let tail = lines[lines.len().saturating_sub(TAIL)..].join("\n  ");
        CliError::Nodes(format!("{} {what}; the end of its log ({}):\n  {tail}", self.name, self.log.display()))
    }

    /// Asks it to stop as Ctrl-C does and waits; `None` if it had to be killed.
    pub(crate) fn stop(&mut self, patience: Duration) -> Option<ExitStatus> {
        if let Some(status) = self.ended() {
            return Some(status);
        }
        // The child has not been waited for, so the id is still its own.
        let _ = kill_process(Pid::from_child(&self.child), Signal::INT);
        let begun = Instant::now();
        while begun.elapsed() < patience {
            if let Some(status) = self.ended() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        if self.ended().is_none() {
            // Both fail only if it has just ended by itself.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}
