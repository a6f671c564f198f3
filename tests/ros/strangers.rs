//! Rigs as strangers bring them, live: a load cell of one axis, and a second machine on `/joint_states`.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, connected_twin, free_domain};
use serde_json::{Value, json};

const START: i64 = 1_700_000_000_000_000_000;
const POSES: i64 = 80;

/// An insertion by 1.6 mm at 20 Hz, answered pose by pose, and the forces.
fn insertion(peer: &mut Peer, number: i64, topic: &str, cell: impl Fn(usize) -> Option<[Value; 3]>) -> Vec<f64> {
    insertion_with(peer, number, topic, 0, cell)
}

/// The same with a load cell whose stamps are so many ns ahead.
fn insertion_with(
    peer: &mut Peer,
    number: i64,
    topic: &str,
    ahead: i64,
    cell: impl Fn(usize) -> Option<[Value; 3]>,
) -> Vec<f64> {
    let begin = START + 100_000_000_000 * number;
    let poses: Vec<(i64, f64)> = (0..POSES).map(|i| (begin + 50_000_000 * i, 2e-5 * i as f64)).collect();
    let wrenches: Vec<Option<[Value; 3]>> = (0..POSES as usize).map(cell).collect();
    let answer = peer.ask(json!({
        "op": "steps", "topic": topic, "joint": "insertion", "poses": poses, "answers": "/predicted_cf",
        "wrench_topic": "/measured_cf", "wrenches": wrenches, "ahead": ahead,
    }));
    answer["forces"].as_array().unwrap().iter().map(|f| f.as_f64().expect("answered")).collect()
}

fn status(peer: &mut Peer) -> Value {
    peer.ask(json!({"op": "last", "topic": "/status", "seconds": 0.4}))["message"].clone()
}

/// ros2_control fills what a cell with one axis does not measure with NaN (row 11 of issue 59).
#[test]
fn a_load_cell_with_nan_along_two_axes_is_compared_along_the_third() {
    for axis in [2, 0] {
        let domain = free_domain();
        let (node, mut peer) = connected_twin(domain, &[]);
        with_cell(&mut peer, "geometry_msgs/msg/WrenchStamped");
        let truth = insertion(&mut peer, 0, "/measured_js", |_| None);
        let reset = peer.ask(json!({"op": "call", "service": "/twin/reset", "type": "std_srvs/srv/Trigger"}));
        assert_eq!(reset["response"]["success"], true);
        let forces = insertion(&mut peer, 1, "/measured_js", |i| {
            let mut wrench = [json!("nan"), json!("nan"), json!("nan")];
            wrench[axis] = json!(truth[i]);
            Some(wrench)
        });
        assert_eq!(forces, truth, "the prediction is the same");
        let compared = peer.until("/comparison", |c| c["valid"] == true);
        let status = status(&mut peer);
        println!("axis {axis}: {compared}\n{status}");
        assert_eq!((&compared["valid"], &compared["load_cell"]), (&json!(true), &json!(0)), "{compared}");
        assert!(compared["residual_n"].as_f64().unwrap().abs() < 1e-6, "{compared}");
        assert!(!status["reasons"].to_string().contains("reading"), "{status}");
        let (code, log, _) = node.stop("INT");
        assert_eq!(code, Some(0));
        assert_eq!(log.matches("does not measure along").count(), 1, "said once: {log}");
    }
}

/// Another robot's joints on the same topic are no loss, whichever speaks first (row 15 of issue 59).
#[test]
fn a_second_publisher_of_joint_states_is_no_loss() {
    let domain = free_domain();
    let remapped = ["-r", "measured_js:=/joint_states"];
    let node = crate::ros::coarse_twin(domain, &remapped, &[]);
    let (mut rig, mut robot) = (Peer::start(domain), Peer::start(domain));
    for peer in [&mut rig, &mut robot] {
        peer.ask(json!({"op": "advertise", "topic": "/joint_states", "type": "sensor_msgs/msg/JointState"}));
    }
    for (topic, kind, qos) in [
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/predicted_cf", "geometry_msgs/msg/WrenchStamped", "reliable"),
        ("/status", "needle_twin/msg/TwinStatus", "reliable"),
    ] {
        rig.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    rig.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    for peer in [&mut rig, &mut robot] {
        assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/joint_states"]}))["missing"], json!([]));
    }
    assert_eq!(rig.ask(json!({"op": "wait_matched", "topics": ["/predicted_cf", "/status"]}))["missing"], json!([]));
    let mut others = |count: i64, from: i64| {
        for i in 0..count {
            let stamp = json!({"sec": (START + from) / 1_000_000_000, "nanosec": 5_000_000 * i});
            let header = json!({"stamp": stamp, "frame_id": ""});
            let value = json!({"header": header, "name": ["gripper_left", "gripper_right"], "position": [0.01, 0.02]});
            robot.ask(json!({"op": "publish", "topic": "/joint_states", "value": value}));
        }
    };
    others(10, 0);
    let mut forces = Vec::new();
    for part in 0..4_i64 {
        // the robot speaks between the needle's poses
        let number = |i: i64| 20 * part + i;
        let poses: Vec<(i64, f64)> = (0..20).map(number).map(|i| (START + 50_000_000 * i, 2e-5 * i as f64)).collect();
        let answer = rig.ask(json!({"op": "steps", "topic": "/joint_states", "joint": "insertion", "poses": poses,
            "answers": "/predicted_cf"}));
        forces.extend(answer["forces"].as_array().unwrap().clone());
        others(50, 1_000_000_000 * (part + 1));
    }
    assert!(forces.iter().all(Value::is_number), "{forces:?}");
    // the needle's driver is silent for longer than the input may be, and goes on
    std::thread::sleep(std::time::Duration::from_millis(1200));
    others(50, 5_000_000_000);
    let poses: Vec<(i64, f64)> = (0..20).map(|i| (START + 6_000_000_000 + 50_000_000 * i, 1.6e-3)).collect();
    rig.ask(json!({"op": "steps", "topic": "/joint_states", "joint": "insertion", "poses": poses,
        "answers": "/predicted_cf"}));
    let status = status(&mut rig);
    println!("{status}");
    assert_eq!(status["poses_answered"], 100, "{status}");
    assert_eq!(status["poses_rejected"], 10, "those before the needle's driver spoke, with the remedy: {status}");
    assert_eq!((&status["health"], &status["prediction_valid"]), (&json!(0), &json!(true)), "{status}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    assert_eq!(log.matches("no such joint").count(), 1, "no warning for ever: {log}");
    assert!(log.contains("name the one whose position is the depth") && !log.contains("two publishers"), "{log}");
}

/// A stamp with more nanoseconds than a second has is none, as offline (row 16 of issue 59).
#[test]
fn a_stamp_that_is_no_time_is_none() {
    let (node, mut peer) = connected_twin(free_domain(), &[]);
    let header = json!({"stamp": {"sec": START / 1_000_000_000, "nanosec": 3_000_000_000_u32}, "frame_id": ""});
    let value = json!({"header": header, "name": ["insertion"], "position": [0.0005]});
    peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
    let answers = peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 5.0}))["messages"].clone();
    let stamp = &answers[0]["header"]["stamp"];
    assert!(stamp["sec"].as_i64().unwrap() > START / 1_000_000_000 + 1_000_000, "the time of arrival: {answers}");
    assert!(stamp["nanosec"].as_i64().unwrap() < 1_000_000_000, "{answers}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    assert_eq!(log.matches("has no stamps that are times").count(), 1, "{log}");
}

/// `measured_cf` of a type, and the subscription to the comparison.
fn with_cell(peer: &mut Peer, kind: &str) {
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": kind}));
    peer.ask(json!({"op": "subscribe", "topic": "/comparison", "type": "needle_twin/msg/ForceComparison"}));
    let matched = peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cf", "/comparison"]}));
    assert_eq!(matched["missing"], json!([]));
}

/// Older CRTK speaks TransformStamped, stages PointStamped (row 16 of issue 59); offline both are read.
#[test]
fn poses_of_other_types_are_answered_as_depths_are() {
    const HEIGHT_M: f64 = 0.017;
    let down = json!({"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0});
    let (node, mut peer) = connected_twin(free_domain(), &[]);
    let truth = insertion(&mut peer, 0, "/measured_js", |_| None);
    assert_eq!(node.stop("INT").0, Some(0));
    for kind in ["TransformStamped", "PointStamped", "PoseWithCovarianceStamped"] {
        let full = format!("geometry_msgs/msg/{kind}");
        let (node, mut peer) = connected_twin(free_domain(), &["-p", &format!("measured_cp_type:={full}")]);
        peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": full}));
        assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cp"]}))["missing"], json!([]));
        for (i, wanted) in (0..).zip(&truth).take(40) {
            let nanos = 50_000_000 * i;
            let stamp = json!({"sec": START / 1_000_000_000 + nanos / 1_000_000_000, "nanosec": nanos % 1_000_000_000});
            let place = json!({"x": 0.0, "y": 0.0, "z": HEIGHT_M - 2e-5 * i as f64});
            let mut value = json!({"header": {"stamp": stamp, "frame_id": "sample"}});
            match kind {
                "TransformStamped" => value["transform"] = json!({"translation": place, "rotation": down}),
                "PointStamped" => value["point"] = place,
                _ => value["pose"] = json!({"pose": {"position": place, "orientation": down}}),
            }
            peer.ask(json!({"op": "publish", "topic": "/measured_cp", "value": value}));
            let answer = peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 5.0}))["messages"].clone();
            let force = answer[0]["wrench"]["force"]["z"].as_f64().expect("answered");
            assert!((force - wanted).abs() < 1e-6, "{kind}, pose {i}: {force} N, of the depth {wanted} N");
        }
        let (code, log, _) = node.stop("INT");
        assert_eq!((code, log.matches("refused").count()), (Some(0), 0), "{log}");
    }
    // a type that is not named is said, with the parameter that names it
    let (node, mut peer) = connected_twin(free_domain(), &[]);
    peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": "geometry_msgs/msg/TransformStamped"}));
    node.wait_for("-p measured_cp_type:=");
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("geometry_msgs/msg/TransformStamped") && log.contains("-p measured_cp_type:="), "{log}");
}

/// A Wrench without a stamp has the time of its arrival (row 16 of issue 59).
#[test]
fn a_wrench_without_a_stamp_is_compared() {
    let kind = "geometry_msgs/msg/Wrench";
    let (node, mut peer) = connected_twin(free_domain(), &["-p", &format!("measured_cf_type:={kind}")]);
    with_cell(&mut peer, kind);
    let wrench = json!({"force": {"x": 0.0, "y": 0.0, "z": 0.05}, "torque": {"x": 0.0, "y": 0.0, "z": 0.0}});
    for i in 0..40 {
        peer.ask(json!({"op": "publish", "topic": "/measured_cf", "value": wrench}));
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
        let pose = crate::ros::joint_state(now.as_secs() as i64, now.subsec_nanos().into(), 2e-5 * f64::from(i));
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": pose}));
        peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 5.0}));
    }
    let compared = peer.until("/comparison", |c| c["valid"] == true);
    assert_eq!((&compared["valid"], &compared["measured_n"]), (&json!(true), &json!(0.05)), "{compared}");
    assert_eq!(node.stop("INT").0, Some(0));
}

/// A load cell on another time base, as TAI: the offset is found, and the option takes it off (row 12 of issue 59).
#[test]
fn a_load_cell_on_another_clock_is_said_with_its_offset_and_compared_without_it() {
    for (more, is_compared) in [(&[][..], false), (&["-p", "time_offset_s:=37.0"][..], true)] {
        let (node, mut peer) = connected_twin(free_domain(), more);
        with_cell(&mut peer, "geometry_msgs/msg/WrenchStamped");
        let cell = |i: usize| Some([json!(0.0), json!(0.0), json!(0.05 + 1e-3 * i as f64)]);
        insertion_with(&mut peer, 0, "/measured_js", 37_000_000_000, cell);
        let compared = peer.until("/comparison", |c| c["valid"] == is_compared);
        let ahead = |s: &Value| s["reasons"].to_string().contains("ahead of those of the poses");
        let status = peer.until("/status", |s| !s.is_null() && ahead(s) != is_compared);
        assert_eq!(compared["valid"], json!(is_compared), "{compared}");
        let reasons = status["reasons"].to_string();
        assert_eq!(!is_compared, ahead(&status), "{reasons}");
        assert!(is_compared || reasons.contains("-p time_offset_s:=37.0"), "{reasons}");
        assert_eq!(node.stop("INT").0, Some(0));
    }
}

/// Poses in mm are refused, and the unit is named (row 17 of issue 59).
#[test]
fn poses_in_millimetres_are_said() {
    let (node, mut peer) = connected_twin(free_domain(), &[]);
    peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": "geometry_msgs/msg/PoseStamped"}));
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cp"]}))["missing"], json!([]));
    for i in 0..10 {
        let stamp = json!({"sec": START / 1_000_000_000, "nanosec": 50_000_000 * i});
        let place = json!({"position": {"x": 0.0, "y": 0.0, "z": 30.0}, "orientation": {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}});
        let value = json!({"header": {"stamp": stamp, "frame_id": "sample"}, "pose": place});
        peer.ask(json!({"op": "publish", "topic": "/measured_cp", "value": value}));
    }
    // a pose that waits while the next one comes is skipped, and nobody looks at it
    let refused = |s: &Value| s["poses_rejected"].as_u64().unwrap_or(0) + s["poses_coalesced"].as_u64().unwrap_or(0);
    let status = peer.until("/status", |s| refused(s) == 10);
    assert!(refused(&status) == 10 && status["poses_rejected"] != 0 && status["poses_answered"] == 0, "{status}");
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("away from where the instrument meets the sample") && log.contains("in mm"), "{log}");
}

/// A tracker has all its tools on one topic: that of the tip is named, and the others are no loss (row 16 of issue 59).
#[test]
fn several_tools_on_one_topic_are_named() {
    const HEIGHT_M: f64 = 0.017;
    let kind = "geometry_msgs/msg/TransformStamped";
    let named = ["-p", "joint_name:=tip"];
    for more in [&[][..], &named[..]] {
        let typed = format!("measured_cp_type:={kind}");
        let (node, mut peer) = connected_twin(free_domain(), &[&["-p", &typed][..], more].concat());
        peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": kind}));
        assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cp"]}))["missing"], json!([]));
        let mut answered = 0;
        for i in 0..20 {
            let nanos = 50_000_000 * i;
            let stamp = json!({"sec": START / 1_000_000_000 + nanos / 1_000_000_000, "nanosec": nanos % 1_000_000_000});
            for (tool, z) in [("pointer", 0.2), ("tip", HEIGHT_M - 2e-5 * i as f64)] {
                let value = json!({
                    "header": {"stamp": stamp, "frame_id": "sample"}, "child_frame_id": tool,
                    "transform": {"translation": {"x": 0.0, "y": 0.0, "z": z}, "rotation": {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}},
                });
                peer.ask(json!({"op": "publish", "topic": "/measured_cp", "value": value}));
            }
            let seconds = if more.is_empty() { 0.05 } else { 5.0 };
            let answers =
                peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": seconds}))["messages"].clone();
            answered += answers.as_array().map_or(0, Vec::len);
        }
        let (code, log, _) = node.stop("INT");
        assert_eq!(code, Some(0));
        if more.is_empty() {
            assert!(log.contains("the poses of `pointer` and of `tip`") && log.contains("joint_name"), "{log}");
            assert!(answered <= 1, "{answered}: nobody knows which tool is the tip\n{log}");
        } else {
            assert_eq!(answered, 20, "{log}");
            assert!(log.matches("is the pose of `pointer`").count() <= 1, "{log}");
        }
    }
}
