//! The twin as a sensor of ros2_control: its logic, and its plugin with stand-ins for ROS, compiled and run. ROS itself is
//! not here.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;
use std::process::Command;
use testkit::python;

/// Compiles a test with the system's C++ compiler and runs it.
fn sound(file: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    let mut compiler = Command::new("c++");
    compiler.args(["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-pthread"]);
    compiler.arg("-I").arg(root.join("ros2_control/include")).arg("-I").arg(root.join("tests/ros2_control/stubs"));
    compiler.arg(root.join("tests/ros2_control").join(file)).arg("-o").arg(&program);
    python::run(&mut compiler, "Debian: g++");
    let said = python::run(&mut Command::new(&program), file).stdout;
    assert_eq!(String::from_utf8_lossy(&said), "sound\n");
}

#[test]
fn a_control_loop_sees_no_stale_force_and_never_a_false_yes() {
    sound("latest_test.cpp");
}

#[test]
fn the_plugin_does_as_much_in_the_hands_of_a_controller_manager() {
    sound("sensor_test.cpp");
}
