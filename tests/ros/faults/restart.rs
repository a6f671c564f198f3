//! Rig, twin or peer is killed and comes back.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{Peer, Program, TWIN, coarse_twin, connected_twin, free_domain, joint_state, signal};
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

/// A needle that rubs is walked to in hundreds of strides, which takes longer than a node may be silent.
#[test]
fn a_needle_that_is_deep_at_the_start_is_gone_to_in_parts_and_nothing_is_said_before() {
    let domain = free_domain();
    let arguments =
        ["--scene", "layered_tissue", "--ros-args", "-p", "solver_timeout_s:=1.0", "-p", "status_rate_hz:=20.0"];
    let node = Program::start(TWIN, &arguments, domain, &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    let pose = |peer: &mut Peer, depth_m: f64| {
        let nanos = now();
        let value = joint_state(nanos / 1_000_000_000, nanos % 1_000_000_000, depth_m);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
    };
    let take = |peer: &mut Peer, topic: &str| {
        let taken = peer.ask(json!({"op": "take", "topic": topic, "timeout": 0.01}))["messages"].clone();
        taken.as_array().unwrap().clone()
    };
    // the second time after a reset in the middle of the way; meanwhile the needle goes on a little
    for reset_at_ms in [Some(400), None] {
        let (begun, mut told, mut reset) = (Instant::now(), 0, false);
        let (mut depth_m, mut first) = (6.0e-3, None);
        while first.is_none() && begun.elapsed() < Duration::from_secs(60) {
            depth_m += if begun.elapsed() < Duration::from_millis(300) { 1e-6 } else { 0.0 };
            pose(&mut peer, depth_m);
            for status in take(&mut peer, "/status") {
                told += usize::from(status["reasons"].to_string().contains("taking the instrument to 6.0 mm"));
                let answered = status["poses_answered"].as_u64().unwrap() > 0;
                assert!(answered || status["prediction_valid"] == false, "{status}");
            }
            if let Some(at_ms) = reset_at_ms.filter(|ms| !reset && begun.elapsed() > Duration::from_millis(*ms)) {
                reset = true;
                let call = json!({"op": "call", "service": "/twin/reset", "type": "std_srvs/srv/Trigger"});
                assert_eq!(peer.ask(call)["response"]["success"], true, "{at_ms}");
                break;
            }
            first = take(&mut peer, "/predicted_cf").first().cloned();
        }
        if reset {
            continue;
        }
        let first = first.unwrap_or_else(|| panic!("no answer"));
        println!("answered after {:.1} s; {told} times said how long it takes: {first}", begun.elapsed().as_secs_f64());
        assert!(told > 1, "{told}");
        // friction and the front's push are there
        assert!(first["wrench"]["force"]["z"].as_f64().unwrap() > 0.01, "{first}");
    }
    std::thread::sleep(Duration::from_millis(300));
    let (code, log, took) = node.stop("TERM");
    assert!(code == Some(0) && took < Duration::from_secs(3), "{code:?} {took:?} {log}");
    assert!(log.contains("is taken to 0.006") && log.contains("the way there and the puncture were not seen"), "{log}");
    assert!(!log.contains("does not come back"), "{log}");
}
