//! Two twins on the same names.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{Peer, coarse_twin, connected_twin, free_domain, signal};
use serde_json::{Value, json};

/// A second of poses, and what was said on `topic` meanwhile.
fn heard(peer: &mut Peer, topic: &str) -> Vec<Value> {
    peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 20, "rate_hz": 20.0,
        "depth_m": 0.0005, "from_m": 0.0005, "answers": "/predicted_cf"}));
    peer.ask(json!({"op": "take", "topic": topic, "timeout": 0.0}))["messages"].as_array().unwrap().clone()
}

/// Waits until a process says what is `wanted` of it; how long that took, and its words.
fn until(peer: &mut Peer, process: u32, what: &str, wanted: impl Fn(&Value) -> bool) -> (f64, Value) {
    let begun = Instant::now();
    loop {
        let own = |s: &Value| s["instance"].as_str().unwrap().ends_with(&format!(":{process}"));
        if let Some(last) = heard(peer, "/status").into_iter().rfind(|s| own(s) && wanted(s)) {
            return (begun.elapsed().as_secs_f64(), last);
        }
        assert!(begun.elapsed() < Duration::from_secs(40), "{process} is not {what}");
    }
}

/// It names this process as another twin, with the remedy, and does not vouch.
fn names(status: &Value, process: u32) -> bool {
    let reasons = status["reasons"].to_string();
    reasons.contains(&format!(":{process}) speaks here"))
        && reasons.contains("-r __ns:=/name")
        && status["prediction_valid"] == false
        && status["health"] == 1
}

#[test]
fn a_second_twin_is_named_by_both_and_neither_vouches_until_it_has_gone() {
    let domain = free_domain();
    let (first, mut peer) = connected_twin(domain, &[]);
    peer.ask(json!({"op": "subscribe", "topic": "/safety", "type": "needle_twin/msg/Safety"}));
    peer.ask(json!({"op": "subscribe", "topic": "/diagnostics", "type": "diagnostic_msgs/msg/DiagnosticArray"}));
    until(&mut peer, first.id(), "well", |s| s["prediction_valid"] == true);
    let second = coarse_twin(domain, &[], &[]);
    let (took_s, _) = until(&mut peer, first.id(), "contested", |s| names(s, second.id()));
    until(&mut peer, second.id(), "contested", |s| names(s, first.id()));
    // words of before have outlived their lifespan, and the middleware has dropped them
    heard(&mut peer, "/status");
    let safety = peer.until("/safety", |s| s["reasons"].to_string().contains("another twin ("));
    assert!(safety["safe"] == false && safety["reasons"].to_string().contains("another twin ("), "{safety}");
    assert!(json!(heard(&mut peer, "/diagnostics")).to_string().contains("another twin"));
    signal(second.id(), "KILL");
    let (back_s, _) = until(&mut peer, first.id(), "well again", |s| s["prediction_valid"] == true);
    println!("said {took_s:.1} s after the start of the second, well {back_s:.1} s after its death");
    let (code, log, _) = first.stop("INT");
    assert_eq!((code, log.matches("another twin").count()), (Some(0), 1), "said once: {log}");
    assert!(log.contains("has gone"), "{log}");
}
