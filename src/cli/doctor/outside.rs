//! Another program's answer, if it comes in time.

use std::io::Read as _;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// For how long an answer is waited for.
const PATIENCE: Duration = Duration::from_secs(2);

/// What a program of the system prints; none if it is not there, fails, or takes too long.
pub(super) fn answer(program: &str, arguments: &[&str]) -> Option<String> {
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    let deadline = Instant::now() + PATIENCE;
    let status = loop {
        match child.try_wait().ok()? {
            Some(status) => break status,
            None if Instant::now() < deadline => sleep(Duration::from_millis(5)),
            None => {
                let _ = child.kill(); // it may just have ended
                let _ = child.wait();
                return None;
            }
        }
    };
    // a line or two, which the pipe has held
    let mut text = String::new();
    child.stdout.take()?.read_to_string(&mut text).ok()?;
    status.success().then(|| text.trim().to_owned())
}
