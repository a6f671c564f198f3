//! Fast DDS as it comes, on this machine, in the manner of rmw_fastrtps.
//!
//! Needs g++ and Fast DDS 2 (Debian: `libfastrtps-dev`); where they are not, the tests say so and are not tried.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::process::Command;
use std::sync::OnceLock;

use crate::ros::{coarse_twin, free_domain};

/// The caller, built once.
fn caller() -> Option<&'static str> {
    static BUILT: OnceLock<Option<String>> = OnceLock::new();
    BUILT
        .get_or_init(|| {
            let program = testkit::profile().join("fast_dds");
            let built = Command::new("g++")
                .args(["-std=c++17", "-O1", concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers/fast_dds.cpp"), "-o"])
                .arg(&program)
                .args(["-lfastrtps", "-lfastcdr", "-lpthread"])
                .output();
            let built = built.is_ok_and(|output| output.status.success());
            if !built {
                eprintln!("not tried: no g++ with Fast DDS (Debian: libfastrtps-dev)");
            }
            built.then(|| program.display().to_string())
        })
        .as_deref()
}

/// `ros2 param list`: no prefixes, depth 0.
pub const LIST: [&str; 3] =
    ["/twin/list_parameters", "rcl_interfaces::srv::dds_::ListParameters", "00000000000000000000000000000000"];

/// Calls of new clients, by a program that runs the command after its own arguments: seconds and bytes of each answer.
pub fn call(
    mut by: Command,
    domain: u16,
    [service, kind, request]: [&str; 3],
    calls: u32,
) -> Option<Vec<(f64, usize)>> {
    let arguments = [caller()?, &domain.to_string(), service, kind, request, &calls.to_string()];
    let output = by.args(arguments).output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    eprintln!("{service}:\n{said}");
    let answer = |line: &str| line.split_once(' ').map(|(s, bytes)| (s.parse().unwrap(), bytes.parse().unwrap()));
    let answers: Vec<_> = said.lines().filter_map(answer).collect();
    assert_eq!(answers.len(), usize::try_from(calls).unwrap(), "{said}");
    Some(answers)
}

/// A call that leaves before the node knows its caller is asked for at once, and not at the caller's next heartbeat after 3 s.
#[test]
fn calls_of_new_clients_are_answered_at_once() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let reset = ["/twin/reset", "std_srvs::srv::dds_::Trigger", "00"];
    let Some(answers) = call(Command::new("env"), domain, reset, 20) else { return };
    let slow = answers.iter().filter(|(s, _)| *s > 1.5).count();
    assert_eq!(slow, 0, "calls that took longer than 1.5 s: {answers:?}");
    assert_eq!(node.stop("INT").0, Some(0));
}

/// An answer that a network card would cut.
#[test]
fn a_long_answer_is_whole() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let Some(answers) = call(Command::new("env"), domain, LIST, 3) else { return };
    assert!(answers.iter().all(|(_, bytes)| *bytes > 1452), "{answers:?}");
    assert_eq!(node.stop("INT").0, Some(0));
}
