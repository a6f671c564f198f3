//! Contract: what a user or a network can lengthen costs time by its length, not by the square of it.
//!
//! Eight times as much may take at most [`MOST`] times as long on the processor: a square would take 64 times, and what other
//! programs of the machine do has no part in it.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use ros2_messages::std_msgs::Bool;
use rosbag2_mcap::{BagWriter, Qos, WriterOptions};
use tempfile::TempDir;

/// How many times as much.
const TIMES: usize = 8;
/// See the module.
const MOST: f64 = 24.0;
/// What any program takes, s.
const LEAST: f64 = 0.02;

/// Time of a run of the program on the processor, s.
// `wait4` waits for it, and says what it took.
#[allow(clippy::zombie_processes)]
fn spent(arguments: &[&str]) -> f64 {
    let child = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    // SAFETY: both are ours, and a `rusage` of zeros is one.
    let (status, usage) = unsafe {
        let (mut status, mut usage) = (0, std::mem::zeroed::<libc::rusage>());
        assert!(libc::wait4(child.id() as libc::pid_t, &raw mut status, 0, &raw mut usage) > 0);
        (status, usage)
    };
    assert!(libc::WIFEXITED(status) && [0, 3].contains(&libc::WEXITSTATUS(status)), "{arguments:?}: {status}");
    let seconds = |t: libc::timeval| t.tv_sec as f64 + 1e-6 * t.tv_usec as f64;
    seconds(usage.ru_utime) + seconds(usage.ru_stime)
}

/// Runs the program on what `make` has made for a number, and for eight times that.
fn grows(what: &str, number: usize, make: impl Fn(&Path, usize) -> Vec<String>) {
    let run = |number: usize| {
        let folder = TempDir::new().unwrap();
        let arguments = make(folder.path(), number);
        spent(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let (few, many) = (run(number), run(TIMES * number));
    println!("{what}: {number} in {few:.3} s, {TIMES} times as many in {many:.3} s");
    assert!(many < MOST * (few + LEAST), "{what}: {few} s, and {many} s for {TIMES} times as many");
}

fn words(arguments: &[&str]) -> Vec<String> {
    arguments.iter().map(ToString::to_string).collect()
}

fn bag(folder: &Path, topics: usize) -> String {
    let bag = folder.join("many");
    let mut writer = BagWriter::create(&bag, WriterOptions::default()).unwrap();
    for topic in 0..topics {
        writer.add_topic::<Bool>(&format!("/topic_{topic}"), &Qos::reliable(10)).unwrap();
    }
    writer.finish().unwrap();
    bag.join("many_0.mcap").to_str().unwrap().to_owned()
}

#[test]
fn topics_of_a_bag() {
    grows("bag info, topics", 8000, |folder, topics| words(&["bag", "info", &bag(folder, topics)]));
    grows("bag check, topics", 500, |folder, topics| words(&["bag", "check", &bag(folder, topics)]));
}

#[test]
fn targets_of_a_scene() {
    grows("scene check, targets", 1800, |folder, targets| {
        let mut text = shown(&[]);
        for target in 0..targets {
            writeln!(text, "[[targets]]\nname = \"t{target}\"\nposition_m = [{target}e-7, 0.0, 0.005]").unwrap();
        }
        let file = folder.join("many.toml");
        std::fs::write(&file, text).unwrap();
        words(&["scene", "check", file.to_str().unwrap()])
    });
}

#[test]
fn the_name_of_a_scene() {
    grows("solve --out, bytes of the name", 112_500, |folder, bytes| {
        let scene = shown(&["discretisation.spacing_m=0.006", "motion.depth_m=0.0002", "motion.pose_hz=50"]);
        let name = scene.lines().find(|line| line.starts_with("name = ")).unwrap();
        let file = folder.join("named.toml");
        std::fs::write(&file, scene.replacen(name, &format!("name = \"{}\"", "ab ".repeat(bytes / 3)), 1)).unwrap();
        let out = folder.join("out");
        words(&["solve", "--scene", file.to_str().unwrap(), "--out", out.to_str().unwrap()])
    });
}

/// A preset without targets as a file.
fn shown(changes: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    command.args(["scene", "show", "compression"]);
    for change in changes {
        command.args(["--set", change]);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}
