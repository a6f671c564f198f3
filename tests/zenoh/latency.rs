//! How long a force takes that answers a pose.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{COARSE, Peer, Program, TWIN, free_domain, middleware_of, resident_mb};
use serde_json::json;

/// As docs/lab/decisions/middleware_process.md measured it over DDS; a busy machine gives other numbers, so it asserts only that nothing is lost.
#[test]
#[ignore = "a measurement: .ci/long runs it"]
fn pose_to_force_at_1_khz() {
    let domain = free_domain();
    let plate = [&COARSE[..8], &["stepping.max_steps_per_pose:=2"]].concat();
    let node = Program::start(TWIN, &plate, domain, &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    for run in 0..4 {
        let trips = peer.ask(json!({"op": "ping", "topic": "/measured_js", "joint": "insertion", "poses": 8000,
            "rate_hz": 1000.0, "depth_m": 0.0005, "answers": "/predicted_cf"}));
        let ms = |key: &str| trips[key].as_f64().unwrap() * 1e3;
        println!(
            "run {run}: {} of 8000, median {:.3} ms, 99 % {:.3} ms, largest {:.1} ms",
            trips["answered"],
            ms("median_s"),
            ms("p99_s"),
            ms("max_s")
        );
        assert!(trips["answered"].as_u64().unwrap() > 7800, "{trips}");
    }
    println!(
        "resident: node {:.0} MB, process {:.0} MB",
        resident_mb(node.id()),
        resident_mb(middleware_of(node.id()).unwrap())
    );
}
