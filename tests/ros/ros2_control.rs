//! The twin as a sensor of ros2_control: its logic compiled and run, its plugin compiled against declarations of what it
//! uses. ROS itself is not here.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::Command;
use testkit::python;

fn checkout() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The system's C++ compiler, told where the headers are.
fn compiler(file: &str) -> Command {
    let mut compiler = Command::new("c++");
    compiler.args(["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-pthread"]);
    compiler.arg("-I").arg(checkout().join("ros2_control/include")).arg(checkout().join(file));
    compiler
}

#[test]
fn a_control_loop_sees_no_stale_force_and_never_a_false_yes() {
    let folder = tempfile::tempdir().unwrap();
    let program: PathBuf = folder.path().join("latest");
    python::run(compiler("tests/ros2_control/latest_test.cpp").arg("-o").arg(&program), "Debian: g++");
    let said = python::run(&mut Command::new(&program), "latest_test.cpp").stdout;
    assert_eq!(String::from_utf8_lossy(&said), "sound\n");
}

#[test]
fn the_plugin_compiles() {
    let stubs = checkout().join("tests/ros2_control/stubs");
    python::run(compiler("ros2_control/src/sensor.cpp").arg("-fsyntax-only").arg("-I").arg(stubs), "Debian: g++");
}
