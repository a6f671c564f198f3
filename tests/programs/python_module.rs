//! Contract of `crates/needle_twin_py`: one command makes a wheel, it installs in a fresh environment, and its own tests and the notebooks of
//! `examples/notebooks` run there.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::Command;

use testkit::python::{environment, run};

/// At the versions that were tried.
const PACKAGES: [&str; 8] = [
    "maturin==1.16.0",
    "numpy==2.4.6",
    "pytest==9.2.0",
    "gymnasium==1.4.0",
    "matplotlib==3.11.2",
    "ipykernel==7.4.0",
    "nbclient==0.11.0",
    "pandas==3.1.1",
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/needle_twin_py")
}

#[test]
fn a_wheel_is_built_installed_and_tested() {
    let python = environment("module-venv", &PACKAGES);
    let wheels = tempfile::tempdir().unwrap();
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let mut build = Command::new(&python);
    build.args(["-m", "maturin", "build", "--release", "--locked", "--out"]).arg(wheels.path());
    // the profile's own folder, so that nothing is built a second time
    run(build.current_dir(folder()).env("CARGO_TARGET_DIR", target), "maturin");
    let wheel = std::fs::read_dir(wheels.path()).unwrap().next().unwrap().unwrap().path();
    let name = wheel.file_name().unwrap().to_string_lossy().into_owned();
    assert!(name.contains("-cp310-abi3-"), "{name}: one wheel for every later Python");
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--force-reinstall"];
    run(Command::new(&python).args(install).arg(&wheel), "pip");
    let console = python.with_file_name("needle_twin_py");
    let version = run(Command::new(console).arg("--version"), "the console script");
    assert!(String::from_utf8_lossy(&version.stdout).contains(env!("CARGO_PKG_VERSION")), "{version:?}");
    let mut tests = Command::new(&python);
    tests.args(["-m", "pytest", "-q", "-p", "no:cacheprovider"]).arg(folder().join("tests"));
    // away from the sources, so that the installed package is what is tested
    let output = run(tests.current_dir(wheels.path()).env("PYTHONDONTWRITEBYTECODE", "1"), "pytest");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains(" passed") && !text.contains("skipped"), "{text}");
}
