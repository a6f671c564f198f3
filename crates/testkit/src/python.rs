//! A Python virtual environment under `target/`, made on first use and shared by all tests.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Independent implementations that tests compare with, at the versions that were tried.
const PACKAGES: [&str; 6] = [
    "rosbags==0.11.9",
    "mcap-ros2-support==0.6.0",
    "cyclonedds==11.0.1",
    "gmsh==4.15.2",
    "meshio==5.3.5",
    "numpy==2.4.6",
];

/// The environment's Python. Needs `python3` with venv, and the package index the first time.
pub fn python() -> PathBuf {
    environment("python-venv", &PACKAGES)
}

/// Python of an environment with these packages.
pub fn environment(name: &str, packages: &[&str]) -> PathBuf {
    let target = crate::profile().parent().unwrap().to_path_buf();
    let (folder, done) = (target.join(name), target.join(name).join("installed.txt"));
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    // Several test programs may come here at once.
    let lock = File::create(target.join(format!("{name}.lock"))).unwrap();
    lock.lock().unwrap();
    let wanted = packages.join("\n");
    if fs::read_to_string(&done).is_ok_and(|installed| installed == wanted) {
        return python;
    }
    let what =
        "these tests need Python 3 with venv (Debian: python3-venv) and, the first time, the Python package index";
    run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder), what);
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    run(Command::new(&python).args(pip).args(packages), what);
    fs::write(done, wanted).unwrap();
    python
}

/// Runs a script of the tree and gives what it printed.
pub fn run_script(script: &str, arguments: &[&Path]) -> String {
    let script = crate::root().join("tests").join(script);
    let output = run(Command::new(python()).arg(&script).args(arguments), &script.display().to_string());
    String::from_utf8(output.stdout).unwrap()
}

/// Runs a command to its end; panics with its output if it fails.
pub fn run(command: &mut Command, what: &str) -> Output {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}; {what}"));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{command:?} failed; {what}\n{out}\n{err}");
    output
}
