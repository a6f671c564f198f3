//! Names, hashes and quality of service as rmw_zenoh_cpp of ROS 2 Jazzy has them.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, coarse_twin, free_domain};
use ros2_messages::schema::{recorded_types, schema};
use ros2_messages::{hashed_types, type_hash};
use serde_json::{Value, json};

#[test]
fn every_hash_of_a_type_is_that_of_an_independent_implementation() {
    let mut peer = Peer::start(free_domain());
    // two types of the twin's own recordings are no part of the peer's list of standard messages
    let recorded: Vec<(String, String)> = recorded_types().map(|t| (t.clone(), schema(&t).unwrap().hash)).collect();
    let listed = hashed_types().map(|(name, hash)| (name.to_owned(), hash.to_owned()));
    let all: Vec<(String, String)> = listed.chain(recorded).collect();
    let names: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
    let computed = peer.ask(json!({"op": "hashes", "types": names}))["hashes"].clone();
    assert_eq!(computed.as_array().unwrap().len(), all.len());
    for ((name, hash), computed) in all.iter().zip(computed.as_array().unwrap()) {
        assert_eq!((computed, type_hash(name).as_ref()), (&json!(hash), Some(hash)), "{name}");
    }
}

/// Tokens of the twin's session: kind, enclave, namespace, node, name, type, hash, QoS.
fn tokens(peer: &mut Peer) -> Vec<Vec<String>> {
    let tokens = peer.ask(json!({"op": "graph_tokens"}))["tokens"].clone();
    let parts = |token: &Value| token.as_array().unwrap().iter().map(|p| p.as_str().unwrap().to_owned()).collect();
    tokens.as_array().unwrap().iter().map(parts).collect()
}

#[test]
fn the_graph_has_every_endpoint_as_rmw_zenoh_writes_it() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-r", "__ns:=/or1"], &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "advertise", "topic": "/or1/measured_js", "type": "sensor_msgs/msg/JointState"}));
    let missing = peer.ask(json!({"op": "wait_matched", "topics": ["/or1/measured_js"]}))["missing"].clone();
    assert_eq!(missing, json!([]));
    std::thread::sleep(std::time::Duration::from_millis(500));
    let found = tokens(&mut peer);
    let (domain_text, session) = (domain.to_string(), found[0][2].clone());
    for token in &found {
        assert_eq!((&*token[0], &token[1], &token[2], &*token[3]), ("@ros2_lv", &domain_text, &session, "0"));
        assert_eq!((&*token[6], &*token[7], &*token[8]), ("%", "%or1", "twin"), "{token:?}");
    }
    let mut numbers: Vec<u32> = found.iter().map(|t| t[4].parse().unwrap()).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, (0..found.len() as u32).collect::<Vec<_>>(), "every entity has a number of its own");
    let node_tokens: Vec<_> = found.iter().filter(|t| t[5] == "NN").collect();
    assert!(node_tokens.len() == 1 && node_tokens[0].len() == 9 && node_tokens[0][4] == "0", "{node_tokens:?}");
    for (kind, name, dds_type, hash, qos) in [
        ("MP", "%or1%predicted_cf", "geometry_msgs::msg::dds_::WrenchStamped_", "RIHS01_8dc3deaf", "::,10:,:,:,,"),
        ("MP", "%or1%tissue_model", "needle_twin::msg::dds_::TissueModel_", "RIHS01_fd30b3de", ":1:,1:,:,:,,"),
        ("MP", "%or1%tissue_points", "sensor_msgs::msg::dds_::PointCloud2_", "RIHS01_9198cabf", "2::,5:,:,:,,"),
        ("MP", "%rosout", "rcl_interfaces::msg::dds_::Log_", "RIHS01_e28ce254", ":1:,1:,:,:,,"),
        ("MP", "%parameter_events", "rcl_interfaces::msg::dds_::ParameterEvent_", "RIHS01_043e6277", "::,1000:,:,:,,"),
        ("MS", "%or1%measured_cp", "geometry_msgs::msg::dds_::PoseStamped_", "RIHS01_10f3786d", "2::,"),
        ("SS", "%or1%twin%reset", "std_srvs::srv::dds_::Trigger_", "RIHS01_eeff2cd6", "::,10:,:,:,,"),
        ("SS", "%or1%twin%get_parameters", "rcl_interfaces::srv::dds_::GetParameters_", "RIHS01_bf9803d5", "::,10:"),
        ("SS", "%or1%twin%look_ahead", "needle_twin::srv::dds_::LookAhead_", "RIHS01_99a4a04d", "::,10:"),
    ] {
        let fits = |t: &&Vec<String>| t[5] == kind && t.get(9).is_some_and(|n| n == name);
        let token = found.iter().find(fits).unwrap_or_else(|| panic!("{kind} {name} in {found:#?}"));
        assert!(token[10] == dds_type && token[11].starts_with(hash) && token[12].starts_with(qos), "{token:?}");
    }
    drop(node);
    assert_eq!(peer.ask(json!({"op": "participants", "wanted": 0}))["others"], 0, "who is killed is gone at once");
}

#[test]
fn a_topic_with_another_definition_or_type_is_said_and_nothing_of_it_is_taken() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    let other = format!("RIHS01_{}", "0".repeat(64));
    peer.ask(
        json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped", "hash": other}),
    );
    peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": "std_msgs/msg/String"}));
    assert!(peer.steps(&[(1_000_000_000, 0.0001)])[0].is_some(), "the twin goes on");
    std::thread::sleep(std::time::Duration::from_millis(500));
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(
        log.contains("`/measured_cf`: a publisher has another definition of geometry_msgs/msg/WrenchStamped"),
        "{log}"
    );
    assert!(log.contains("`/measured_cp`: a publisher of type std_msgs/msg/String is on this topic"), "{log}");
    assert!(log.contains("over Zenoh") && log.contains("services as rmw_zenoh_cpp has them"), "{log}");
}

/// What was said before they came reaches readers who ask for it, and changes are announced.
#[test]
fn who_comes_later_has_the_log_and_the_model_and_hears_of_changed_parameters() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut first = Peer::start(domain);
    first.connect();
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/rosout", "rcl_interfaces/msg/Log", "latched"),
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/parameter_events", "rcl_interfaces/msg/ParameterEvent", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    let take = |peer: &mut Peer, topic: &str| {
        peer.ask(json!({"op": "take", "topic": topic, "timeout": 10.0}))["messages"].as_array().unwrap().clone()
    };
    let (lines, models) = (take(&mut peer, "/rosout"), take(&mut peer, "/tissue_model"));
    assert_eq!((lines.len(), models.len()), (1, 1), "the last line and the model");
    assert_eq!(lines[0]["name"], "twin");
    let value = json!({"name": "status_rate_hz", "value": {"type": 3, "double_value": 25.0}});
    let set = peer.ask(json!({"op": "call", "service": "/twin/set_parameters_atomically",
        "type": "rcl_interfaces/srv/SetParametersAtomically", "request": {"parameters": [value]}}));
    assert_eq!(set["response"]["result"]["successful"], true, "{set}");
    let events = take(&mut peer, "/parameter_events");
    assert_eq!(events[0]["changed_parameters"][0]["name"], "status_rate_hz", "{events:?}");
    // an answer that DDS would cut into pieces
    let names: Vec<String> = std::iter::repeat_n("status_rate_hz".to_owned(), 500).collect();
    let long = peer.ask(json!({"op": "call", "service": "/twin/describe_parameters",
        "type": "rcl_interfaces/srv/DescribeParameters", "request": {"names": names}}));
    assert_eq!(long["response"]["descriptors"].as_array().unwrap().len(), 500);
    drop(node);
}
