//! The rig node, heard and steered by an independent DDS implementation (Eclipse CycloneDDS).
//!
//! Contract: recorded messages come out under their names, complete, in order and in time; the player's services do what
//! `ros2 bag play`'s do; the driver obeys `servo_jp` within its limits; the twin answers the rig over the network.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, free_domain};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::{Float64, Header};
use rosbag2_mcap::{BagWriter, Qos, WriterOptions};
use serde_json::{Value, json};

const TWIN: &str = env!("CARGO_BIN_EXE_twin_node");
const RIG: &str = env!("CARGO_BIN_EXE_rig_node");
const CYCLONE_SERVICES: [(&str, &str); 1] = [("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")];
const START: i64 = 1_700_000_000_000_000_000;

/// `measured_js` and `measured_cf` at 100 Hz over `seconds`, depth rising at 1 mm/s, and a latched topic at the start.
fn bag(folder: &std::path::Path, seconds: i64) -> String {
    let mut writer = BagWriter::create(folder.join("bag"), WriterOptions::default()).unwrap();
    let depth = writer.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
    let force = writer.add_topic::<WrenchStamped>("/measured_cf", &Qos::best_effort(10)).unwrap();
    let latched = writer.add_topic::<Float64>("/sample_temperature", &Qos::transient_local(1)).unwrap();
    let log = |t: i64| u64::try_from(t).unwrap();
    writer.write(latched, log(START), log(START), &Float64 { data: 21.5 }).unwrap();
    for i in 0..seconds * 100 {
        let t = START + i * 10_000_000;
        let header = |frame: &str| Header { stamp: Time::from_nanos(t), frame_id: frame.to_owned() };
        let position = vec![1e-5 * i as f64];
        let joint =
            JointState { header: header(""), name: vec!["insertion".into()], position, ..JointState::default() };
        writer.write(depth, log(t), log(t), &joint).unwrap();
        let wrench = Wrench { force: [0.0, 0.0, 1e-4 * i as f64].into(), ..Wrench::default() };
        writer.write(force, log(t), log(t), &WrenchStamped { header: header("sample"), wrench }).unwrap();
    }
    writer.finish().unwrap().folder.display().to_string()
}

fn rig(domain: u16, arguments: &[&str]) -> Program {
    Program::start(RIG, arguments, domain, &CYCLONE_SERVICES)
}

fn call(peer: &mut Peer, what: &str, kind: &str, request: Value) -> Value {
    peer.ask(json!({
        "op": "call", "service": format!("/rig/{what}"), "type": format!("rosbag2_interfaces/srv/{kind}"), "request": request,
    }))["response"]
        .clone()
}

fn nanos(stamp: &Value) -> i64 {
    stamp["sec"].as_i64().unwrap() * 1_000_000_000 + stamp["nanosec"].as_i64().unwrap()
}

#[test]
fn a_recording_comes_out_complete_in_order_and_steerable() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), 2);
    let domain = free_domain();
    let node = rig(
        domain,
        &[&path, "--ros-args", "-p", "start_paused:=true", "-p", "exit_at_end:=false", "-r", "/measured_cf:=/cell"],
    );
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "subscribe", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(
        json!({"op": "subscribe", "topic": "/cell", "type": "geometry_msgs/msg/WrenchStamped", "qos": "best_effort"}),
    );
    peer.ask(json!({"op": "subscribe", "topic": "/clock", "type": "rosgraph_msgs/msg/Clock", "qos": "best_effort"}));
    let matched = peer.ask(json!({"op": "wait_matched", "topics": ["/measured_js", "/cell", "/clock"]}));
    assert_eq!(matched["missing"], json!([]));

    // Paused: time stands, one message at a time.
    assert_eq!(call(&mut peer, "is_paused", "IsPaused", json!({}))["paused"], true);
    let stands = peer.ask(json!({"op": "last", "topic": "/clock", "seconds": 0.3}));
    assert_eq!(nanos(&stands["message"]["clock"]), START);
    for _ in 0..3 {
        assert_eq!(call(&mut peer, "play_next", "PlayNext", json!({}))["success"], true);
    }
    let first = peer.ask(json!({"op": "take", "topic": "/measured_js", "count": 1}))["messages"].clone();
    assert_eq!(first.as_array().unwrap().len(), 1, "the latched one, a depth and a force");

    assert_eq!(call(&mut peer, "burst", "Burst", json!({"num_messages": 5}))["actually_burst"], 5);
    for paused in [false, true] {
        call(&mut peer, "toggle_paused", "TogglePaused", json!({}));
        assert_eq!(call(&mut peer, "is_paused", "IsPaused", json!({}))["paused"], paused);
    }
    call(&mut peer, "pause", "Pause", json!({}));
    assert_eq!(call(&mut peer, "is_paused", "IsPaused", json!({}))["paused"], true);
    peer.ask(json!({"op": "take", "topic": "/measured_js", "timeout": 0.3, "count": 1000}));

    // Back to the start, at twice the speed.
    let seek = json!({"time": {"sec": START / 1_000_000_000, "nanosec": 0}});
    assert_eq!(call(&mut peer, "seek", "Seek", seek)["success"], true);
    let beyond = json!({"time": {"sec": START / 1_000_000_000 + 60, "nanosec": 0}});
    assert_eq!(call(&mut peer, "seek", "Seek", beyond)["success"], false);
    assert_eq!(call(&mut peer, "set_rate", "SetRate", json!({"rate": -1.0}))["success"], false);
    assert_eq!(call(&mut peer, "set_rate", "SetRate", json!({"rate": 2.0}))["success"], true);
    assert_eq!(call(&mut peer, "get_rate", "GetRate", json!({}))["rate"], 2.0);
    // the same by parameter, which follows the service
    let parameters = |service: &str, kind: &str, request: Value| json!({"op": "call", "service": format!("/rig/{service}"), "type": format!("rcl_interfaces/srv/{kind}"), "request": request});
    let rate = |value: f64| json!({"parameters": [{"name": "rate", "value": {"type": 3, "double_value": value}}]});
    let known = peer.ask(parameters("get_parameters", "GetParameters", json!({"names": ["rate"]})));
    assert_eq!(known["response"]["values"][0]["double_value"], 2.0, "{known}");
    for value in [4.0, 2.0] {
        let set = peer.ask(parameters("set_parameters", "SetParameters", rate(value)));
        assert_eq!(set["response"]["results"][0]["successful"], true, "{set}");
        assert_eq!(call(&mut peer, "get_rate", "GetRate", json!({}))["rate"], value);
    }
    let begun = std::time::Instant::now();
    call(&mut peer, "resume", "Resume", json!({}));
    let depths =
        peer.ask(json!({"op": "take", "topic": "/measured_js", "count": 200, "timeout": 10.0}))["messages"].clone();
    let took = begun.elapsed().as_secs_f64();
    assert!((0.9..1.9).contains(&took), "2 s at rate 2 took {took} s");
    let depths = depths.as_array().unwrap();
    assert_eq!(depths.len(), 200);
    for (i, message) in depths.iter().enumerate() {
        assert_eq!(nanos(&message["header"]["stamp"]), START + i as i64 * 10_000_000);
        assert!((message["position"][0].as_f64().unwrap() - 1e-5 * i as f64).abs() < 1e-15);
        assert_eq!(message["name"], json!(["insertion"]));
    }
    let forces = peer.ask(json!({"op": "take", "topic": "/cell", "count": 200, "timeout": 2.0}))["messages"].clone();
    let count = forces.as_array().unwrap().len();
    // the reliable depths above are complete; best effort may lose some on a busy machine
    assert!(count >= 100, "remapped: {count} of 200");

    // A late joiner gets what is latched, and Ctrl-C ends cleanly.
    peer.ask(
        json!({"op": "subscribe", "topic": "/sample_temperature", "type": "std_msgs/msg/Float64", "qos": "latched"}),
    );
    let latched = peer.ask(json!({"op": "take", "topic": "/sample_temperature"}))["messages"].clone();
    assert_eq!(latched[0]["data"], 21.5);
    let (code, log, took) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(took.as_secs_f64() < 1.0, "{took:?}");
    assert!(log.contains("behind their time"), "{log}");
}

#[test]
fn rig_and_twin_exchange_over_the_network_and_the_stamps_are_the_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), 3);
    let domain = free_domain();
    let twin = Program::start(
        TWIN,
        &[
            "--scene",
            "compression",
            "--ros-args",
            "-p",
            "discretisation.spacing_m:=0.005",
            "-p",
            "discretisation.edge_refinement:=1.0",
            "-p",
            "stepping.max_steps_per_pose:=4",
            "-p",
            "use_sim_time:=true",
        ],
        domain,
        &CYCLONE_SERVICES,
    );
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/predicted_cf", "geometry_msgs/msg/WrenchStamped", "reliable"),
        ("/comparison", "needle_twin/msg/ForceComparison", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    let model = peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}))["messages"].clone();
    assert_eq!(model[0]["scene"], "compression");
    peer.ask(json!({"op": "wait_matched", "topics": ["/predicted_cf", "/comparison"]}));
    // Played to the end, the rig leaves by itself.
    let rig = rig(domain, &[&path, "--ros-args", "-p", "delay:=2.0"]);
    let forces =
        peer.ask(json!({"op": "take", "topic": "/predicted_cf", "count": 300, "timeout": 10.0}))["messages"].clone();
    let forces = forces.as_array().unwrap();
    assert!(forces.len() >= 150, "{} of 300 poses answered", forces.len());
    let stamps: Vec<i64> = forces.iter().map(|f| nanos(&f["header"]["stamp"])).collect();
    assert!(stamps.windows(2).all(|w| w[0] < w[1]), "in order, none twice");
    assert!(stamps.iter().all(|t| (t - START) % 10_000_000 == 0), "only stamps of recorded poses");
    let compared = peer.until("/comparison", |c| c["valid"] == true);
    assert_eq!(compared["valid"], true, "{compared}");
    let (code, log, _) = twin.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    drop(rig);
}

#[test]
fn the_driver_obeys_within_its_limits() {
    let domain = free_domain();
    let node = rig(
        domain,
        &[
            "--ros-args",
            "-p",
            "mode:=driver",
            "-p",
            "driver_rate_hz:=200",
            "-p",
            "max_speed_m_per_s:=0.01",
            "-r",
            "__ns:=/or1",
        ],
    );
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "subscribe", "topic": "/or1/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "advertise", "topic": "/or1/servo_jp", "type": "sensor_msgs/msg/JointState"}));
    let matched = peer.ask(json!({"op": "wait_matched", "topics": ["/or1/measured_js", "/or1/servo_jp"]}));
    assert_eq!(matched["missing"], json!([]));
    peer.ask(json!({"op": "take", "topic": "/or1/measured_js", "count": 1}));
    peer.ask(json!({"op": "publish", "topic": "/or1/servo_jp", "value": {"name": ["insertion"], "position": [0.004]}}));
    let messages =
        peer.ask(json!({"op": "take", "topic": "/or1/measured_js", "count": 200, "timeout": 5.0}))["messages"].clone();
    let positions: Vec<f64> = messages.as_array().unwrap().iter().map(|m| m["position"][0].as_f64().unwrap()).collect();
    assert!(positions.windows(2).all(|w| w[1] >= w[0] && w[1] - w[0] <= 0.01 / 200.0 + 1e-12), "{positions:?}");
    assert_eq!(*positions.last().unwrap(), 0.004);
    let (code, _, _) = node.stop("TERM");
    assert_eq!(code, Some(0));
}

#[test]
fn what_can_not_be_played_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), 1);
    for (arguments, code, word) in [
        (vec![], 2, "bag"),
        (vec!["/nowhere/bag"], 1, "/nowhere/bag"),
        (vec![path.as_str(), "--ros-args", "-p", "topics:=[/wrong]"], 1, "/measured_js"),
        (vec![path.as_str(), "--ros-args", "-p", "rate:=-1.0"], 2, "rate"),
        (vec![path.as_str(), "--ros-args", "-p", "ratee:=1.0"], 2, "`rate`"),
        (vec!["--nonsense"], 2, "--nonsense"),
    ] {
        let output = std::process::Command::new(RIG)
            .args(&arguments)
            .env("ROS_DOMAIN_ID", free_domain().to_string())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
        assert!(text.contains(word), "{arguments:?}: {text}");
    }
}

#[test]
fn what_is_latched_comes_first_when_starting_late() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), 2);
    let domain = free_domain();
    let late = ["-p", "start_offset:=1.5", "-p", "start_paused:=true", "-p", "exclude_topics:=[/measured_cf]"];
    let node = rig(domain, &[&[path.as_str(), "--ros-args"][..], &late].concat());
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/sample_temperature", "std_msgs/msg/Float64", "latched"),
        ("/measured_js", "sensor_msgs/msg/JointState", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    assert_eq!(
        peer.ask(json!({"op": "wait_matched", "topics": ["/sample_temperature", "/measured_js"]}))["missing"],
        json!([])
    );
    for _ in 0..2 {
        assert_eq!(call(&mut peer, "play_next", "PlayNext", json!({}))["success"], true);
    }
    let latched = peer.ask(json!({"op": "take", "topic": "/sample_temperature"}))["messages"].clone();
    assert_eq!(latched[0]["data"], 21.5, "from before the offset");
    let first = peer.ask(json!({"op": "take", "topic": "/measured_js"}))["messages"].clone();
    assert_eq!(nanos(&first[0]["header"]["stamp"]), START + 1_500_000_000);
    drop(node);
}
