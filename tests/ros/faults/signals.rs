//! SIGINT, SIGTERM and SIGHUP at any moment of a node's life.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{COARSE, Program, TWIN, free_domain, middleware_of, signal};
use rosbag2_mcap::BagReader;

const RIG: &str = env!("CARGO_BIN_EXE_rig_node");
const BAG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/bags/needle_insertion");
/// From the first instant to a node that runs.
const MOMENTS_MS: [u64; 9] = [0, 2, 10, 30, 80, 200, 500, 1000, 2000];

/// Until the node has taken its signals: before that the system itself ends the program, which has done nothing yet.
fn wait_for_its_first_act(process: u32) {
    let begun = Instant::now();
    let blocked = || {
        let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
        let mask = status.lines().find_map(|l| l.strip_prefix("SigBlk:")).unwrap_or("0").trim().to_owned();
        u64::from_str_radix(&mask, 16).unwrap_or(0) & (1 << 1) != 0
    };
    while !blocked() {
        assert!(begun.elapsed() < Duration::from_secs(10));
        std::hint::spin_loop();
    }
}

#[test]
fn a_node_ends_with_0_within_a_second_and_its_files_are_whole() {
    // a model in three dimensions that takes seconds to build
    let building = ["--scene", "indentation", "--ros-args", "-p", "discretisation.dimension:=full"];
    let rig = [BAG, "--ros-args", "-p", "rate:=1.0"];
    for (name, program, arguments) in
        [("twin", TWIN, &COARSE[..]), ("twin that builds", TWIN, &building), ("rig", RIG, &rig)]
    {
        let mut took = Vec::new();
        for (i, moment) in MOMENTS_MS.into_iter().enumerate() {
            let folder = tempfile::tempdir().unwrap();
            let bag = folder.path().join("run");
            let record = format!("record:={}", bag.display());
            let node = Program::start(program, &[arguments, &["-p", &record]].concat(), free_domain(), &[]);
            wait_for_its_first_act(node.id());
            std::thread::sleep(Duration::from_millis(moment));
            let name_of_signal = ["INT", "TERM", "HUP"][i % 3];
            let (code, log, time) = node.stop(name_of_signal);
            assert_eq!(code, Some(0), "{name} after {moment} ms, SIG{name_of_signal}: {log}");
            // the half below has the promise: one end on a machine that others keep busy took 5.7 s
            took.push(time);
            if bag.exists() {
                let bag = BagReader::open(&bag).unwrap();
                assert_eq!(bag.losses(), [], "{name} after {moment} ms");
            }
        }
        took.sort();
        println!(
            "{name}: ended within {:?}, half of the times within {:?}",
            took[took.len() - 1],
            took[took.len() / 2]
        );
        assert!(took[took.len() / 2] < Duration::from_secs(1), "{name}: {took:?}");
    }
}

/// A terminal that is closed takes the node with it, and its middleware; `nohup` keeps both.
#[test]
fn a_node_that_was_started_to_outlive_its_terminal_does() {
    let domain = free_domain();
    let node = Program::start("nohup", &[&[TWIN], &COARSE[..]].concat(), domain, &[]);
    wait_for_its_first_act(node.id());
    let begun = Instant::now();
    while middleware_of(node.id()).is_none() {
        assert!(begun.elapsed() < Duration::from_secs(20), "no middleware");
        std::thread::sleep(Duration::from_millis(20));
    }
    let middleware = middleware_of(node.id()).unwrap();
    [node.id(), middleware].iter().for_each(|process| signal(*process, "HUP"));
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(middleware_of(node.id()), Some(middleware), "neither has gone");
    let (code, log, _) = node.stop("TERM");
    assert_eq!(code, Some(0), "{log}");
    let gone = || !std::path::Path::new(&format!("/proc/{middleware}")).exists();
    let begun = Instant::now();
    while !gone() {
        assert!(begun.elapsed() < Duration::from_secs(5), "the middleware stays");
        std::thread::sleep(Duration::from_millis(20));
    }
}
