//! Rig, twin or peer is killed and comes back.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{Peer, Program, coarse_twin, connected_twin, free_domain, signal};
use serde_json::json;

const RIG: &str = env!("CARGO_BIN_EXE_rig_node");
const BAG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/bags/needle_insertion");
/// The promise is one second; a busy machine that starts Python or pauses meanwhile is not the node's.
const BUSY_S: f64 = 4.0;

fn now() -> i64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    i64::try_from(since.as_nanos()).unwrap()
}

/// Time until a pose at `depth_m` is answered; a pose every 20 ms.
fn until_answered(peer: &mut Peer, depth_m: f64, begun: Instant) -> f64 {
    loop {
        let poses = json!([[now(), depth_m]]);
        let answer = peer.ask(json!({"op": "steps", "topic": "/measured_js", "joint": "insertion", "poses": poses,
            "answers": "/predicted_cf", "timeout": 0.02}));
        if !answer["forces"][0].is_null() {
            return begun.elapsed().as_secs_f64();
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "no answer");
    }
}

#[test]
fn a_twin_that_was_killed_answers_again_and_says_that_it_has_not_seen_the_way() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &[]);
    until_answered(&mut peer, 0.0, Instant::now());
    for _ in 0..3 {
        until_answered(&mut peer, 0.002, Instant::now());
    }
    signal(node.id(), "KILL");
    drop(node);
    let node = coarse_twin(domain, &[], &[]);
    let took = until_answered(&mut peer, 0.002, Instant::now());
    let status = peer.status();
    println!("twin: the first answer came {took:.2} s after its start, building the model included");
    assert!(status["reasons"].to_string().contains("deep already"), "{status}");
    assert!(took < BUSY_S, "{took} s");
    let (code, log, _) = node.stop("INT");
    assert!(code == Some(0) && log.contains("the way there and the puncture were not seen"), "{log}");
}

#[test]
fn a_driver_that_was_killed_is_heard_again_and_the_gap_is_said() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &[]);
    until_answered(&mut peer, 0.0001, Instant::now());
    signal(peer.id(), "KILL");
    drop(peer);
    std::thread::sleep(Duration::from_millis(700));
    let mut peer = Peer::start(domain);
    let begun = Instant::now();
    peer.ask(json!({"op": "subscribe", "topic": "/predicted_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    let took = until_answered(&mut peer, 0.0006, begun);
    println!("driver: the first answer came {took:.2} s after it was back");
    assert!(took < BUSY_S, "{took} s");
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("input lost") && log.contains("went from 0.000100 m to 0.000600 m unseen"), "{log}");
}

#[test]
fn a_rig_that_was_killed_is_followed_again_from_the_start() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &[]);
    let playing = ["--ros-args", "-p", "rate:=1.0", "-p", "clock_hz:=0.0"];
    let rig = || Program::start(RIG, &[&[BAG][..], &playing].concat(), domain, &[]);
    let first = rig();
    let heard = |peer: &mut Peer, begun: Instant| {
        peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 0.0}));
        let found = peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 20.0}))["messages"].clone();
        assert!(!found.as_array().unwrap().is_empty(), "the twin answers the rig");
        begun.elapsed().as_secs_f64()
    };
    heard(&mut peer, Instant::now());
    std::thread::sleep(Duration::from_secs(3));
    signal(first.id(), "KILL");
    drop(first);
    std::thread::sleep(Duration::from_millis(700));
    let begun = Instant::now();
    let second = rig();
    let took = heard(&mut peer, begun);
    println!("rig: the first answer came {took:.2} s after its start");
    assert!(took < BUSY_S, "{took} s");
    drop(second);
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("time went back") && log.contains("undeformed state"), "the bag starts again: {log}");
}
