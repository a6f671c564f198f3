//! Callers on different middlewares, at the same time.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{CYCLONE_AS_ROS, Peer, coarse_twin, free_domain, middleware_of, resident_mb};
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::{Context, Name, NodeName, NodeOptions, QosProfile, ServiceMapping, ServiceTypeName};
use ros2_messages::std_srvs::{TriggerRequest, TriggerResponse};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// The call as ros2-client's own programs make it.
#[derive(Clone, Default, Serialize, Deserialize)]
struct Call(TriggerRequest);

#[derive(Serialize, Deserialize)]
struct Answer(TriggerResponse);

impl ros2_client::Message for Call {}
impl ros2_client::Message for Answer {}

#[derive(Clone, Default, Serialize, Deserialize)]
struct ListParameters {
    prefixes: Vec<String>,
    depth: u64,
}

#[derive(Serialize, Deserialize)]
struct Listed {
    names: Vec<String>,
    prefixes: Vec<String>,
}

impl ros2_client::Message for ListParameters {}
impl ros2_client::Message for Listed {}

/// Calls a service as a caller with this mapping does, until it answers.
fn call<Q: ros2_client::Message + Clone + Default + 'static, R: ros2_client::Message + 'static>(
    participant: DomainParticipantBuilder,
    mapping: ServiceMapping,
    [service, package, kind]: [&str; 3],
) -> Option<R> {
    let context = Context::from_domain_participant(participant.build().unwrap()).unwrap();
    let mut node = context.new_node(NodeName::new("/", "caller").unwrap(), NodeOptions::new()).unwrap();
    let (name, kind) = (Name::parse(service).unwrap(), ServiceTypeName::new(package, kind));
    let qos = QosProfile::publisher_default();
    let client = node.create_client::<Q, R>(mapping, &name, &kind, qos.clone(), qos).unwrap();
    let begun = Instant::now();
    // on a machine that others keep busy a first answer has taken more than 8 s
    while begun.elapsed() < Duration::from_secs(60) {
        client.send_request(Q::default()).unwrap();
        let asked = Instant::now();
        while asked.elapsed() < Duration::from_millis(500) {
            if let Ok(Some((_, response))) = client.receive_response() {
                return Some(response);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    None
}

/// Calls `/twin/reset`.
fn reset(domain: u16, mapping: ServiceMapping) -> bool {
    let participant = DomainParticipantBuilder::new(domain).with_only_networks([std::net::Ipv4Addr::LOCALHOST]);
    let answer: Option<Answer> = call::<Call, _>(participant, mapping, ["/twin/reset", "std_srvs", "Trigger"]);
    answer.is_some_and(|Answer(response)| response.success && response.message.contains("undeformed"))
}

#[test]
fn each_caller_is_answered_in_its_own_manner() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    let call = json!({"op": "call", "service": "/twin/reset", "type": "std_srvs/srv/Trigger"});
    assert_eq!(peer.ask(call.clone())["response"]["success"], true, "rmw_cyclonedds' manner");
    assert!(reset(domain, ServiceMapping::Enhanced), "rmw_fastrtps' manner");
    assert_eq!(peer.ask(call)["response"]["success"], true);
    let state = json!({"op": "call", "service": "/twin/get_state", "type": "lifecycle_msgs/srv/GetState"});
    let label = peer.ask(state)["response"]["current_state"]["label"].clone();
    assert!(label == "active" || label == "configuring", "autostart: {label}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    assert!(log.contains("rmw_fastrtps_cpp and rmw_cyclonedds_cpp"), "{log}");
}

/// Discovery may tell the node of a caller's request before it tells who reads the answer.
#[test]
fn an_answer_waits_for_its_reader() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    let early =
        json!({"op": "call_early", "service": "/twin/reset", "type": "std_srvs/srv/Trigger", "reader_after_s": 3.0});
    assert_eq!(peer.ask(early)["response"]["success"], true);
    // One that never reads its answer keeps nobody else waiting.
    let deaf = json!({"op": "garble", "dds_topic": "rq/twin/resetRequest", "bodies": ["00".repeat(17)], "times": 50,
        "dds_type": "std_srvs::srv::dds_::Trigger_Request_"});
    assert_eq!(peer.ask(deaf)["heard"], 1);
    let state = json!({"op": "call", "service": "/twin/get_state", "type": "lifecycle_msgs/srv/GetState"});
    assert_eq!(peer.ask(state)["response"]["current_state"]["label"], "active");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}

#[test]
fn a_change_is_announced_on_parameter_events_and_rosout() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind) in
        [("/parameter_events", "rcl_interfaces/msg/ParameterEvent"), ("/rosout", "rcl_interfaces/msg/Log")]
    {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind}));
    }
    assert_eq!(
        peer.ask(json!({"op": "wait_matched", "topics": ["/parameter_events", "/rosout"]}))["missing"],
        json!([])
    );
    let value = |v: f64| json!({"name": "status_rate_hz", "value": {"type": 3, "double_value": v}});
    let set = |v: f64| {
        json!({"op": "call", "service": "/twin/set_parameters_atomically", "type": "rcl_interfaces/srv/SetParametersAtomically",
               "request": {"parameters": [value(v)]}})
    };
    assert_eq!(peer.ask(set(25.0))["response"]["result"]["successful"], true);
    let refused = peer.ask(set(-1.0))["response"]["result"].clone();
    assert!(
        refused["successful"] == false && refused["reason"].as_str().unwrap().contains("status_rate_hz"),
        "{refused}"
    );
    let events =
        peer.ask(json!({"op": "take", "topic": "/parameter_events", "timeout": 2.0, "count": 2}))["messages"].clone();
    assert_eq!(events.as_array().unwrap().len(), 1, "only what was changed: {events}");
    assert_eq!(events[0]["node"], "/twin");
    let changed = &events[0]["changed_parameters"][0];
    assert_eq!((&changed["name"], &changed["value"]["double_value"]), (&json!("status_rate_hz"), &json!(25.0)));
    let lines = peer.ask(json!({"op": "take", "topic": "/rosout", "timeout": 1.0, "count": 100}))["messages"].clone();
    let line = lines.as_array().unwrap().iter().find(|l| l["msg"].as_str().unwrap().contains("status_rate_hz"));
    let line = line.unwrap_or_else(|| panic!("{lines}"));
    assert_eq!((&line["level"], &line["name"]), (&json!(20), &json!("twin")), "{line}");
    drop(node);
}

/// Levels of loggers as rclcpp's nodes have them, and the file in ROS_LOG_DIR.
#[test]
fn levels_of_loggers_are_set_and_the_log_is_in_a_file() {
    let domain = free_domain();
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("log").display().to_string();
    let node = coarse_twin(domain, &["-p", "logger_service:=true"], &[("ROS_LOG_DIR", &logs)]);
    let mut peer = Peer::start(domain);
    let mut call = |service: &str, request: Value| {
        let kind = format!("rcl_interfaces/srv/{service}");
        let name = if service.starts_with('G') { "/twin/get_logger_levels" } else { "/twin/set_logger_levels" };
        peer.ask(json!({"op": "call", "service": name, "type": kind, "request": request, "timeout": 20.0}))["response"]
            .clone()
    };
    let level = |level: u32| json!({"levels": [{"name": "twin", "level": level}]});
    let set = call("SetLoggerLevels", level(40));
    assert_eq!(set["results"][0]["successful"], true, "{set}");
    assert_eq!(call("GetLoggerLevels", json!({"names": ["twin"]}))["levels"][0]["level"], 40);
    let refused = call("SetLoggerLevels", level(7))["results"][0].clone();
    assert!(refused["successful"] == false && refused["reason"].as_str().unwrap().contains("20 info"), "{refused}");
    let (code, log, _) = node.stop("INT");
    assert!(code == Some(0) && log.contains("heard by") && !log.contains("stopping"), "from ERROR on: {log}");
    let files: Vec<_> = std::fs::read_dir(&logs).unwrap().flatten().collect();
    assert!(files.len() == 1 && files[0].file_name().to_string_lossy().starts_with("twin_"), "{files:?}");
    assert!(std::fs::read_to_string(files[0].path()).unwrap().contains("heard by"));
}

/// `ros2 param list`, `param dump` and `lifecycle list -a` ask for answers that don't go into one datagram of a network card.
#[test]
fn long_answers_reach_a_peer_that_announces_its_network_card() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]);
    let mut peer = Peer::start_with(domain, CYCLONE_AS_ROS);
    let call = |service: &str, kind: &str, request: Value| json!({"op": "call", "service": format!("/twin/{service}"), "type": kind, "request": request, "timeout": 20.0});
    let list =
        peer.ask(call("list_parameters", "rcl_interfaces/srv/ListParameters", json!({"prefixes": [], "depth": 0})));
    let names = list["response"]["result"]["names"].clone();
    let bytes: usize = names.as_array().unwrap().iter().map(|n| n.as_str().unwrap().len() + 5).sum();
    assert!(bytes > 1452, "{bytes} bytes: an answer that is cut: {list}");
    for (service, kind, of) in [
        ("describe_parameters", "rcl_interfaces/srv/DescribeParameters", "descriptors"),
        ("get_parameters", "rcl_interfaces/srv/GetParameters", "values"),
    ] {
        let answer = peer.ask(call(service, kind, json!({"names": names})));
        assert_eq!(answer["response"][of].as_array().map(Vec::len), names.as_array().map(Vec::len), "{answer}");
    }
    drop(node);
}

/// `ros2 param list` on rmw_fastrtps as it is installed: a caller that announces every address of the machine, and whose identity
/// stands beside the answer, which is lost if it is cut (on a machine without a network card nothing would cut it).
#[test]
fn a_long_answer_in_the_manner_of_rmw_fastrtps_is_not_cut_on_this_machine() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let list = ["/twin/list_parameters", "rcl_interfaces", "ListParameters"];
    let caller = DomainParticipantBuilder::new(domain);
    let listed: Listed = call::<ListParameters, _>(caller, ServiceMapping::Enhanced, list).expect("an answer");
    let bytes: usize = listed.names.iter().map(|n| n.len() + 5).sum();
    assert!(bytes > 1452, "{bytes} bytes: an answer that a network card would cut");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    assert!(!log.contains("WARN"), "nothing is lost, so nothing is said: {log}");
}

/// An answer of many datagrams is whole, and a request of a megabyte is not taken and leaves nothing behind.
#[test]
fn a_long_answer_is_whole_and_a_long_request_costs_no_memory() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    let get = |names: usize, timeout: f64| {
        json!({"op": "call", "service": "/twin/get_parameters", "type": "rcl_interfaces/srv/GetParameters",
            "request": {"names": vec!["joint_name"; names]}, "timeout": timeout, "quiet": true})
    };
    for names in [500, 3000] {
        let whole = peer.ask(get(names, 20.0))["response"]["values"].clone();
        let values = whole.as_array().unwrap_or_else(|| panic!("{whole}"));
        assert!(values.len() == names && values.iter().all(|v| v["string_value"] == "insertion"), "{whole}");
    }
    // a name of any length is refused with a few of its letters
    let set = |bytes: usize, timeout: f64| {
        json!({"op": "call", "service": "/twin/set_parameters", "type": "rcl_interfaces/srv/SetParameters",
            "request": {"parameters": [{"name": "n".repeat(bytes), "value": {"type": 1, "bool_value": true}}]},
            "timeout": timeout, "quiet": true})
    };
    let refused = peer.ask(set(50_000, 20.0))["response"]["results"][0].clone();
    let reason = refused["reason"].as_str().unwrap_or_else(|| panic!("{refused}"));
    assert!(refused["successful"] == false && reason.len() < 500, "{reason}");
    // requests of a megabyte are not taken, and leave nothing behind
    let process = middleware_of(node.id()).unwrap();
    let before = (resident_mb(node.id()), resident_mb(process));
    for _ in 0..10 {
        assert_eq!(peer.ask(set(1_000_000, 0.3))["response"], json!(null));
    }
    assert_eq!(
        peer.ask(get(2, 20.0))["response"]["values"][1]["string_value"],
        "insertion",
        "the next one is answered"
    );
    let after = (resident_mb(node.id()), resident_mb(process));
    println!("node and its middleware: {before:.1?} MB, {after:.1?} MB after ten requests of 1 MB");
    assert!(after.0 < before.0 + 40.0 && after.1 < before.1 + 80.0, "{before:?}, {after:?}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("60000 are taken"), "{log}");
}
