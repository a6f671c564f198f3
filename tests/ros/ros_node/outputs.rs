//! What viewers see, and poses in free motion.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, TWIN, free_domain};
use serde_json::{Value, json};

/// A region of the same constants.
const SKIN: &str = "[materials.skin]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\n\
    density_kg_per_m3 = 970.0\n[[regions]]\nname = \"skin\"\nmaterial = \"skin\"\nshape = \"layer\"\nto_depth_m = 0.006\n";

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("not a number: {value}"))
}

/// 32-bit floats of a cloud, by field.
fn column(cloud: &Value, name: &str) -> Vec<f32> {
    let field = cloud["fields"].as_array().unwrap().iter().find(|f| f["name"] == name).unwrap();
    assert_eq!((&field["datatype"], &field["count"]), (&json!(7), &json!(1)));
    let offset = field["offset"].as_u64().unwrap() as usize;
    let data: Vec<u8> = cloud["data"].as_array().unwrap().iter().map(|b| b.as_u64().unwrap() as u8).collect();
    let step = cloud["point_step"].as_u64().unwrap() as usize;
    data.chunks_exact(step).map(|p| f32::from_le_bytes(p[offset..offset + 4].try_into().unwrap())).collect()
}

#[test]
fn poses_move_the_tissue_that_viewers_see_and_the_targets_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let shown = std::process::Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["scene", "show", "compression"])
        .output()
        .unwrap();
    let text = String::from_utf8(shown.stdout).unwrap()
        + "\n[[targets]]\nname = \"lesion\"\nposition_m = [0.0, 0.0, 0.012]\n"
        + SKIN;
    std::fs::write(&scene, text).unwrap();
    let (scene, domain) = (scene.display().to_string(), free_domain());
    let mut arguments = vec!["--scene", scene.as_str()];
    arguments.extend(&crate::ros::COARSE[2..]);
    let node = Program::start(TWIN, &arguments, domain, &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/tissue_points", "sensor_msgs/msg/PointCloud2", "best_effort"),
        ("/tissue_surface", "visualization_msgs/msg/Marker", "best_effort"),
        ("/targets", "geometry_msgs/msg/PoseArray", "reliable"),
        ("/region", "std_msgs/msg/String", "latched"),
        ("/status", "needle_twin/msg/TwinStatus", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": "geometry_msgs/msg/PoseStamped"}));
    let model = peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}))["messages"][0].clone();
    assert_eq!(model["target_names"], json!(["lesion"]));
    let topics = ["/tissue_points", "/tissue_surface", "/targets", "/measured_cp"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    // In another frame first: refused.
    for (i, frame) in std::iter::once("world").chain(std::iter::repeat_n("sample", 40)).enumerate() {
        let depth = 2.5e-5 * i as f64;
        let stamp = json!({"sec": 1_700_000_000, "nanosec": 20_000_000 * (i as i64 + 1)});
        let pose = json!({"position": {"x": 0.0, "y": 0.0, "z": 0.017 - depth}, "orientation": {"x": 1.0, "w": 0.0}});
        let value = json!({"header": {"stamp": stamp, "frame_id": frame}, "pose": pose});
        peer.ask(json!({"op": "publish", "topic": "/measured_cp", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(25));
    }
    let said = peer.ask(json!({"op": "take", "topic": "/region"}));
    let region = said["messages"].as_array().unwrap().last().unwrap()["data"].clone();
    let status = peer.until("/status", |s| s["region"] == region);
    assert_eq!([&region, &status["region"]], [&json!("skin"); 2]);
    let cloud = peer.until("/tissue_points", |cloud| !cloud.is_null());
    let points = model["reference_points"].as_array().unwrap();
    assert_eq!(
        (cloud["header"]["frame_id"].as_str(), cloud["width"].as_u64()),
        (Some("sample"), Some(points.len() as u64))
    );
    let (z, moved) = (column(&cloud, "z"), column(&cloud, "displacement"));
    let sunk = points.iter().zip(&z).map(|(p, z)| number(&p["z"]) - f64::from(*z)).fold(0.0, f64::max);
    assert!(sunk > 2e-4, "the top goes down with the plate: {sunk} m");
    assert!(moved.iter().all(|u| u.is_finite()) && column(&cloud, "jacobian").iter().all(|j| *j > 0.0));
    let surface = peer.until("/tissue_surface", |surface| !surface.is_null());
    let corners = model["surface_triangles"].as_array().unwrap().len();
    assert_eq!((&surface["type"], surface["points"].as_array().unwrap().len()), (&json!(11), corners));
    assert_eq!(surface["colors"].as_array().unwrap().len(), corners);
    let targets = peer.until("/targets", |targets| !targets.is_null());
    let lesion = number(&targets["poses"][0]["position"]["z"]);
    assert!(lesion < 0.012 - 5e-5 && lesion > 0.010, "the lesion goes with the tissue: {lesion}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    assert!(log.contains("measured_cp: it is in frame `world`"), "{log}");
}

/// Values of the diagnostics by their keys, after some poses.
fn diagnosed(peer: &mut Peer, from: i64) -> std::collections::BTreeMap<String, String> {
    for i in from..from + 30 {
        let value = crate::ros::joint_state(1_700_000_000 + i / 50, 20_000_000 * (i % 50), 1e-5 * i as f64);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let last = peer.ask(json!({"op": "last", "topic": "/diagnostics", "seconds": 1.5}))["message"].clone();
    let status = last["status"].as_array().unwrap().iter();
    let values = status.flat_map(|s| s["values"].as_array().unwrap().clone());
    let text = |v: &Value| v.as_str().unwrap().to_owned();
    values.map(|v| (text(&v["key"]), text(&v["value"]))).collect()
}

#[test]
fn what_nobody_subscribes_to_is_not_computed() {
    let domain = free_domain();
    let node = crate::ros::coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    assert_eq!(
        peer.ask(json!({"op": "wait_matched", "topics": ["/measured_js", "/diagnostics"]}))["missing"],
        json!([])
    );
    let counters = ["displacements computed", "targets computed", "volume ratios computed", "stresses computed"];
    let counts = |values: &std::collections::BTreeMap<String, String>| {
        counters.map(|name| values.get(name).unwrap_or_else(|| panic!("{name}: {values:?}")).parse::<u64>().unwrap())
    };
    let values = diagnosed(&mut peer, 1);
    assert!(values["answered"].parse::<u64>().unwrap() > 20, "{values:?}");
    assert_eq!(counts(&values), [0; 4]);
    peer.ask(json!({"op": "subscribe", "topic": "/tissue_surface", "type": "visualization_msgs/msg/Marker", "qos": "best_effort"}));
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/tissue_surface"]}))["missing"], json!([]));
    let [displacements, targets, ratios, stresses] = counts(&diagnosed(&mut peer, 31));
    assert!(displacements > 0, "a surface needs displacements");
    assert_eq!([targets, ratios, stresses], [0; 3], "and nothing else");
    assert_eq!(node.stop("INT").0, Some(0));
}
