//! Contract of `doctor`: rows with verdicts and advice, exit codes, and a bundle that names nobody.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::io::{Cursor, Read as _};
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use ros2_node::environment::free_domain;
use serde_json::Value;

fn doctor(arguments: &[&str], variables: &[(&str, &str)], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    let ros = ["ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "RMW_IMPLEMENTATION", "CYCLONEDDS_URI"];
    for name in ros {
        command.env_remove(name);
    }
    command.arg("doctor").args(arguments).current_dir(folder);
    command.env("ROS_DOMAIN_ID", free_domain().unwrap().to_string()).envs(variables.iter().copied());
    command.output().unwrap()
}

/// The findings, and whether the exit code says what they say.
fn findings(arguments: &[&str], variables: &[(&str, &str)]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let output = doctor(&[&["--json"], arguments].concat(), variables, folder.path());
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let code = if found["verdict"] == "problem" { 3 } else { 0 };
    assert_eq!(output.status.code(), Some(code), "{found:#}");
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    found
}

fn rows(found: &Value) -> Vec<&Value> {
    found["groups"].as_array().unwrap().iter().flat_map(|group| group["rows"].as_array().unwrap()).collect()
}

fn row<'a>(found: &'a Value, name: &str) -> &'a Value {
    rows(found).into_iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("{name}: {found:#}"))
}

#[test]
fn every_subject_has_rows_and_whatever_is_not_well_has_advice() {
    let found = findings(&[], &[]);
    let subjects: Vec<_> = found["groups"].as_array().unwrap().iter().map(|g| g["subject"].as_str().unwrap()).collect();
    let all =
        ["program", "processor", "scheduling", "folders", "clock", "ROS environment", "network", "domain", "ports"];
    assert_eq!(subjects, all);
    for row in rows(&found) {
        let advice = row["advice"].as_str();
        assert_eq!(advice.is_none(), row["verdict"] == "ok", "{row}");
        assert!(advice.is_none_or(|text| text.ends_with('.') && text.split_whitespace().count() <= 40), "{row}");
    }
    assert!(row(&found, "version")["value"].as_str().unwrap().contains(env!("CARGO_PKG_VERSION")));
    let build = row(&found, "build")["value"].as_str().unwrap();
    assert!(build.contains("rustc 1.") && build.contains("ros, page"), "{build}");
    assert!(row(&found, "speed")["value"].as_str().unwrap().contains("times real time"));
    assert_eq!(row(&found, "other nodes")["value"], "no other program on this domain");
}

#[test]
fn a_wrong_domain_is_a_problem_and_the_rest_is_still_said() {
    let found = findings(&[], &[("ROS_DOMAIN_ID", "999")]);
    assert_eq!(row(&found, "ROS_DOMAIN_ID")["verdict"], "problem");
    assert!(row(&found, "ROS_DOMAIN_ID")["advice"].as_str().unwrap().contains("0 to 232"));
    assert!(row(&found, "port of the live page").is_object() && row(&found, "interfaces").is_object());
}

#[test]
fn variables_that_do_not_work_are_said() {
    let middleware = [("RMW_IMPLEMENTATION", "rmw_connextdds"), ("ROS_STATIC_PEERS", "robot")];
    let found = findings(&[], &middleware);
    assert_eq!(row(&found, "RMW_IMPLEMENTATION")["verdict"], "problem");
    assert_eq!(row(&found, "ROS_STATIC_PEERS")["verdict"], "note");
}

#[test]
fn a_port_that_is_taken_is_said_with_the_parameter_that_helps() {
    // if another program has it, it is taken as well
    let _taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 18944));
    let found = findings(&[], &[]);
    let row = row(&found, "port of OpenIGTLink");
    assert_eq!(row["verdict"], "note");
    assert!(row["value"].as_str().unwrap().contains("18944 is taken"), "{row}");
    assert!(row["advice"].as_str().unwrap().contains("openigtlink_port"), "{row}");
}

#[test]
fn nodes_and_topics_of_the_domain_are_heard() {
    let domain = free_domain().unwrap().to_string();
    let bag = Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/needle_insertion");
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Command::new(env!("CARGO_BIN_EXE_rig_node"))
        .arg(bag)
        .args(["--ros-args", "-p", "start_paused:=true", "-r", "__ns:=/or1"])
        .env("ROS_DOMAIN_ID", &domain)
        .current_dir(folder.path())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_secs(2));
    let found = findings(&[], &[("ROS_DOMAIN_ID", &domain)]);
    rig.kill().unwrap();
    rig.wait().unwrap();
    assert!(row(&found, "other nodes")["value"].as_str().unwrap().contains("/or1/rig"), "{found:#}");
    assert!(row(&found, "input measured_js")["value"].as_str().unwrap().contains("/or1/measured_js"), "{found:#}");
    assert_eq!(row(&found, &format!("ports of domain {domain}"))["verdict"], "ok");
}

/// Files of a zip by name.
fn unpacked(bytes: Vec<u8>) -> Vec<(String, String)> {
    let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let read = |at: usize| {
        let mut file = zip.by_index(at).unwrap();
        let mut text = String::new();
        file.read_to_string(&mut text).unwrap();
        (file.name().to_owned(), text)
    };
    (0..5).map(read).collect()
}

/// Whether a word stands in a text, and not as a part of a longer one.
fn stands_in(word: &str, text: &str) -> bool {
    let of_word = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        let after = text[at + word.len()..].chars().next();
        !text[..at].chars().next_back().is_some_and(of_word) && !after.is_some_and(of_word)
    })
}

#[test]
fn the_bundle_has_what_a_report_needs_and_names_nobody() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("ada.byron");
    fs::create_dir(&folder).unwrap();
    let secret = [
        ("USER", "ada.byron"),
        ("LOGNAME", "ada.byron"),
        ("HOME", home.path().to_str().unwrap()),
        ("HOSTNAME", "lab-7"),
        ("ROS_LOG_DIR", folder.to_str().unwrap()),
        ("ROS_STATIC_PEERS", "robot-of-charles;10.1.2.3"),
        ("CYCLONEDDS_URI", "<Peer address=\"robot-of-charles\"/>"),
        ("ROS_DISTRO", "jazzy"),
    ];
    let output = doctor(&["--bundle", "report.zip"], &secret, &folder);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(matches!(output.status.code(), Some(0 | 3)) && said.contains("report.zip"), "{said}");
    let files = unpacked(fs::read(folder.join("report.zip")).unwrap());
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["README.txt", "doctor.txt", "doctor.json", "version.txt", "environment.txt"]);
    let of = |name: &str| &files.iter().find(|(file, _)| file == name).unwrap().1;
    assert!(of("README.txt").contains("are replaced by"));
    assert!(
        of("doctor.txt").contains("times real time") && of("doctor.txt").contains("~/<user>"),
        "{}",
        of("doctor.txt")
    );
    assert!(serde_json::from_str::<Value>(of("doctor.json")).unwrap()["groups"].is_array());
    assert_eq!(*of("version.txt"), format!("needle_twin {}\n", env!("CARGO_PKG_VERSION")));
    let environment = of("environment.txt");
    assert!(
        environment.contains("ROS_DISTRO=jazzy\n") && environment.contains("ROS_STATIC_PEERS (set"),
        "{environment}"
    );

    let trimmed = |path: &str| fs::read_to_string(path).ok().map(|text| text.trim().to_owned());
    let hardware =
        fs::read_dir("/sys/class/net").unwrap().flatten().filter_map(|e| trimmed(e.path().join("address").to_str()?));
    let hardware = hardware.filter(|address| !address.is_empty() && !address.starts_with("00:00:00"));
    // no datagram is sent: the system says from which address it would go
    let own = UdpSocket::bind("0.0.0.0:0").and_then(|s| s.connect("192.0.2.1:9").and_then(|()| s.local_addr()));
    let own = own.ok().filter(|address| !address.ip().is_loopback()).map(|address| address.ip().to_string());
    let host = trimmed("/proc/sys/kernel/hostname").filter(|name| name != "localhost");
    let given =
        ["ada.byron", "lab-7", "robot-of-charles", "10.1.2.3", home.path().to_str().unwrap()].map(str::to_owned);
    for personal in given.into_iter().chain(hardware).chain(own).chain(host) {
        for (name, text) in &files {
            assert!(!stands_in(&personal, text), "{personal} in {name}:\n{text}");
        }
    }
}

#[test]
fn a_bundle_that_cannot_be_written_is_a_failure_that_names_the_option() {
    let folder = tempfile::tempdir().unwrap();
    let output = doctor(&["--bundle", "no/such/folder.zip"], &[], folder.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("--bundle"));
}
