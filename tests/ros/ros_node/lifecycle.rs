//! A managed node: its manager is the independent peer.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use crate::ros::{Peer, Program, TWIN, coarse_twin, free_domain, joint_state};
use serde_json::{Value, json};

fn ask(peer: &mut Peer, what: &str, kind: &str, request: Value) -> Value {
    peer.ask(json!({
        "op": "call", "service": format!("/twin/{what}"), "type": format!("lifecycle_msgs/srv/{kind}"),
        "request": request, "timeout": 60.0,
    }))["response"]
        .clone()
}

fn change(peer: &mut Peer, label: &str) -> bool {
    let request = json!({"transition": {"id": 0, "label": label}});
    ask(peer, "change_state", "ChangeState", request)["success"].as_bool().unwrap()
}

fn state(peer: &mut Peer) -> String {
    ask(peer, "get_state", "GetState", json!({}))["current_state"]["label"].as_str().unwrap().to_owned()
}

fn answers(peer: &mut Peer, sec: i64) -> usize {
    peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": joint_state(sec, 0, 0.0001)}));
    let timeout = json!({"op": "take", "topic": "/predicted_cf", "timeout": 0.7});
    peer.ask(timeout)["messages"].as_array().unwrap().len()
}

#[test]
fn a_manager_takes_the_node_through_its_life() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "autostart:=false"], &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/twin/transition_event", "lifecycle_msgs/msg/TransitionEvent", "reliable"),
        ("/predicted_cf", "geometry_msgs/msg/WrenchStamped", "reliable"),
        ("/status", "needle_twin/msg/TwinStatus", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    let topics = ["/twin/transition_event", "/predicted_cf", "/status", "/measured_js"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));

    assert_eq!(state(&mut peer), "unconfigured");
    assert!(!change(&mut peer, "activate"), "not from here");
    let from_here = ask(&mut peer, "get_available_transitions", "GetAvailableTransitions", json!({}));
    let labels: Vec<&str> = from_here["available_transitions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|t| t["transition"]["label"].as_str().unwrap())
        .collect();
    assert_eq!(labels, ["configure", "shutdown"]);
    let graph = ask(&mut peer, "get_transition_graph", "GetAvailableTransitions", json!({}));
    assert_eq!(graph["available_transitions"].as_array().unwrap().len(), 25);
    let states = ask(&mut peer, "get_available_states", "GetAvailableStates", json!({}));
    assert_eq!(states["available_states"].as_array().unwrap().len(), 10);

    // By its number, as some managers ask; the answer comes when the model is there.
    let by_number = json!({"transition": {"id": 1, "label": ""}});
    assert_eq!(ask(&mut peer, "change_state", "ChangeState", by_number)["success"], true);
    assert_eq!(state(&mut peer), "inactive");
    let model =
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"});
    peer.ask(model);
    let late = peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 5.0}))["messages"].clone();
    assert_eq!(late.as_array().unwrap().len(), 1, "a late joiner has it");

    assert_eq!(answers(&mut peer, 1_700_000_000), 0, "inactive is silent");
    let status = peer.until("/status", |s| s["reasons"].to_string().contains("inactive"));
    assert_eq!((&status["prediction_valid"], &status["poses_received"]), (&json!(false), &json!(0)), "{status}");
    assert!(status["reasons"][0].as_str().unwrap().contains("inactive"), "{status}");
    assert!(change(&mut peer, "activate"));
    assert_eq!(answers(&mut peer, 1_700_000_001), 1);
    assert!(change(&mut peer, "deactivate"));
    assert_eq!(answers(&mut peer, 1_700_000_002), 0);
    assert!(change(&mut peer, "cleanup"));
    assert!(change(&mut peer, "configure") && change(&mut peer, "activate"));
    assert_eq!(answers(&mut peer, 1_700_000_003), 1, "built anew");
    assert!(change(&mut peer, "shutdown"));
    assert_eq!(state(&mut peer), "finalized");
    assert!(!change(&mut peer, "configure"), "there is no way back");

    let events = peer.ask(json!({"op": "take", "topic": "/twin/transition_event", "timeout": 1.0, "count": 100}));
    let goals: Vec<&str> =
        events["messages"].as_array().unwrap().iter().map(|e| e["goal_state"]["label"].as_str().unwrap()).collect();
    let (up, on) = (["configuring", "inactive"], ["activating", "active"]);
    let down = ["deactivating", "inactive", "cleaningup", "unconfigured"];
    let end = ["shuttingdown", "finalized"];
    assert_eq!(goals, [&up[..], &on, &down, &up, &on, &end].concat());
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}

#[test]
fn a_scene_that_can_not_be_built_fails_the_configuration_and_not_the_node() {
    let folder = tempfile::tempdir().unwrap();
    let organ = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/meshes/organ.toml");
    let scene = folder.path().join("organ.toml");
    std::fs::copy(organ, &scene).unwrap();
    std::fs::write(folder.path().join("organ.msh"), "not a mesh").unwrap();
    let (scene, domain) = (scene.display().to_string(), free_domain());
    let node = Program::start(TWIN, &["--scene", &scene, "--ros-args", "-p", "autostart:=false"], domain, &[]);
    let mut peer = Peer::start(domain);
    assert!(!change(&mut peer, "configure"));
    assert_eq!(state(&mut peer), "unconfigured");
    let (code, log, _) = node.stop("TERM");
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("can't be built") && log.contains("organ.msh"), "{log}");

    // With nobody to manage it, it ends with the reason.
    let output = std::process::Command::new(TWIN)
        .args(["--scene", &scene])
        .env("ROS_DOMAIN_ID", free_domain().to_string())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && text.contains("organ.msh"), "{text}");
}
