//! What is killed, stopped or missing costs no state and is said.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::Duration;

use crate::ros::{COARSE, Peer, Program, TWIN, coarse_twin, connected_twin, free_domain, middleware_of, signal};
use serde_json::{Value, json};

/// Poses at 50 Hz for 2 s; how it went.
fn stream(peer: &mut Peer) -> Value {
    peer.ask(json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 100, "rate_hz": 50.0, "from_m": 0.0004,
        "depth_m": 0.0005, "answers": "/predicted_cf",
    }))
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    assert!(
        (0..600).any(|_| done() || {
            std::thread::sleep(Duration::from_millis(50));
            false
        }),
        "{what}"
    );
}

#[test]
fn a_process_that_is_killed_or_stopped_is_replaced_and_the_state_is_kept() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &["-p", "max_pose_age_s:=0", "-p", "middleware_memory_mib:=300"]);
    assert!(stream(&mut peer)["answered"].as_u64().unwrap() > 0);
    let answered = |peer: &mut Peer| peer.status()["poses_received"].as_u64().unwrap();
    let before = answered(&mut peer);
    for name in ["KILL", "STOP"] {
        let old = middleware_of(node.id()).unwrap();
        let limits = std::fs::read_to_string(format!("/proc/{old}/limits")).unwrap();
        let data = limits.lines().find(|l| l.starts_with("Max data size")).unwrap();
        assert!(data.contains(&(300_u64 << 20).to_string()), "{data}");
        signal(old, name);
        until("another process", || middleware_of(node.id()).is_some_and(|new| new != old));
        until("an exchange", || stream(&mut peer)["answered"].as_u64().unwrap() > 90);
        assert_eq!(
            peer.ask(json!({"op": "participants", "wanted": 1}))["others"],
            1,
            "the old one is gone from the graph"
        );
    }
    assert!(answered(&mut peer) > before, "the node goes on counting");
    let mut late = Peer::start(domain);
    late.ask(
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"}),
    );
    let model = late.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 20.0}));
    assert_eq!(
        model["messages"].as_array().unwrap().len(),
        1,
        "the new process has what those who come later must get"
    );
    drop(late);
    let (code, log, took) = node.stop("INT");
    assert!(code == Some(0) && took < Duration::from_secs(5), "{took:?} {log}");
    assert!(log.contains("was killed") && log.contains("is stopped"), "{log}");
    assert_eq!(peer.ask(json!({"op": "participants", "wanted": 0}))["others"], 0, "the node has left");
}

#[test]
fn a_reader_that_is_frozen_holds_nobody_up() {
    let domain = free_domain();
    let (_node, mut peer) = connected_twin(domain, &["-p", "max_pose_age_s:=0", "-p", "tissue_rate_hz:=20.0"]);
    let mut frozen = Peer::start(domain);
    for (topic, kind) in
        [("/predicted_cf", "geometry_msgs/msg/WrenchStamped"), ("/tissue_surface", "visualization_msgs/msg/Marker")]
    {
        frozen.ask(json!({"op": "subscribe", "topic": topic, "type": kind}));
    }
    frozen.ask(json!({"op": "wait_matched", "topics": ["/predicted_cf", "/tissue_surface"]}));
    signal(frozen.id(), "STOP");
    // until the connection's buffers are full, and beyond
    let longest = (0..5).map(|_| stream(&mut peer)).inspect(|run| assert_eq!(run["answered"], 100, "{run}"));
    let longest = longest.map(|run| run["longest_gap_s"].as_f64().unwrap()).fold(0.0, f64::max);
    println!("longest time between two answers {longest:.3} s");
    signal(frozen.id(), "CONT");
    // what was kept for it, or what comes next: one that was silent for longer than its lease has to join again
    let hears = |_| {
        let heard = frozen.ask(json!({"op": "last", "topic": "/predicted_cf", "seconds": 1.0}));
        let hears = heard["count"].as_u64() > Some(0);
        if !hears {
            stream(&mut peer);
        }
        hears
    };
    assert!((0..15).any(hears), "it does not hear again");
}

#[test]
fn nodes_that_have_met_need_no_router_and_those_who_come_later_find_the_next_one() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "max_pose_age_s:=0"], &[]);
    let router = Peer::start(domain);
    let mut peer = Peer::start(domain);
    peer.connect();
    drop(router);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(stream(&mut peer)["answered"], 100, "straight from one to the other");
    let mut later = Peer::start(domain);
    later.connect();
    drop((node, peer));
}

#[test]
fn no_router_and_a_wrong_configuration_are_said() {
    let domain = free_domain();
    let alone = [("ZENOH_CONFIG_OVERRIDE", "connect/endpoints=[\"tcp/127.0.0.1:9\"]")];
    let node = coarse_twin(domain, &[], &alone);
    std::thread::sleep(Duration::from_secs(4));
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert_eq!(log.matches("no Zenoh router").count(), 1, "{log}");
    for (variable, value, said) in [
        ("ZENOH_CONFIG_OVERRIDE", "mode=\"king\"", "`mode=\"king\"`"),
        ("ZENOH_SESSION_CONFIG_URI", "/no/such/file.json5", "/no/such/file.json5"),
        ("ZENOH_ROUTER_CHECK_ATTEMPTS", "often", "whole number"),
    ] {
        let (code, log) = Program::start(TWIN, &COARSE, domain, &[(variable, value)]).ended();
        assert!(
            code.is_some_and(|c| c == 1 || c == 2) && log.contains(said) && log.contains(variable),
            "{code:?} {log}"
        );
    }
}
