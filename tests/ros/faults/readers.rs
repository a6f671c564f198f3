//! Readers that do not read: frozen, slow, with a full queue.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::Duration;

use crate::ros::{Peer, connected_twin, free_domain, node_mb, signal};
use serde_json::{Value, json};

const TOPICS: [(&str, &str); 6] = [
    ("/predicted_cf", "geometry_msgs/msg/WrenchStamped"),
    ("/comparison", "needle_twin/msg/ForceComparison"),
    ("/safe_to_go_on", "std_msgs/msg/Bool"),
    ("/status", "needle_twin/msg/TwinStatus"),
    ("/targets", "geometry_msgs/msg/PoseArray"),
    ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
];

/// Poses at 200 Hz for some seconds: the round trips, and the twin's own median time for a pose, ms.
fn load(peer: &mut Peer, seconds: u32) -> (Value, f64) {
    let run = peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 200 * seconds,
        "rate_hz": 200.0, "depth_m": 0.001, "answers": "/predicted_cf"}));
    let last = peer.ask(json!({"op": "last", "topic": "/diagnostics", "seconds": 1.1}))["message"].clone();
    let values = last["status"][0]["values"].as_array().unwrap().clone();
    let stepping = values.iter().find(|v| v["key"] == "stepping p50 (ms)").unwrap();
    (run, stepping["value"].as_str().unwrap().parse().unwrap())
}

fn reader(domain: u16, qos: &str, depth: u32) -> Peer {
    let mut reader = Peer::start(domain);
    for (topic, kind) in TOPICS {
        reader.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos, "depth": depth}));
    }
    let clouds = json!({"op": "subscribe", "topic": "/tissue_points", "type": "sensor_msgs/msg/PointCloud2", "qos": "best_effort"});
    reader.ask(clouds);
    assert_eq!(
        reader.ask(json!({"op": "wait_matched", "topics": ["/predicted_cf", "/tissue_points"]}))["missing"],
        json!([])
    );
    reader
}

#[test]
fn readers_that_do_not_read_cost_the_others_nothing_and_memory_has_a_bound() {
    let domain = free_domain();
    let (node, mut peer) = connected_twin(domain, &[]);
    let diagnostics =
        json!({"op": "subscribe", "topic": "/diagnostics", "type": "diagnostic_msgs/msg/DiagnosticArray"});
    peer.ask(diagnostics);
    let (alone, step_alone) = load(&mut peer, 5);
    let before = node_mb(node.id());
    // one is frozen, one takes nothing and has all the room, one takes nothing and has room for ten
    let frozen = reader(domain, "reliable", 10);
    let _slow = reader(domain, "reliable", 2000);
    let _full = reader(domain, "full", 10);
    signal(frozen.id(), "STOP");
    let (run, step) = load(&mut peer, 15);
    let grown = node_mb(node.id()) - before;
    let number = |value: &Value| value.as_f64().unwrap();
    println!(
        "alone: step {step_alone} ms, round trip {:.2} ms, {} of {} answered; with three readers that do not read: step \
         {step} ms, {:.2} ms, {} of {}, memory +{grown:.1} MB",
        1e3 * number(&alone["median_s"]),
        alone["answered"],
        alone["sent"],
        1e3 * number(&run["median_s"]),
        run["answered"],
        run["sent"]
    );
    let share = |run: &Value| number(&run["answered"]) / number(&run["sent"]);
    assert!(share(&run) > share(&alone) - 0.1, "{run}");
    assert!(step < 2.0 * step_alone + 1.0, "{step} ms for a pose, {step_alone} ms alone");
    assert!(number(&run["median_s"]) < 2.0 * number(&alone["median_s"]) + 0.002);
    assert!(grown < 40.0, "memory +{grown} MB");
    signal(frozen.id(), "CONT");
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(node.stop("INT").0, Some(0));
}
