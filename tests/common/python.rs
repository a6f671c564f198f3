//! A Python with pinned packages, made once under `target/`.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

/// Folder that holds the built programs' parent: `target`.
pub fn target_dir() -> PathBuf {
    // .../target/release/needle_twin
    PathBuf::from(env!("CARGO_BIN_EXE_needle_twin")).ancestors().nth(2).unwrap().to_owned()
}

/// Path of a Python interpreter that has `packages` (`name==version`). Made on first use; several tests may ask at once.
pub fn with_packages(name: &str, packages: &[&str]) -> PathBuf {
    let home = target_dir().join(format!("python-{name}"));
    let python = home.join("bin/python");
    let wanted = packages.join("\n");
    let stamp = home.join("packages.txt");
    let ready = || std::fs::read_to_string(&stamp).is_ok_and(|text| text == wanted);
    let lock = target_dir().join(format!("python-{name}.lock"));
    let begun = Instant::now();
    while !ready() {
        if std::fs::create_dir(&lock).is_err() {
            assert!(
                begun.elapsed() < Duration::from_secs(600),
                "{} is held by a test that died: remove it",
                lock.display()
            );
            std::thread::sleep(Duration::from_millis(200));
            continue;
        }
        if !ready() {
            run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&home));
            run(Command::new(&python)
                .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
                .args(packages));
            std::fs::write(&stamp, &wanted).unwrap();
        }
        std::fs::remove_dir(&lock).unwrap();
    }
    python
}

fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e} (the tests need Python 3 with venv)"));
    assert!(output.status.success(), "{command:?}:\n{}", String::from_utf8_lossy(&output.stderr));
}
