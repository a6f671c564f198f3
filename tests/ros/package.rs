//! What the ROS 2 package installs: files that others can parse and that say the same as the programs.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};

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
fn the_unit_of_systemd_is_sound_and_gives_little_away() {
    let unit = std::fs::read_to_string(checkout().join("launch-scripts/systemd/needle-twin@.service")).unwrap();
    // what keeps the sockets to this machine needs it
    assert!(unit.contains("\nSystemCallFilter=@system-service pidfd_getfd\n"), "{unit}");
    let folder = tempfile::tempdir().unwrap();
    let (program, parameters) = ("/usr/local/bin/needle_twin", "/etc/needle_twin/%i.yaml");
    let start = unit.lines().find_map(|line| line.strip_prefix("ExecStart=")).unwrap();
    let words: Vec<&str> = start.split(' ').collect();
    assert_eq!((words[0], words.contains(&parameters)), (program, true), "{start}");
    // its command starts the node that its comments promise
    let twin = checkout().join("launch-scripts/parameters/twin.yaml").display().to_string();
    let arguments = words[1..].iter().map(|word| if *word == parameters { &twin } else { *word });
    let arguments: Vec<&str> =
        arguments.filter(|word| !word.starts_with('$')).chain(["-p", "autostart:=false"]).collect();
    let node = Program::start(NEEDLE_TWIN, &arguments, free_domain(), &[]);
    std::thread::sleep(Duration::from_millis(1200));
    assert_eq!(node.stop("INT").0, Some(0));
    let here = folder.path().join("needle-twin@lab.service");
    std::fs::write(&here, unit.replace(program, NEEDLE_TWIN)).unwrap();
    let analyze = |arguments: &[&str]| {
        let output = std::process::Command::new("systemd-analyze").args(arguments).arg(&here).output();
        output.map(|o| (o.status.success(), String::from_utf8_lossy(&[o.stdout, o.stderr].concat()).into_owned()))
    };
    let Ok(verified) = analyze(&["verify", "--man=no"]) else {
        eprintln!("not tried: no systemd-analyze (Debian: systemd)");
        return;
    };
    assert_eq!(verified, (true, String::new()));
    // 10 is a service with every right; since systemd 250 it can be told of a file
    let (kept, said) = analyze(&["security", "--offline=true", "--threshold=20"]).unwrap();
    assert!(kept || said.contains("unrecognized option"), "{said}");
}

/// The parameters of each node in a launch file in YAML as launch hands them over: what is written in quotes stays a
/// string, and what holds a variable has the type of what the variable says.
fn launched(file: &str) -> Vec<(String, Vec<PathBuf>, Value)> {
    let text = std::fs::read_to_string(checkout().join("launch-scripts").join(file)).unwrap();
    let actions: Value = serde_saphyr::from_str(&text).unwrap();
    let actions: Vec<Value> = actions["launch"].as_array().unwrap().clone();
    let defaults: Vec<(String, String)> = actions
        .iter()
        .filter_map(|a| a.get("arg"))
        .map(|a| (format!("$(var {})", a["name"].as_str().unwrap()), text_of(&a["default"])))
        .collect();
    let share = |folder: &str| checkout().join(folder).display().to_string();
    let evaluate = |value: &Value| {
        let Some(text) = value.as_str().filter(|t| t.contains("$(")) else { return value.clone() };
        let filled = defaults.iter().fold(text.to_owned(), |t, (variable, default)| t.replace(variable, default));
        let filled = filled.replace("$(find-pkg-share needle_twin)/parameters", &share("launch-scripts/parameters"));
        let filled = filled.replace("$(find-pkg-share needle_twin)/bags", &share("bags"));
        serde_saphyr::from_str(&filled).unwrap()
    };
    let nodes = actions.iter().filter_map(|a| a.get("node"));
    let parameters = |node: &Value| {
        let given: Vec<&Value> = node["param"].as_array().unwrap().iter().collect();
        let files = given.iter().filter_map(|p| p.get("from")).map(|f| evaluate(f).as_str().unwrap().into()).collect();
        let values = given.iter().filter(|p| p.get("from").is_none());
        let values = values.map(|p| (p["name"].as_str().unwrap().to_owned(), evaluate(&p["value"]))).collect();
        (node["exec"].as_str().unwrap().to_owned(), files, Value::Object(values))
    };
    nodes.map(parameters).collect()
}

/// A scalar as it is written.
fn text_of(value: impl ToString) -> String {
    value.to_string().trim_matches('"').to_owned()
}

#[test]
fn values_in_launch_files_have_the_types_that_the_nodes_declare() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["twin.launch.yaml", "rig_and_twin.launch.yaml"] {
        for (exec, files, values) in launched(file) {
            let path = folder.path().join("given.yaml");
            std::fs::write(&path, json!({"/**": {"ros__parameters": values}}).to_string()).unwrap();
            let program = if exec == "twin_node" { TWIN } else { RIG };
            let mut arguments = vec!["--ros-args".to_owned()];
            for file in files.iter().chain([&path]) {
                arguments.extend(["--params-file".to_owned(), file.display().to_string()]);
            }
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            let node = Program::start(program, &arguments, free_domain(), &[]);
            std::thread::sleep(Duration::from_millis(1200));
            let (code, log, _) = node.stop("INT");
            assert_eq!(code, Some(0), "{file}: {exec} with {values}: {log}");
        }
    }
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
