//! Where sample, tip and load cell are, as tf2 hears it.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, coarse_twin, free_domain, joint_state};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::TransformStamped;
use ros2_messages::std_msgs::Header;
use ros2_messages::tf2_msgs::TFMessage;
use rosbag2_mcap::{BagWriter, Qos, WriterOptions};
use serde_json::{Value, json};

const TF: &str = "tf2_msgs/msg/TFMessage";
const RIG: &str = env!("CARGO_BIN_EXE_rig_node");

/// Parent, child, translation and rotation (x, y, z, w) of each transform of some messages.
fn transforms(messages: &Value) -> Vec<(String, String, [f64; 3], [f64; 4])> {
    let all = messages.as_array().unwrap().iter().flat_map(|m| m["transforms"].as_array().unwrap());
    let number = |of: &Value, name: &str| of[name].as_f64().unwrap_or_else(|| panic!("{name} of {of}"));
    let text = |of: &Value| of.as_str().unwrap().to_owned();
    let read = |t: &Value| {
        let (shift, turn) = (&t["transform"]["translation"], &t["transform"]["rotation"]);
        let (shift, turn) = (["x", "y", "z"].map(|n| number(shift, n)), ["x", "y", "z", "w"].map(|n| number(turn, n)));
        (text(&t["header"]["frame_id"]), text(&t["child_frame_id"]), shift, turn)
    };
    all.map(read).collect()
}

#[test]
fn the_tip_goes_with_the_poses_and_the_load_cell_with_the_tip() {
    let domain = free_domain();
    let frame =
        ["-p", "frame_id:=or1/sample", "-p", "parent_frame_id:=table", "-p", "instrument.load_cell_height_m:=0.05"];
    let node = coarse_twin(domain, &frame, &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "subscribe", "topic": "/tf", "type": TF}));
    peer.connect();
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/tf"]}))["missing"], json!([]));
    // 500 Hz for 0.4 s, longer on a busy machine
    let begun = std::time::Instant::now();
    for i in 0..200_i64 {
        let stamp = 1_700_000_000_000_000_000 + 2_000_000 * i;
        let value = joint_state(stamp / 1_000_000_000, stamp % 1_000_000_000, 1e-6 * i as f64);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let moved = peer.ask(json!({"op": "last", "topic": "/tf", "seconds": 0.5}));
    let count = moved["count"].as_u64().unwrap();
    let most = 20 + (begun.elapsed().as_secs_f64() * 100.0) as u64;
    assert!((10..=most.min(200)).contains(&count), "{count} of 200 poses, at most {most} at 100 Hz");
    let stamp = &moved["message"]["transforms"][0]["header"]["stamp"];
    assert_eq!(*stamp, json!({"sec": 1_700_000_000, "nanosec": 398_000_000}), "the last pose and its stamp");
    let [(parent, child, shift, turn)] = &transforms(&json!([moved["message"]]))[..] else { panic!("{moved}") };
    assert_eq!((parent.as_str(), child.as_str(), turn), ("or1/sample", "or1/needle_tip", &[1.0, 0.0, 0.0, 0.0]));
    assert!(shift[..2] == [0.0; 2] && (shift[2] - (0.017 - 199e-6)).abs() < 1e-12, "{shift:?}");
    // a late subscriber gets what stands still
    peer.ask(json!({"op": "subscribe", "topic": "/tf_static", "type": TF, "qos": "latched"}));
    let fixed = peer.ask(json!({"op": "take", "topic": "/tf_static", "timeout": 10.0}))["messages"].clone();
    let upright = [0.0, 0.0, 0.0, 1.0];
    let named = |a: &str, b: &str, z: f64| (a.to_owned(), b.to_owned(), [0.0, 0.0, z], upright);
    let wanted = [named("table", "or1/sample", 0.0), named("or1/needle_tip", "or1/load_cell", -0.05)];
    assert_eq!(transforms(&fixed), wanted);
    assert_eq!(node.stop("INT").0, Some(0));
}

#[test]
fn another_publisher_of_frames_is_left_alone() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "publish_tf:=false", "-p", "autostart:=false"], &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "wait_matched", "topics": ["/measured_js"]}));
    let seen = peer.ask(json!({"op": "endpoints"}))["endpoints"].clone();
    let topics: Vec<&str> = seen.as_array().unwrap().iter().map(|e| e["topic"].as_str().unwrap()).collect();
    assert!(topics.contains(&"rt/status") && !topics.iter().any(|t| t.starts_with("rt/tf")), "{topics:?}");
    drop(node);
}

/// A recording of a run with a twin has the tip as well: two publishers of one frame would contradict each other.
#[test]
fn recorded_frames_are_played_without_the_tip_unless_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = BagWriter::create(folder.path().join("bag"), WriterOptions::default()).unwrap();
    let topic = writer.add_topic::<TFMessage>("/tf", &Qos::reliable(100)).unwrap();
    let transform = |parent: &str, child: &str| TransformStamped {
        header: Header { stamp: Time { sec: 1_700_000_000, nanosec: 0 }, frame_id: parent.to_owned() },
        child_frame_id: child.to_owned(),
        ..TransformStamped::default()
    };
    for i in 0..3 {
        let at = 1_700_000_000_000_000_000 + 100_000_000 * i;
        let transforms = vec![transform("base", "flange"), transform("sample", "needle_tip")];
        writer.write(topic, at, at, &TFMessage { transforms }).unwrap();
    }
    let bag = writer.finish().unwrap().folder.display().to_string();
    for (asked, wanted) in [(&[][..], 3), (&["-p", "topics:=[/tf]"][..], 6)] {
        let domain = free_domain();
        let paused = ["--ros-args", "-p", "start_paused:=true", "-p", "exit_at_end:=false"];
        let node = Program::start(RIG, &[&[bag.as_str()][..], &paused, asked].concat(), domain, &[]);
        let mut peer = Peer::start(domain);
        peer.ask(json!({"op": "subscribe", "topic": "/tf", "type": TF}));
        assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/tf"]}))["missing"], json!([]));
        peer.ask(json!({"op": "call", "service": "/rig/resume", "type": "rosbag2_interfaces/srv/Resume"}));
        let heard = peer.ask(json!({"op": "take", "topic": "/tf", "timeout": 5.0, "count": 3}))["messages"].clone();
        let heard = transforms(&heard);
        assert_eq!(heard.len(), wanted, "{heard:?}");
        assert_eq!(heard.iter().filter(|t| t.1 == "flange").count(), 3);
        assert_eq!(node.stop("INT").0, Some(0));
    }
}
