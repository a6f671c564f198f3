//! `needle_twin demo`, as a newcomer starts it.
//!
//! Contract: it ends by itself within a minute with exit code 0, everything went through two ROS 2 nodes, what was
//! published is in a bag that can be replayed, and the report is there. `--no-dds` gives the same files offline.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;
use std::process::{Command, Output};
use std::time::Instant;

use ros2_messages::geometry_msgs::WrenchStamped;
use ros2_messages::sensor_msgs::JointState;
use rosbag2_mcap::BagReader;
use serde_json::Value;

use testkit::python::run_script;

const FILES: [&str; 6] = ["metrics.json", "force.csv", "targets.csv", "final.vtu", "force.png", "report.html"];

fn demo(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .current_dir(folder)
        .args(arguments)
        // What the user's shell says of ROS must not disturb it.
        .env("ROS_DOMAIN_ID", "0")
        .env("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
        .output()
        .unwrap()
}

fn metrics(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("metrics.json")).unwrap()).unwrap()
}

#[test]
fn without_arguments_it_shows_everything_and_ends_within_a_minute() {
    let folder = tempfile::tempdir().unwrap();
    let begun = Instant::now();
    let out = demo(folder.path(), &[]);
    let took = begun.elapsed().as_secs_f64();
    let (text, log) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    let results = folder.path().join("out/demo");
    let node = |name: &str| std::fs::read_to_string(results.join(name)).unwrap_or_default();
    assert_eq!(out.status.code(), Some(0), "{text}{log}{}{}", node("twin_node.log"), node("rig_node.log"));
    assert!(took < 60.0, "{took} s");
    assert!(text.contains("needle_insertion") && text.contains("peak predicted"), "{text}");
    assert!(log.contains("predicted force") && log.contains("measured force"), "{log}");
    let first = log.lines().next().unwrap_or_default();
    let page = first.split("http://127.0.0.1:").nth(1).and_then(|rest| rest.split_once('/')).map(|(port, _)| port);
    let served = format!("live page: http://127.0.0.1:{}/#token=", page.unwrap_or("none in the first line"));
    assert!(node("twin_node.log").contains(&served), "{first}\n{}", node("twin_node.log"));

    for file in FILES {
        let length = std::fs::metadata(results.join(file)).unwrap_or_else(|e| panic!("{file}: {e}")).len();
        assert!(length > 0, "{file}");
    }
    let metrics = metrics(&results);
    let number = |pointer: &str| metrics.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    assert!(number("/force/peak_measured_n") > 0.05, "{metrics}");
    let (predicted, measured) = (number("/force/peak_predicted_n"), number("/force/peak_measured_n"));
    assert!((predicted / measured - 1.0).abs() < 0.5, "predicted {predicted} N, measured {measured} N");

    // the second act
    let layered = results.join("layered_tissue");
    assert!(text.contains("second act") && text.contains("layered_tissue"), "{text}");
    let events = self::metrics(&layered)["events"].as_array().unwrap().clone();
    let punctured: Vec<&str> =
        events.iter().filter(|e| e["kind"] == "puncture").filter_map(|e| e["region"].as_str()).collect();
    assert_eq!(punctured, ["skin", "muscle"], "{events:?}");

    // What was published can be replayed: every answer has the stamp of a pose that the rig sent.
    let bag = BagReader::open(results.join("published")).unwrap();
    assert!(bag.losses().is_empty() && bag.warnings().is_empty(), "{:?} {:?}", bag.losses(), bag.warnings());
    let of = |name: &str| {
        let name = name.to_owned();
        bag.select(move |t| t.name == name)
    };
    let poses: std::collections::BTreeSet<i64> =
        of("/measured_js").map(|m| bag.decode::<JointState>(&m).unwrap().header.stamp.nanos()).collect();
    let answers: Vec<i64> =
        of("/predicted_cf").map(|m| bag.decode::<WrenchStamped>(&m).unwrap().header.stamp.nanos()).collect();
    assert!(poses.len() > 3000, "{} poses", poses.len());
    assert!(!answers.is_empty() && answers.iter().all(|stamp| poses.contains(stamp)));
    let recorded = bag.describe_topics();
    let file = results.join("published/published_0.mcap");
    let layouts = ["foxglove.json", "plotjuggler.xml"];
    let layouts = layouts.map(|l| Path::new(env!("CARGO_MANIFEST_DIR")).join("launch-scripts/layouts").join(l));
    let missing = run_script("peers/layout_paths.py", &[&file, &layouts[0], &layouts[1]]);
    // it is large and follows from tissue_model and tissue_state
    assert_eq!(missing.trim(), r#"["/tissue_surface"]"#, "what layouts draw and a recording lacks");
    for topic in ["/comparison", "/status", "/tissue_model", "/tissue_state", "/measured_cf", "/diagnostics"] {
        assert!(recorded.contains(topic), "{topic} is not in {recorded}");
    }
}

#[test]
fn offline_it_gives_the_same_files_and_a_folder_that_can_not_be_written_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let blocked = folder.path().join("file");
    std::fs::write(&blocked, "").unwrap();
    let begun = Instant::now();
    let out = demo(folder.path(), &["demo", "--out", "file/x"]);
    assert_eq!(out.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&out.stderr).contains("file/x"));
    assert!(begun.elapsed().as_secs_f64() < 5.0, "before anything is started");

    let out = demo(folder.path(), &["demo", "--no-dds", "--out", "offline"]);
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    for file in FILES {
        assert!(folder.path().join("offline").join(file).exists(), "{file}");
    }
    assert!(metrics(&folder.path().join("offline"))["force"]["peak_measured_n"].as_f64().unwrap() > 0.05);
}
