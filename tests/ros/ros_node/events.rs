//! What happens to the tissue, said once on `events`: to who listens, to who comes later, and to the recording.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, TWIN, free_domain, joint_state};
use rosbag2_mcap::BagReader;
use serde_json::{Value, json};

/// Three regions along a kinematic needle's way.
const LAYERS: &str = r#"
[sample]
shape = "cylinder"
diameter_m = 0.030
height_m = 0.017
[material]
model = "neo_hookean"
shear_modulus_pa = 1678.0
poisson_ratio = 0.49
density_kg_per_m3 = 970.0
[materials.skin]
model = "neo_hookean"
shear_modulus_pa = 5000.0
friction_n_per_m = 2.0
cutting_force_n = 0.002
puncture_force_n = 0.008
[materials.deep]
model = "neo_hookean"
shear_modulus_pa = 1678.0
friction_n_per_m = 2.0
cutting_force_n = 0.002
puncture_force_n = 0.005
[[regions]]
name = "skin"
material = "skin"
shape = "layer"
to_depth_m = 0.0005
[[regions]]
name = "deep"
material = "deep"
shape = "layer"
from_depth_m = 0.0015
to_depth_m = 0.017
[instrument]
kind = "needle"
diameter_m = 0.001
capture_radius_m = 0.0005
deformation_coefficient = 0.4
[discretisation]
spacing_m = 2.33e-3
edge_refinement = 0.11
growth = 0.3
[motion]
depth_m = 0.006
"#;

const EVENTS: &str = "needle_twin/msg/TissueEvent";

/// Starts a twin, lets a peer listen to its events, and sends poses (ms, m).
fn run(arguments: &[&str], poses: &[(i64, f64)], wanted: usize) -> (Program, u16, Vec<Value>) {
    let domain = free_domain();
    let node = Program::start(TWIN, arguments, domain, &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "subscribe", "topic": "/events", "type": EVENTS, "qos": "reliable"}));
    peer.connect();
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/events"]}))["missing"], json!([]));
    for (ms, depth) in poses {
        let value = joint_state(1_700_000_000, 1_000_000 * ms, *depth);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let events = taken(&mut peer, wanted);
    (node, domain, events)
}

fn taken(peer: &mut Peer, wanted: usize) -> Vec<Value> {
    peer.ask(json!({"op": "take", "topic": "/events", "timeout": 20.0, "count": wanted}))["messages"]
        .as_array()
        .unwrap()
        .clone()
}

fn number(event: &Value, key: &str) -> f64 {
    event[key].as_f64().unwrap_or_else(|| panic!("no number {key}: {event}"))
}

#[test]
fn punctures_and_regions_are_said_once_and_kept_for_who_comes_later_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, bag) = (folder.path().join("layers.toml"), folder.path().join("run"));
    std::fs::write(&scene, LAYERS).unwrap();
    let (scene, record) = (scene.display().to_string(), format!("record:={}", bag.display()));
    let arguments = ["--scene", &scene, "--ros-args", "-p", &record, "-p", "record_topics:=['events']"];
    // the last pose is past two regions, as when the poses between were skipped
    let (node, domain, events) = run(&arguments, &[(20, 0.0), (40, 0.0002), (50, 0.003)], 3);
    let said: Vec<[&str; 2]> =
        events.iter().map(|e| [e["kind"].as_str().unwrap(), e["region"].as_str().unwrap()]).collect();
    assert_eq!(said, [["puncture", "skin"], ["layer", "sample"], ["layer", "deep"]], "{events:#?}");
    for (i, event) in events.iter().enumerate() {
        assert_eq!((&event["number"], &event["header"]["frame_id"]), (&json!(i + 1), &json!("sample")), "none is lost");
        assert!(number(event, "interval_s") > 0.009 && number(event, "force_before_n").is_finite(), "{event}");
    }
    assert!((number(&events[1], "depth_m") - 5e-4).abs() < 1e-5, "{events:#?}");
    assert!((number(&events[2], "depth_m") - 1.5e-3).abs() < 1e-5, "{events:#?}");
    assert_eq!(events[1]["header"], events[2]["header"], "of one pose");
    let mut late = Peer::start(domain);
    late.ask(json!({"op": "subscribe", "topic": "/events", "type": EVENTS, "qos": "latched"}));
    assert_eq!(taken(&mut late, events.len()), events, "who comes later hears them too");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    let recorded = BagReader::open(&bag).unwrap().select(|t| t.name == "/events").count();
    assert_eq!(recorded, events.len(), "the recording has them");
}

/// The load cell reads a drop in a place of which the scene knows nothing.
#[test]
fn a_puncture_in_the_measured_force_is_said_as_measured() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("layers.toml");
    std::fs::write(&scene, LAYERS).unwrap();
    let domain = free_domain();
    let node = Program::start(TWIN, &["--scene", &scene.display().to_string()], domain, &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "subscribe", "topic": "/events", "type": EVENTS, "qos": "reliable"}));
    peer.connect();
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/events", "/measured_cf"]}))["missing"], json!([]));
    let drop_m = 9e-4;
    for i in 1..=80_u32 {
        let (depth, nanosec) = (2e-5 * f64::from(i), 10_000_000 * i);
        // what noise there is has no pattern that a smooth force has
        let noise = 2e-4 * (f64::from(i * i % 17) / 8.0 - 1.0);
        let force = 20.0 * depth + noise - if depth < drop_m { 0.0 } else { 0.01 };
        let wrench = json!({"header": {"stamp": {"sec": 1_700_000_000, "nanosec": nanosec}, "frame_id": "sample"},
            "wrench": {"force": {"x": 0.0, "y": 0.0, "z": force}, "torque": {"x": 0.0, "y": 0.0, "z": 0.0}}});
        peer.ask(json!({"op": "publish", "topic": "/measured_cf", "value": wrench}));
        let value = joint_state(1_700_000_000, i64::from(nanosec), depth);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let events = taken(&mut peer, 4);
    let measured: Vec<&Value> = events.iter().filter(|e| e["source"] == "measured").collect();
    assert_eq!(measured.len(), 1, "{events:#?}");
    assert!(events.iter().any(|e| e["source"] == "model"), "{events:#?}");
    let event = measured[0];
    assert_eq!((&event["kind"], &event["region"]), (&json!("puncture"), &json!("")));
    assert!((number(event, "depth_m") - drop_m).abs() < 5e-5, "{event}");
    assert!(number(event, "force_before_n") - number(event, "force_after_n") > 0.007, "{event}");
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}
