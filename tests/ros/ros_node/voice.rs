//! What the node says of itself: endpoints with exact type names, diagnostics, and the loss of its input.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;

use crate::ros::{Peer, coarse_twin, free_domain};
use serde_json::{Value, json};

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_else(|| panic!("no {key}: {value}"))
}

#[test]
fn every_endpoint_has_the_name_type_and_qos_of_the_contract() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "autostart:=false"], &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "wait_matched", "topics": ["/measured_js"]}));
    std::thread::sleep(std::time::Duration::from_millis(500));
    let seen = peer.ask(json!({"op": "endpoints"}))["endpoints"].clone();
    let mut described: BTreeMap<(&str, &str), Vec<String>> = BTreeMap::new();
    for e in seen.as_array().unwrap() {
        let reliability = if e["reliable"] == true { "reliable" } else { "best_effort" };
        let latched = if e["latched"] == true { " latched" } else { "" };
        let text = format!("{} {reliability}{latched}", text(e, "type"));
        described.entry((e["side"].as_str().unwrap(), e["topic"].as_str().unwrap())).or_default().push(text);
    }
    let (publisher, subscription) = ("publisher", "subscription");
    for (side, topic, wanted) in [
        (subscription, "rt/measured_js", "sensor_msgs::msg::dds_::JointState_ best_effort"),
        (subscription, "rt/measured_cp", "geometry_msgs::msg::dds_::PoseStamped_ best_effort"),
        (subscription, "rt/measured_cf", "geometry_msgs::msg::dds_::WrenchStamped_ best_effort"),
        (subscription, "rt/clock", "rosgraph_msgs::msg::dds_::Clock_ best_effort"),
        (publisher, "rt/predicted_cf", "geometry_msgs::msg::dds_::WrenchStamped_ reliable"),
        (publisher, "rt/tissue_model", "needle_twin::msg::dds_::TissueModel_ reliable latched"),
        (publisher, "rt/tissue_state", "needle_twin::msg::dds_::TissueState_ best_effort"),
        (publisher, "rt/tissue_points", "sensor_msgs::msg::dds_::PointCloud2_ best_effort"),
        (publisher, "rt/tissue_surface", "visualization_msgs::msg::dds_::Marker_ best_effort"),
        (publisher, "rt/targets", "geometry_msgs::msg::dds_::PoseArray_ reliable"),
        (publisher, "rt/comparison", "needle_twin::msg::dds_::ForceComparison_ reliable"),
        (publisher, "rt/status", "needle_twin::msg::dds_::TwinStatus_ reliable"),
        (publisher, "rt/events", "needle_twin::msg::dds_::TissueEvent_ reliable latched"),
        (publisher, "rt/region", "std_msgs::msg::dds_::String_ reliable latched"),
        (publisher, "rt/safe_to_go_on", "std_msgs::msg::dds_::Bool_ reliable"),
        (publisher, "rt/safety", "needle_twin::msg::dds_::Safety_ reliable"),
        (publisher, "rt/tf", "tf2_msgs::msg::dds_::TFMessage_ reliable"),
        (publisher, "rt/tf_static", "tf2_msgs::msg::dds_::TFMessage_ reliable latched"),
        (publisher, "rt/diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_ reliable"),
        (publisher, "rt/twin/transition_event", "lifecycle_msgs::msg::dds_::TransitionEvent_ reliable"),
        (publisher, "rt/parameter_events", "rcl_interfaces::msg::dds_::ParameterEvent_ reliable"),
        (publisher, "rt/rosout", "rcl_interfaces::msg::dds_::Log_ reliable latched"),
        (subscription, "rq/twin/resetRequest", "std_srvs::srv::dds_::Trigger_Request_ reliable"),
        (publisher, "rr/twin/resetReply", "std_srvs::srv::dds_::Trigger_Response_ reliable"),
        (subscription, "rq/twin/tareRequest", "std_srvs::srv::dds_::Trigger_Request_ reliable"),
        (subscription, "rq/twin/look_aheadRequest", "needle_twin::srv::dds_::LookAhead_Request_ reliable"),
        (publisher, "rr/twin/look_aheadReply", "needle_twin::srv::dds_::LookAhead_Response_ reliable"),
        (subscription, "rq/twin/change_stateRequest", "lifecycle_msgs::srv::dds_::ChangeState_Request_ reliable"),
        (
            publisher,
            "rr/twin/get_transition_graphReply",
            "lifecycle_msgs::srv::dds_::GetAvailableTransitions_Response_ reliable",
        ),
        (subscription, "rq/twin/set_parametersRequest", "rcl_interfaces::srv::dds_::SetParameters_Request_ reliable"),
    ] {
        let found = described.get(&(side, topic)).unwrap_or_else(|| panic!("{side} {topic} in {described:#?}"));
        assert!(found.iter().any(|f| f == wanted), "{side} {topic}: {found:?}, not {wanted}");
    }
    drop(node);
}

#[test]
fn diagnostics_say_once_a_second_how_it_goes_and_a_lost_input_is_said() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    peer.ask(
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"}),
    );
    peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "subscribe", "topic": "/diagnostics", "type": "diagnostic_msgs/msg/DiagnosticArray"}));
    let topics = ["/measured_js", "/measured_cf", "/diagnostics"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    peer.ask(json!({"op": "take", "topic": "/diagnostics", "timeout": 20.0}));
    let begun = std::time::Instant::now();
    peer.ask(json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 80, "rate_hz": 20.0, "depth_m": 0.0008,
        "force_topic": "/measured_cf", "force_n": 0.01, "n_per_m": 300.0,
    }));
    let arrays = peer.ask(json!({"op": "take", "topic": "/diagnostics", "timeout": 0.1}))["messages"].clone();
    let arrays = arrays.as_array().unwrap();
    let seconds = begun.elapsed().as_secs_f64();
    let each_s = seconds / arrays.len() as f64;
    assert!((0.6..2.0).contains(&each_s), "{} in {seconds} s", arrays.len());
    let by_name: BTreeMap<&str, &Value> =
        arrays.last().unwrap()["status"].as_array().unwrap().iter().map(|s| (text(s, "name"), s)).collect();
    let value = |name: &str, key: &str| -> f64 {
        let values = by_name[name]["values"].as_array().unwrap();
        let found = values.iter().find(|v| v["key"] == key).unwrap_or_else(|| panic!("{name}: {key} in {values:?}"));
        text(found, "value").parse().unwrap()
    };
    assert!(value("twin: prediction", "answered") > 0.0);
    assert!(value("twin: prediction", "latency p50 (ms)") > 0.0);
    assert!(value("twin: prediction", "latency p99 (ms)") >= value("twin: prediction", "latency p50 (ms)"));
    let missed = value("twin: prediction", "missed deadlines");
    assert!(
        missed.fract() == 0.0 && (0.0..=value("twin: prediction", "answered")).contains(&missed),
        "{missed} missed"
    );
    assert!(value("twin: load cell", "residual (N)").is_finite() && value("twin: load cell", "rmse (N)") > 0.0);
    assert!(text(by_name["twin: input"], "message").contains("poses per second"));
    assert_eq!(by_name["twin: prediction"]["hardware_id"], "needle_twin");

    // The sensor falls silent.
    let level = |array: &Value| {
        let all = array["status"].as_array().into_iter().flatten();
        all.filter(|s| s["name"] == "twin: input").map(|s| s["level"].clone()).next()
    };
    let silent = peer.until("/diagnostics", |array| level(array) == Some(json!(3)));
    assert_eq!(level(&silent), Some(json!(3)), "{silent}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    let line = log.lines().find(|l| l.contains("input lost")).unwrap_or_else(|| panic!("{log}"));
    assert!(line.contains("WARN") && line.contains("/measured_js"), "{line}");
}

#[test]
fn a_subscription_that_asks_for_too_much_is_told_the_remedy() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "autostart:=false"], &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({
        "op": "subscribe", "topic": "/predicted_cf", "type": "geometry_msgs/msg/WrenchStamped", "qos": "latched",
    }));
    node.wait_for("qos_overrides./predicted_cf.publisher.durability:=transient_local");
    let (_, log, _) = node.stop("INT");
    let line = log.lines().find(|l| l.contains("/predicted_cf")).unwrap_or_else(|| panic!("{log}"));
    assert!(line.contains("WARN"), "{line}");
    assert!(line.contains("qos_overrides./predicted_cf.publisher.durability:=transient_local"), "{line}");
}
