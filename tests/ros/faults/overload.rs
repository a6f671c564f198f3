//! Poses faster than the twin can answer.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{Peer, Program, TWIN, free_domain};
use serde_json::json;

#[test]
fn it_skips_to_the_newest_pose_says_so_with_the_error_and_recovers() {
    let domain = free_domain();
    // in three dimensions: milliseconds for a pose
    let heavy = [
        "--scene",
        "indentation",
        "--ros-args",
        "-p",
        "discretisation.dimension:=full",
        "-p",
        "discretisation.spacing_m:=0.0025",
        "-p",
        "look_ahead:=false",
    ];
    let node = Program::start(TWIN, &heavy, domain, &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    // 3 s at 1 kHz to 1.5 mm; the status is looked at while it runs, so somebody else listens
    let mut witness = Peer::start(domain);
    witness.ask(json!({"op": "subscribe", "topic": "/status", "type": "needle_twin/msg/TwinStatus"}));
    let pushed = std::thread::spawn(move || {
        let run = peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 3000,
            "rate_hz": 1000.0, "depth_m": 0.0015, "answers": "/predicted_cf"}));
        (peer, run)
    });
    let loaded = witness.ask(json!({"op": "last", "topic": "/status", "seconds": 2.8}))["message"].clone();
    let (mut peer, run) = pushed.join().unwrap();
    let reasons = loaded["reasons"].to_string();
    assert!(loaded["health"] == 1 && reasons.contains("poses are skipped"), "{loaded}");
    assert!(reasons.contains("% of the peak"), "the error is stated: {reasons}");
    assert!(loaded["poses_coalesced"].as_u64().unwrap() > 100, "{loaded}");
    let last = run["forces"].as_array().unwrap().last().unwrap()[2].as_f64().unwrap();
    // the load ends: 20 poses a second at the same place
    let begun = Instant::now();
    let now = i64::try_from(std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos());
    let (mut force, mut nanos) = (last, now.unwrap());
    let well = loop {
        nanos += 50_000_000;
        if let Some(answer) = peer.steps(&[(nanos, 0.0015)])[0] {
            force = answer;
        }
        let status = peer.ask(json!({"op": "last", "topic": "/status", "seconds": 0.15}))["message"].clone();
        if status["health"] == 0 {
            break begun.elapsed();
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{status}");
    };
    for _ in 0..60 {
        nanos += 50_000_000;
        force = peer.steps(&[(nanos, 0.0015)])[0].unwrap_or(force);
    }
    let stated = loaded["force_imbalance"].as_f64().unwrap();
    println!(
        "skipped {} of {} poses, median latency {:.1} ms; well {:.1} s after the load; force at its end {last:.5} N, at rest \
         {force:.5} N: {:.1} % off; the status had stated {:.1} %",
        loaded["poses_coalesced"],
        loaded["poses_received"],
        1e3 * run["median_s"].as_f64().unwrap(),
        well.as_secs_f64(),
        100.0 * (last - force).abs() / force,
        100.0 * stated
    );
    assert!(run["unasked"] == 0 && force > 0.0);
    assert!((last - force).abs() < (0.1 + 8.0 * stated) * force, "{last} N under load, {force} N at rest, {stated}");
    assert_eq!(node.stop("INT").0, Some(0));
}
