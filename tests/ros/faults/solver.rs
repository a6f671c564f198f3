//! A solver that hangs: its thread is held by a debugger's means, all others go on.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{connected_twin, free_domain};
use ros2_guarded::hung::Hung;
use serde_json::json;

#[test]
fn a_solver_that_hangs_is_said_stops_the_force_and_ends_the_node() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &["-p", "solver_timeout_s:=3.0"]);
    peer.ask(json!({"op": "subscribe", "topic": "/safe_to_go_on", "type": "std_msgs/msg/Bool"}));
    peer.ask(json!({"op": "wait_matched", "topics": ["/safe_to_go_on"]}));
    let second = 1_000_000_000;
    let start = 1_700_000_000 * second;
    assert!(peer.steps(&[(start, 0.0), (start + second / 100, 1e-5)]).iter().all(Option::is_some));
    let held = match Hung::new(node.id(), "solver") {
        Ok(held) => held,
        Err(why) => return eprintln!("not tried: {why}"),
    };
    let begun = Instant::now();
    // It wakes up to this pose and never comes back; the poses go on.
    for i in 2..150 {
        let value = crate::ros::joint_state(1_700_000_000 + i / 100, 10_000_000 * (i % 100), 1e-5 * i as f64);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(Duration::from_millis(10));
    }
    let silence = peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 0.0}))["messages"].clone();
    assert_eq!(silence, json!([]), "nothing is repeated");
    let safe = peer.ask(json!({"op": "last", "topic": "/safe_to_go_on", "seconds": 0.1}))["message"].clone();
    assert_eq!(safe["data"], false);
    let mut said = Vec::new();
    while begun.elapsed() < Duration::from_secs(12) && !held.has_ended() {
        let status = peer.ask(json!({"op": "take", "topic": "/status", "timeout": 0.1}))["messages"].clone();
        // the end of a writer comes as a sample without data
        said.extend(status.as_array().unwrap().iter().filter(|s| s["instance"].is_string()).cloned());
    }
    let ended = begun.elapsed();
    let first = said.iter().find(|s| s["health"] == 2).unwrap_or_else(|| panic!("no error in {said:?}"));
    assert!(first["reasons"].to_string().contains("has not come back"), "{first}");
    assert_eq!(first["prediction_valid"], false);
    let last = said.last().unwrap();
    assert!(last["reasons"].to_string().contains("the node ends"), "the last word: {last}");
    drop(held);
    // the process follows its threads
    std::thread::sleep(Duration::from_millis(500));
    let (code, log) = node.end();
    println!("ended {:.1} s after the solver was held", ended.as_secs_f64());
    assert_eq!(code, Some(1), "{log}");
    assert!(log.contains("does not come back from a pose") && log.contains("start the node again"), "{log}");
}
