//! Poses that cost the solver most, in three dimensions: a solution that is lost beside the axis, and a needle that is deep inside at first.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{Peer, Program, TWIN, free_domain};
use serde_json::json;

/// 10 mm beside the axis, with all of the displacement kept as deformation: lost at about 1 mm.
const BESIDE: [&str; 17] = [
    "--scene",
    "needle_insertion",
    "--ros-args",
    "-p",
    "discretisation.dimension:=full",
    "-p",
    "discretisation.spacing_m:=0.003",
    "-p",
    "discretisation.edge_refinement:=0.5",
    "-p",
    "instrument.capture_radius_m:=0.001",
    "-p",
    "instrument.entry_x_m:=0.010",
    "-p",
    "instrument.deformation_coefficient:=1.0",
    "-p",
    "look_ahead:=false",
];

#[test]
fn a_solution_that_is_lost_beside_the_axis_is_said_and_a_reset_brings_it_back() {
    let domain = free_domain();
    let node = Program::start(TWIN, &BESIDE, domain, &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    let begun = Instant::now();
    let mut depth = 0.0;
    let lost = loop {
        // 10 mm/s; held at 6 mm, which is deeper than the solution holds
        let to = f64::min(depth + 5e-4, 6e-3);
        peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 50, "rate_hz": 100.0,
            "from_m": depth, "depth_m": to, "answers": "/predicted_cf"}));
        depth = to;
        let status = peer.ask(json!({"op": "last", "topic": "/status", "seconds": 0.3}))["message"].clone();
        if status["health"] == 2 && status["reasons"].to_string().contains("diverged") {
            break status;
        }
        assert!(begun.elapsed() < Duration::from_secs(120), "{depth} m: {status}");
    };
    assert_eq!(lost["prediction_valid"], false, "{lost}");
    assert!(lost["reasons"].to_string().contains("~/reset"), "{lost}");
    let reset = peer.ask(json!({"op": "call", "service": "/twin/reset", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(reset["response"]["success"], true, "{reset}");
    // The instrument is taken out, and the twin answers as a new one, once it has left the pose that it was at.
    let begun = Instant::now();
    loop {
        let again = peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 100,
            "rate_hz": 50.0, "from_m": -1e-3, "depth_m": 1e-4, "answers": "/predicted_cf"}));
        if again["answered"].as_u64().unwrap() > 50 {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{again}");
    }
    let status = peer.status();
    assert!(status["health"] != 2, "{status}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("predicted_cf stops: the solution diverged"), "{log}");
}

/// Every stride of the way there once took 2000 steps, and the node ended after 10 s without an answer.
#[test]
fn a_first_pose_deep_inside_is_answered() {
    let domain = free_domain();
    let deep = ["-p", "discretisation.dimension:=full", "-p", "look_ahead:=false", "-p", "solver_timeout_s:=60.0"];
    let node = Program::start(TWIN, &[&["--scene", "needle_insertion", "--ros-args"], &deep[..]].concat(), domain, &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    let begun = Instant::now();
    loop {
        let seen = peer.ask(json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 40,
            "rate_hz": 20.0, "from_m": 9e-3, "depth_m": 9e-3, "answers": "/predicted_cf"}));
        if seen["answered"].as_u64().unwrap() > 0 {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(55), "{}", peer.status());
    }
    println!("answered within {:.1} s", begun.elapsed().as_secs_f64());
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}
