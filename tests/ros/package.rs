//! What the ROS 2 package installs: files that others can parse and that say the same as the programs.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::ros::{Program, TWIN, free_domain};

const RIG: &str = env!("CARGO_BIN_EXE_rig_node");
const NEEDLE_TWIN: &str = env!("CARGO_BIN_EXE_needle_twin");

fn checkout() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

#[test]
fn other_parsers_find_nothing_wrong() {
    assert_eq!(ros::python::run_script("peers/package.py", &[&checkout()]), "");
}

#[test]
fn parameter_files_fit_the_nodes() {
    let file = |name: &str| checkout().join("launch-scripts/parameters").join(name).display().to_string();
    let bag = checkout().join("bags/compression").display().to_string();
    let (twin, player, driver) = (file("twin.yaml"), file("rig_player.yaml"), file("rig_driver.yaml"));
    let guard = file("guard.yaml");
    let identify = file("identify.yaml");
    for (program, arguments) in [
        (TWIN, vec!["--ros-args", "-p", "autostart:=false", "--params-file", &identify]),
        (TWIN, vec!["--ros-args", "-p", "autostart:=false", "--params-file", &twin]),
        (RIG, vec![&bag, "--ros-args", "-p", "delay:=60.0", "--params-file", &player]),
        (RIG, vec!["--ros-args", "--params-file", &driver]),
        (NEEDLE_TWIN, vec!["guard", "--ros-args", "--params-file", &guard]),
    ] {
        let node = Program::start(program, &arguments, free_domain(), &[]);
        std::thread::sleep(Duration::from_millis(1200));
        let (code, log, _) = node.stop("INT");
        assert_eq!(code, Some(0), "{arguments:?}: {log}");
        assert!(!log.contains("WARN") && !log.contains("ERROR"), "{arguments:?}: {log}");
    }
    // Names of another recording: the file is right, the bag is not the one.
    let foreign = file("rig_foreign.yaml");
    let output = std::process::Command::new(RIG)
        .args([&bag, "--ros-args", "--params-file", &foreign])
        .env("ROS_DOMAIN_ID", free_domain().to_string())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && text.contains("position_topic"), "{text}");
}

#[test]
fn a_shell_script_starts_both_nodes_and_takes_both_down() {
    let script = checkout().join("launch-scripts/closed_loop.sh").display().to_string();
    let programs = Path::new(TWIN).parent().unwrap().display().to_string();
    let coarse = ["--scene", "compression", "--ros-args", "-p", "autostart:=false", "--"];
    let node =
        Program::start("sh", &[&[script.as_str()][..], &coarse].concat(), free_domain(), &[("PROGRAMS", &programs)]);
    std::thread::sleep(Duration::from_secs(2));
    // As Ctrl-C in a terminal: every process of the group is told. Here the script tells the rig when the twin has left.
    let twin = std::process::Command::new("pgrep").args(["-P", &node.id().to_string(), "twin_node"]).output().unwrap();
    let twin = String::from_utf8(twin.stdout).unwrap();
    assert!(std::process::Command::new("kill").args(["-INT", twin.trim()]).status().unwrap().success());
    // a busy machine takes its time
    std::thread::sleep(Duration::from_secs(4));
    let (code, log) = node.end();
    assert_eq!(code, Some(0), "{log}");
    assert_eq!(log.matches("stopping (Interrupt)").count(), 2, "{log}");
    assert!(log.contains("[rig]") && log.contains("[twin]"), "{log}");
}
