//! An independent DDS implementation (Eclipse CycloneDDS) talks to the twin as a user would start it.
//!
//! Contract: a `measured_js` is answered by a `predicted_cf` that carries its stamp; the tissue reaches a peer that comes
//! late; services answer; what is no pose stops nothing and is counted.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, coarse_twin, free_domain};
use serde_json::{Value, json};

fn twin(domain: u16) -> Program {
    coarse_twin(domain, &[], &[])
}

/// Writes poses, reads forces; returns when the twin has built its model and is matched.
fn connected(domain: u16) -> Peer {
    let mut peer = Peer::start(domain);
    peer.ask(
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"}),
    );
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "subscribe", "topic": "/predicted_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "subscribe", "topic": "/status", "type": "needle_twin/msg/TwinStatus"}));
    let matched = peer
        .ask(json!({"op": "wait_matched", "topics": ["/measured_js", "/predicted_cf", "/tissue_model", "/status"]}));
    assert_eq!(matched["missing"], json!([]));
    peer
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("not a number: {value}"))
}

fn model(peer: &mut Peer) -> Value {
    let models = peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    assert_eq!(models["messages"].as_array().unwrap().len(), 1, "the model is published once");
    models["messages"][0].clone()
}

#[test]
fn every_pose_is_answered_with_its_own_stamp_and_the_tissue_follows() {
    let domain = free_domain();
    let node = twin(domain);
    let mut peer = connected(domain);
    let model = model(&mut peer);
    peer.ask(json!({"op": "subscribe", "topic": "/tissue_state", "type": "needle_twin/msg/TissueState", "qos": "best_effort"}));
    peer.ask(json!({"op": "wait_matched", "topics": ["/tissue_state"]}));
    let answer = peer.ask(json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 60, "rate_hz": 20.0,
        "depth_m": 0.001, "answers": "/predicted_cf",
    }));
    assert_eq!(answer["unasked"], 0, "every answer carries the stamp of a pose: {answer}");
    let (sent, answered) = (number(&answer["sent"]), number(&answer["answered"]));
    assert!(answered >= 0.5 * sent, "{answered} of {sent} answered");
    assert_eq!(answer["frames"], json!(["sample"]));
    let forces = answer["forces"].as_array().unwrap();
    assert!(forces.iter().all(|f| f.as_array().unwrap().iter().all(Value::is_f64)), "all finite: {answer}");
    let last = number(&forces.last().unwrap()[2]);
    assert!(last > 0.0, "an insertion along -z is pushed back along +z, got {last} N");

    let state = peer.until("/tissue_state", |state| !state.is_null());
    assert_eq!(state["model_id"], model["model_id"]);
    let points = model["reference_points"].as_array().unwrap();
    let displacements = state["displacements"].as_array().unwrap();
    assert_eq!(displacements.len(), points.len());
    let deepest = displacements.iter().map(|u| number(&u["z"])).fold(0.0, f64::min);
    assert!(deepest < -1e-5, "the tissue goes down with the plate, lowest displacement {deepest} m");

    let (code, log, took) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(took.as_secs_f64() < 1.0, "Ctrl-C took {took:?}");
}

#[test]
fn services_reset_and_tare_answer() {
    let domain = free_domain();
    let node = twin(domain);
    let mut peer = connected(domain);
    model(&mut peer);
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "subscribe", "topic": "/comparison", "type": "needle_twin/msg/ForceComparison"}));
    peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cf", "/comparison"]}));

    let refused = peer.ask(json!({"op": "call", "service": "/twin/tare", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(refused["response"]["success"], false, "no load cell has spoken yet");

    peer.ask(json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 20, "rate_hz": 20.0, "depth_m": 0.0004,
        "force_topic": "/measured_cf", "force_n": 0.25, "answers": "/predicted_cf",
    }));
    let before = peer.until("/comparison", |c| c["valid"] == true);
    assert_eq!(before["valid"], true, "{before}");
    assert!((number(&before["measured_n"]) - 0.25).abs() < 1e-12, "{before}");
    let residual = number(&before["predicted_n"]) - number(&before["measured_n"]);
    assert!((number(&before["residual_n"]) - residual).abs() < 1e-12);

    let inside = peer.ask(json!({"op": "call", "service": "/twin/tare", "type": "std_srvs/srv/Trigger"}));
    let why = inside["response"]["message"].as_str().unwrap();
    assert!(inside["response"]["success"] == false && why.contains("inside the sample"), "{inside}");
    let tared = peer.ask(json!({"op": "call", "service": "/twin/force_tare", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(tared["response"]["success"], true);
    let again = json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 20, "rate_hz": 20.0, "from_m": 0.0004,
        "depth_m": 0.0005, "force_topic": "/measured_cf", "force_n": 0.25, "answers": "/predicted_cf",
    });
    peer.ask(again);
    let after = peer.until("/comparison", |c| c["valid"] == true && number(&c["measured_n"]).abs() < 1e-12);
    assert!(number(&after["measured_n"]).abs() < 1e-12, "{after}");
    assert!((number(&after["measured_force_n"]["z"]) - 0.25).abs() < 1e-12, "the raw reading is published too");

    let reset = peer.ask(json!({"op": "call", "service": "/twin/reset", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(reset["response"]["success"], true);
    let status = peer.until("/status", |s| s["poses_answered"] == 0);
    assert_eq!(status["poses_answered"], 0, "counts start anew: {status}");
    drop(node);
}

#[test]
fn what_is_no_pose_is_refused_counted_and_stops_nothing() {
    let domain = free_domain();
    let node = twin(domain);
    let mut peer = connected(domain);
    model(&mut peer);
    let stamp = |sec: i64| json!({"stamp": {"sec": sec, "nanosec": 0}, "frame_id": ""});
    let now = 1_700_000_000;
    for value in [
        json!({"header": stamp(now), "name": ["insertion"], "position": ["nan"]}),
        json!({"header": stamp(now), "name": ["insertion"], "position": ["inf"]}),
        json!({"header": stamp(now), "name": ["elbow"], "position": [0.001]}),
        json!({"header": stamp(now), "name": ["insertion"], "position": []}),
        json!({"header": stamp(2_147_483_647), "name": ["insertion"], "position": [0.001]}),
    ] {
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
    }
    let good = json!({"header": stamp(now + 1), "name": ["elbow", "insertion"], "position": [9.0, 0.0005]});
    peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": good}));
    let answers = peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 5.0}))["messages"].clone();
    assert_eq!(answers.as_array().unwrap().len(), 1, "{answers}");
    assert_eq!(answers[0]["header"]["stamp"]["sec"], now + 1);
    let status = peer.until("/status", |s| s["poses_rejected"] == 5 && s["poses_answered"] == 1);
    assert_eq!(status["poses_rejected"], 5, "{status}");
    assert_eq!(status["poses_answered"], 1, "{status}");

    // No pose for longer than input_timeout_s: said, and no force is repeated.
    let later = peer.until("/status", |s| s["health"] == 3);
    assert_eq!(later["health"], 3, "{later}");
    assert_eq!(later["prediction_valid"], false);
    let silence = peer.ask(json!({"op": "last", "topic": "/predicted_cf", "seconds": 0.5}));
    assert_eq!(silence["count"], 0);
    let (code, log, _) = node.stop("TERM");
    assert_eq!(code, Some(0));
    assert!(log.contains("joint_name"), "the remedy is named: {log}");
}

#[test]
fn parameters_are_listed_described_set_and_refused() {
    let domain = free_domain();
    let node = twin(domain);
    let mut peer = connected(domain);
    model(&mut peer);
    let call = |peer: &mut Peer, what: &str, kind: &str, request: Value| {
        peer.ask(json!({"op": "call", "service": format!("/twin/{what}"), "type": format!("rcl_interfaces/srv/{kind}"), "request": request}))["response"].clone()
    };
    let listed = call(&mut peer, "list_parameters", "ListParameters", json!({"prefixes": [], "depth": 0}));
    let names: Vec<&str> = listed["result"]["names"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect();
    let qos = "qos_overrides./predicted_cf.publisher.reliability";
    for name in [qos, "scene", "joint_name", "use_sim_time", "material.shear_modulus_pa", "discretisation.spacing_m"] {
        assert!(names.contains(&name), "{names:?}");
    }
    let got = call(
        &mut peer,
        "get_parameters",
        "GetParameters",
        json!({"names": ["discretisation.spacing_m", "nonsense", qos]}),
    );
    assert_eq!(got["values"][2]["string_value"], "reliable");
    assert_eq!(got["values"][0]["double_value"], 0.005);
    assert_eq!(got["values"][1]["type"], 0);
    let types = call(&mut peer, "get_parameter_types", "GetParameterTypes", json!({"names": ["scene", "threads"]}));
    assert_eq!(types["types"], json!([4, 2]));
    let described =
        call(&mut peer, "describe_parameters", "DescribeParameters", json!({"names": ["tissue_rate_hz", "scene"]}));
    assert_eq!(described["descriptors"][0]["floating_point_range"][0]["to_value"], 1000.0);
    assert_eq!(described["descriptors"][1]["read_only"], true);
    let double = |v: f64| json!({"type": 3, "double_value": v});
    let set = call(
        &mut peer,
        "set_parameters",
        "SetParameters",
        json!({"parameters": [
            {"name": "tissue_rate_hz", "value": {"type": 2, "integer_value": 5}},
            {"name": "tissue_rate_hz", "value": double(-1.0)},
            {"name": "scene", "value": {"type": 4, "string_value": "compression"}},
            {"name": "tissue_rate", "value": double(1.0)},
        ]}),
    );
    let results: Vec<bool> =
        set["results"].as_array().unwrap().iter().map(|r| r["successful"].as_bool().unwrap()).collect();
    assert_eq!(results, [true, false, false, false], "{set}");
    assert!(set["results"][1]["reason"].as_str().unwrap().contains("[0, 1000]"), "{set}");
    assert!(set["results"][3]["reason"].as_str().unwrap().contains("tissue_rate_hz"), "{set}");
    let got = call(&mut peer, "get_parameters", "GetParameters", json!({"names": ["tissue_rate_hz"]}));
    assert_eq!(got["values"][0]["double_value"], 5.0);
    drop(node);
}
