//! Members of the scene's uncertain keys, beside the twin: the band of the force and the spread of the targets.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::live_page::{address, until, view};
use crate::ros::{COARSE, Peer, Program, TWIN, coarse_twin, free_domain, joint_state};
use serde_json::{Value, json};

const UNCERTAIN: &str = "\n[[targets]]\nname = \"lesion\"\nposition_m = [0.0, 0.0, 0.012]\n\n[[targets]]\nname = \"vessel\"\n\
    position_m = [0.0, 0.0, 0.008]\n\n[uncertainty]\n\"material.shear_modulus_pa\" = { uniform = [1500, 1900] }\n\
    \"align.contact_depth_m\" = { uniform = [-1e-4, 1e-4] }\n";

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("not a number: {value}"))
}

fn scene(folder: &std::path::Path, more: &str) -> String {
    let mut shown = std::process::Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    let shown = shown.args(["scene", "show", "compression"]).output().unwrap();
    let text = String::from_utf8(shown.stdout).unwrap();
    let path = folder.join("scene.toml");
    std::fs::write(&path, text + more).unwrap();
    path.display().to_string()
}

#[test]
fn a_band_holds_the_prediction_and_targets_have_a_covariance() {
    let (folder, domain) = (tempfile::tempdir().unwrap(), free_domain());
    let scene = scene(folder.path(), UNCERTAIN);
    let more = ["-p", "members:=4", "-p", "page:=true", "-p", "page_port:=0"];
    let arguments: Vec<&str> = ["--scene", &scene].into_iter().chain(COARSE[2..].iter().copied()).chain(more).collect();
    let logs = tempfile::tempdir().unwrap();
    let node = Program::start(TWIN, &arguments, domain, &[("ROS_LOG_DIR", logs.path().to_str().unwrap())]);
    let mut viewer = view(&address(&logs));
    let mut peer = Peer::start(domain);
    for (topic, kind) in [
        ("/prediction_band", "needle_twin/msg/ForceBand"),
        ("/targets_with_covariance", "geometry_msgs/msg/PoseWithCovarianceStamped"),
        ("/predicted_cf", "geometry_msgs/msg/WrenchStamped"),
        ("/outlook", "needle_twin/msg/Outlook"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": "reliable"}));
    }
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    let topics =
        ["/prediction_band", "/targets_with_covariance", "/predicted_cf", "/outlook", "/measured_js", "/measured_cf"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    // pressed, and held until the members have come there too, however long they were built
    let (mut i, mut band) = (0, json!(null));
    while i < 600 && number(&band.get("depth_m").cloned().unwrap_or(json!(0.0))) < 0.00099 {
        i += 1;
        let depth = (2.5e-5 * i as f64).min(0.001);
        let value = joint_state(1_700_000_000 + i / 50, 20_000_000 * (i % 50), depth);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": value}));
        std::thread::sleep(std::time::Duration::from_millis(25));
        if i > 40 && i % 10 == 0 {
            band = peer.ask(json!({"op": "last", "topic": "/prediction_band", "seconds": 0.3}))["message"].clone();
        }
    }
    let force = peer.ask(json!({"op": "last", "topic": "/predicted_cf", "seconds": 0.3}))["message"].clone();
    let force = number(&force["wrench"]["force"]["z"]);
    assert_eq!((&band["members"], &band["header"]["frame_id"]), (&json!(4), &json!("sample")));
    let [low, mean, high] = ["low_n", "mean_n", "high_n"].map(|name| number(&band[name]));
    assert!(force > 0.01 && low < force && force < high, "{force} N in {band}");
    assert!(low < mean && mean < high && number(&band["standard_deviation_n"]) > 0.01 * mean, "{band}");
    assert!(number(&band["header"]["stamp"]["sec"]) >= 1_700_000_000.0, "the stamp is a pose's");
    let seen = until(&mut viewer, "figures", |f| f["band"]["high_n"] == band["high_n"]);
    assert_eq!(seen["band"]["low_n"], band["low_n"], "the live page shows the same");
    let targets = peer.ask(json!({"op": "take", "topic": "/targets_with_covariance", "timeout": 5.0}));
    let targets = targets["messages"].as_array().unwrap();
    let pairs: Vec<_> = targets.chunks_exact(2).collect();
    let pair = pairs.last().unwrap();
    assert_eq!(pair[0]["header"], pair[1]["header"], "one message for each target, with one stamp");
    let height = |target: &Value| number(&target["pose"]["pose"]["position"]["z"]);
    assert!(height(&pair[0]) > height(&pair[1]), "in the scene's order");
    let covariance = pair[0]["pose"]["covariance"].as_array().unwrap();
    assert_eq!(covariance.len(), 36);
    assert!(number(&covariance[14]) > 0.0, "zz: where the plate touches is not known");
    // without a load cell the outlook is that of the members as they were drawn
    let outlook = peer.until("/outlook", |outlook| !outlook.is_null());
    let here = |outlook: &Value| -> Vec<f64> {
        let places = outlook["depths_m"].as_array().unwrap().len();
        let forces = outlook["forces_n"].as_array().unwrap();
        assert_eq!((outlook["members"].as_u64(), forces.len()), (Some(4), 4 * places), "{outlook}");
        forces.iter().step_by(places).map(number).collect()
    };
    let before = here(&outlook);
    let depths = outlook["depths_m"].as_array().unwrap();
    assert!((number(&depths[0]) - 0.001).abs() < 1e-9 && (number(depths.last().unwrap()) - 0.002).abs() < 1e-9);
    assert_eq!((outlook["blocks"].as_u64(), &outlook["error_n"]), (Some(0), &json!(0.0)));
    assert_eq!(outlook["targets_ahead"].as_array().map(Vec::len), Some(4 * 2));
    // held there, with a load cell that says that the tissue is 8 % stiffer than the scene has it
    let (measured, mut learnt) = (1.08 * force, outlook);
    for k in 0..400 {
        i += 1;
        let (sec, nanosec) = (1_700_000_000 + i / 50, 20_000_000 * (i % 50));
        let noise = if k % 2 == 0 { 2e-4 } else { -2e-4 };
        let wrench = json!({"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "sample"},
            "wrench": {"force": {"x": 0.0, "y": 0.0, "z": measured + noise}, "torque": {"x": 0.0, "y": 0.0, "z": 0.0}}});
        peer.ask(json!({"op": "publish", "topic": "/measured_cf", "value": wrench}));
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": joint_state(sec, nanosec, 0.001)}));
        std::thread::sleep(std::time::Duration::from_millis(25));
        if k % 20 == 19 {
            learnt = peer.ask(json!({"op": "last", "topic": "/outlook", "seconds": 0.3}))["message"].clone();
            if learnt["blocks"].as_u64() > Some(10) {
                break;
            }
        }
    }
    assert!(learnt["blocks"].as_u64() > Some(10), "{learnt}");
    let spread = |forces: &[f64]| {
        let mean = forces.iter().sum::<f64>() / 4.0;
        (mean, (forces.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / 3.0).sqrt())
    };
    let ((mean, deviation), (_, prior)) = (spread(&here(&learnt)), spread(&before));
    assert!((mean / measured - 1.0).abs() < 0.01, "{mean} N for {measured} N: {learnt}");
    assert!(deviation < 0.3 * prior && number(&learnt["error_n"]) > 0.0, "{deviation} {prior}: {learnt}");
    assert_eq!(node.stop("INT").0, Some(0));
}

#[test]
fn a_scene_without_priors_is_refused_with_a_remedy_that_a_node_has() {
    let (code, log) = coarse_twin(free_domain(), &["-p", "members:=8"], &[]).ended();
    assert_ne!(code, Some(0));
    assert!(log.contains("add a section [uncertainty]") && log.contains("-p scene:=own.toml"), "{log}");
    assert!(!log.contains("--set"), "an option that a node does not have: {log}");
}

#[test]
fn tracked_points_say_where_the_instrument_touched() {
    let (folder, domain) = (tempfile::tempdir().unwrap(), free_domain());
    let scene = scene(folder.path(), UNCERTAIN);
    let arguments = [&["--scene", &scene][..], &COARSE[2..], &["-p", "members:=6"]].concat();
    let node = Program::start(TWIN, &arguments, domain, &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "subscribe", "topic": "/targets_with_covariance",
        "type": "geometry_msgs/msg/PoseWithCovarianceStamped", "qos": "reliable"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_targets", "type": "geometry_msgs/msg/PoseArray"}));
    let topics = ["/targets_with_covariance", "/measured_js", "/measured_targets"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    let mut i = 0;
    let mut go = |peer: &mut Peer, places: Option<[f64; 2]>| {
        i += 1;
        let (sec, nanosec) = (1_700_000_000 + i / 50, 20_000_000 * (i % 50));
        if let Some(places) = places {
            let pose = |z: f64| json!({"position": {"x": 0.0, "y": 0.0, "z": z}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}});
            let value = json!({"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "sample"}, "poses": places.map(pose)});
            peer.ask(json!({"op": "publish", "topic": "/measured_targets", "value": value}));
        }
        let depth = (2.5e-5 * i as f64).min(0.001);
        peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": joint_state(sec, nanosec, depth)}));
        std::thread::sleep(std::time::Duration::from_millis(25));
    };
    // height and its variance of the upper target, the last that was said
    let lesion = |peer: &mut Peer| -> Option<(f64, f64)> {
        let taken = peer.ask(json!({"op": "take", "topic": "/targets_with_covariance", "timeout": 0.3}));
        let highest = taken["messages"].as_array()?.iter().rev().take(2).map(|m| {
            let pose = &m["pose"];
            (number(&pose["pose"]["position"]["z"]), number(&pose["covariance"][14]))
        });
        highest.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    // held at 1 mm until all members have come to rest there, by 12/17 of the way that the plate has gone
    let mut before = (0.0, 0.0);
    for _ in 0..60 {
        (0..10).for_each(|_| go(&mut peer, None));
        let Some(now) = lesion(&mut peer) else { continue };
        let last = std::mem::replace(&mut before, now);
        if before.0 < 0.01135 && (before.0 - last.0).abs() < 1e-7 {
            break;
        }
    }
    assert!((0.0112..0.01135).contains(&before.0) && before.1 > 1e-10, "{before:?}");
    // seen one standard deviation higher than they have it, with a tracker's noise
    let higher = before.1.sqrt();
    let mut after = before;
    for k in 0..400 {
        let noise = [1e-6, -2e-6, 2e-6, -1e-6][k % 4];
        // the other one is nowhere near a sample: not seen
        go(&mut peer, Some([before.0 + higher + noise, 99.0]));
        if k % 20 == 19 {
            after = lesion(&mut peer).unwrap_or(after);
            if after.1 < 0.05 * before.1 {
                break;
            }
        }
    }
    assert!(after.1 < 0.05 * before.1, "the variance was {} and is {} m2", before.1, after.1);
    assert!((after.0 - before.0 - higher).abs() < 0.3 * higher, "{before:?}, then {after:?}");
    assert_eq!(node.stop("INT").0, Some(0));
}

#[test]
fn members_of_a_scene_that_is_sure_of_everything_end_the_node_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let late = "\n[uncertainty]\n\"align.time_offset_s\" = { uniform = [-0.1, 0.1] }\n";
    for (more, said) in
        [("", "[uncertainty]"), (late, "align.time_offset_s can't be uncertain while the twin runs live")]
    {
        let scene = scene(folder.path(), more);
        let output = std::process::Command::new(TWIN)
            .args(["--scene", &scene, "--ros-args", "-p", "members:=4"])
            .env("ROS_DOMAIN_ID", free_domain().to_string())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.code() == Some(1) && text.contains("parameter members: ") && text.contains(said),
            "{text}"
        );
    }
}
