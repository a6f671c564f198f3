//! Where a needle that bends is, on its topics.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, TWIN, free_domain, joint_state};
use serde_json::{Value, json};

const TOPICS: [(&str, &str); 2] =
    [("/predicted_tip", "geometry_msgs/msg/PoseStamped"), ("/predicted_shape", "geometry_msgs/msg/PoseArray")];

fn place(pose: &Value) -> [f64; 3] {
    ["x", "y", "z"].map(|name| pose["position"][name].as_f64().unwrap_or_else(|| panic!("{name} of {pose}")))
}

#[test]
fn the_shape_of_a_bent_needle_ends_at_its_tip() {
    let domain = free_domain();
    let bent = [
        "discretisation.spacing_m:=0.005",
        "discretisation.edge_refinement:=1.0",
        "discretisation.dimension:=mirrored",
        "instrument.capture_radius_m:=0.001",
        "instrument.flexible:=true",
        "instrument.length_m:=0.06",
        "instrument.outer_diameter_m:=0.0005",
        "instrument.youngs_modulus_pa:=6e10",
        "instrument.tip:=bevel",
        "instrument.bevel_force_n:=0.002",
        "tissue_rate_hz:=100.0",
    ];
    let keys: Vec<&str> = bent.iter().flat_map(|key| ["-p", *key]).collect();
    let node = Program::start(TWIN, &[&["--scene", "needle_insertion", "--ros-args"][..], &keys].concat(), domain, &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind) in TOPICS {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind}));
    }
    peer.connect();
    let names: Vec<&str> = TOPICS.iter().map(|(topic, _)| *topic).collect();
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": names}))["missing"], json!([]));
    let mut send = |i: i64, depth_m: f64| {
        let stamp = 1_700_000_000_000_000_000 + 10_000_000 * i;
        let value = joint_state(stamp / 1_000_000_000, stamp % 1_000_000_000, depth_m);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(10));
    };
    for i in 0..150_i64 {
        send(i, 1e-5 * i as f64);
    }
    // it stands, so that a snapshot is of the last pose
    for i in 150..200_i64 {
        send(i, 1.49e-3);
    }
    let tip = peer.ask(json!({"op": "last", "topic": "/predicted_tip", "seconds": 0.5}))["message"].clone();
    let shape = peer.ask(json!({"op": "last", "topic": "/predicted_shape", "seconds": 0.5}))["message"].clone();
    assert_eq!(tip["header"]["frame_id"], "sample", "{tip}");
    let poses = shape["poses"].as_array().unwrap_or_else(|| panic!("{shape}"));
    assert_eq!(poses.len(), 81);
    let [x, y, z] = place(&tip["pose"]);
    assert!(x > 1e-6 && y.abs() < 0.2 * x && (z - (0.017 - 1.49e-3)).abs() < 1e-5, "{x} {y} {z}");
    let end = place(&poses[80]);
    assert!((end[0] - x).abs() < 0.1 * x, "{end:?} {x}");
    let clamp = place(&poses[0]);
    assert!(clamp[0].abs() < 1e-12 && (clamp[2] - (0.017 - 1.49e-3 + 0.06)).abs() < 1e-9, "{clamp:?}");
    assert_eq!(node.stop("INT").0, Some(0));
}
