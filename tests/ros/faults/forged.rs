//! Somebody else sends poses with stamps of long ago that agree with each other, hundreds in a second.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::Duration;

use crate::ros::{Peer, connected_twin, free_domain};
use serde_json::json;

#[test]
fn a_flood_of_forged_stamps_neither_moves_time_nor_stops_the_answers() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &["-p", "max_pose_age_s:=0"]);
    let mut forger = Peer::start(domain);
    forger.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    forger.ask(json!({"op": "wait_matched", "topics": ["/measured_js"]}));
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let long_ago = (now - Duration::from_secs(5000)).as_nanos() as u64;
    let mut insert = |seconds: u32| {
        peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 100 * seconds,
            "rate_hz": 100.0, "from_m": 0.0004, "depth_m": 0.0005, "answers": "/predicted_cf"}))
    };
    insert(1);
    let seen = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_secs(1));
            forger.ask(json!({"op": "burst", "topic": "/measured_js", "joint": "insertion", "poses": 3000,
                "rate_hz": 600.0, "depth_m": 0.002, "first_nanos": long_ago, "step_nanos": 1_000_000}))
        });
        insert(8)
    });
    println!("{} of {} answered, {} s at most without", seen["answered"], seen["sent"], seen["longest_gap_s"]);
    let status = peer.status();
    assert!(status["poses_rejected"].as_u64().unwrap() > 500, "{status}");
    assert!(seen["answered"].as_u64().unwrap() > 400, "{seen}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(!log.contains("time went back"), "{log}");
}
