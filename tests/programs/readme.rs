//! Every command of the README works as it is typed, from a fresh clone.
#![allow(clippy::unwrap_used)]

use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A node runs until it is told to end, and a study for hours: they have started well if they still run after this.
const ENOUGH: Duration = Duration::from_secs(4);
/// Exit codes of a command that isn't one, or is used wrongly.
const WRONG: [i32; 4] = [1, 2, 126, 127];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Blocks of shell, then the first column of the table of commands, placeholders filled in.
fn commands(readme: &str) -> Vec<String> {
    let blocks = readme.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap().to_owned());
    let rows = readme.lines().filter_map(|line| line.strip_prefix("| `needle_twin ")?.split('`').next());
    let filled = |row: &str| {
        format!("needle_twin {row}").replace("DIR", "out").replace("--scene S ", "--scene needle_insertion ")
    };
    blocks.chain(rows.map(filled)).collect()
}

/// A clone that is built: what is in the repository, and programs where `cargo build --release` puts them. `cargo` itself is a
/// stand-in that runs what it would have built.
fn clone(folder: &Path) -> PathBuf {
    // what a command leaves is in the list of what git ignores: a user's own results are not to be written over
    let ignored = std::fs::read_to_string(root().join(".gitignore")).unwrap();
    let is_ignored = |name: &str| ignored.lines().any(|line| line.trim_matches('/') == name);
    for entry in std::fs::read_dir(root()).unwrap().map(|entry| entry.unwrap()) {
        if !is_ignored(&entry.file_name().to_string_lossy()) {
            symlink(entry.path(), folder.join(entry.file_name())).unwrap();
        }
    }
    let programs = Path::new(env!("CARGO_BIN_EXE_needle_twin")).parent().unwrap();
    std::fs::create_dir(folder.join("target")).unwrap();
    symlink(programs, folder.join("target/release")).unwrap();
    let stand_in = folder.join("stand_in");
    std::fs::create_dir(&stand_in).unwrap();
    let cargo = stand_in.join("cargo");
    let script = format!("#!/bin/sh\n[ \"$1\" = run ] || exit 0\nexec {}\n", env!("CARGO_BIN_EXE_needle_twin"));
    std::fs::write(&cargo, script).unwrap();
    std::fs::set_permissions(&cargo, std::fs::Permissions::from_mode(0o755)).unwrap();
    stand_in
}

/// Exit code and diagnostics; `None` as a code where it still ran and was told to end.
fn run(text: &str, clone: &Path, path: &str) -> (Option<i32>, String) {
    let log = clone.join("said.log");
    let mut child = Command::new("bash")
        .args(["-euc", text])
        .current_dir(clone)
        .env("PATH", path)
        .env("ROS_LOCALHOST_ONLY", "1")
        .env("ROS_DOMAIN_ID", (std::process::id() % 100).to_string())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&log).unwrap())
        .process_group(0)
        .spawn()
        .unwrap();
    let begun = Instant::now();
    let group = libc::pid_t::try_from(child.id()).unwrap();
    let mut code = None;
    while begun.elapsed() < ENOUGH {
        if let Some(status) = child.try_wait().unwrap() {
            code = status.code();
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    // what a command has started goes with it
    for signal in [libc::SIGINT, libc::SIGKILL] {
        // SAFETY: a plain system call on the process group made above
        unsafe { libc::kill(-group, signal) };
        let asked = Instant::now();
        while signal == libc::SIGINT && asked.elapsed() < ENOUGH && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    child.wait().unwrap();
    (code, std::fs::read_to_string(&log).unwrap())
}

#[test]
fn every_command_of_the_readme_works_as_it_is_typed() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let stand_in = clone(folder.path());
    let mut path = format!("{}:/usr/local/bin:/usr/bin:/bin", stand_in.display());
    let commands = commands(&readme);
    assert!(commands.len() >= 9, "{commands:#?}");
    for text in commands {
        if let Some(more) = text.lines().find_map(|line| line.strip_prefix("export PATH=\"$PWD/")) {
            // what one block sets, the next one has
            path = format!("{}/{}:{path}", folder.path().display(), more.split(':').next().unwrap());
        }
        let (code, said) = run(&text, folder.path(), &path);
        println!("{code:?}  {}", text.trim());
        assert!(!code.is_some_and(|code| WRONG.contains(&code)), "{text}: exit code {code:?}\n{said}");
    }
}
