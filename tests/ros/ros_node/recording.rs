//! The node records what it hears and says; other programs read it.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::path::Path;

use crate::ros::{COARSE, Peer, Program, TWIN, coarse_twin, free_domain};
use ros2_messages::geometry_msgs::WrenchStamped;
use rosbag2_mcap::{BagReader, check};
use serde_json::json;

fn counts(bag: &BagReader) -> BTreeMap<&str, u64> {
    bag.topics().iter().map(|t| (t.name.as_str(), t.messages)).collect()
}

/// Poses at 50 Hz for 2 s once the model is there; how many were answered.
fn insert(peer: &mut Peer) -> u64 {
    peer.ask(
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"}),
    );
    peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "subscribe", "topic": "/predicted_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "wait_matched", "topics": ["/measured_js", "/predicted_cf"]}));
    let done = peer.ask(json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 100, "rate_hz": 50.0, "depth_m": 0.0005,
        "answers": "/predicted_cf",
    }));
    done["answered"].as_u64().unwrap()
}

#[test]
fn what_was_heard_and_said_is_in_the_bag_however_the_node_is_stopped() {
    for signal in ["INT", "TERM"] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        let record = format!("record:={}", path.display());
        let domain = free_domain();
        let node = coarse_twin(domain, &["-p", &record], &[]);
        let mut peer = Peer::start(domain);
        let answered = insert(&mut peer);
        let (code, log, took) = node.stop(signal);
        assert_eq!(code, Some(0), "{log}");
        assert!(took.as_secs_f64() < 2.0, "{took:?}");
        assert!(log.contains("recorded"), "{log}");

        let report = check(&path).unwrap();
        let bad: Vec<_> = report.findings.iter().filter(|f| f.severity > rosbag2_mcap::Severity::Warning).collect();
        assert!(bad.is_empty(), "{bad:?}");
        let bag = BagReader::open(&path).unwrap();
        assert_eq!(bag.losses(), []);
        let counts = counts(&bag);
        assert_eq!((counts["/measured_js"], counts["/tissue_model"]), (100, 1), "{counts:?}");
        assert!(counts["/predicted_cf"] >= answered && answered > 30, "{answered} {counts:?}");
        // Nobody subscribed these but the recording.
        assert!(counts["/status"] > 10 && counts["/tissue_state"] > 10 && counts["/comparison"] > 10, "{counts:?}");
        assert!(!counts.contains_key("/tissue_points"), "only when asked for");
        let others: Vec<u64> =
            crate::ros::python::run_script("peers/read_bag.py", &[&path, Path::new("/predicted_cf")])
                .lines()
                .map(|l| l.parse().unwrap())
                .collect();
        let own: Vec<u64> = bag
            .select(|t| t.name == "/predicted_cf")
            .map(|m| bag.decode::<WrenchStamped>(&m).unwrap().wrench.force.z.to_bits())
            .collect();
        assert_eq!(own, others, "another reader reads the same");
    }
}

#[test]
fn a_folder_that_is_not_empty_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("precious"), "x").unwrap();
    let record = format!("record:={}", folder.path().display());
    let output = std::process::Command::new(TWIN)
        .args(COARSE)
        .args(["-p", &record])
        .env("ROS_DOMAIN_ID", free_domain().to_string())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("record") && text.contains("exists already"), "{text}");
}

/// A small file system of its own, where the system lets an ordinary user have one.
#[test]
fn a_full_disk_ends_the_recording_and_not_the_node_and_the_bag_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    // `wait` may miss a signal that comes just before it sleeps; a trap between two commands does not. A shell that was
    // started with SIGINT ignored, as in the background of another, can't trap that, so it is told by SIGTERM
    let script = r#"mount -t tmpfs -o size=800k none "$1" && shift || exit 99
        check=$1; bag=$2; shift 2
        "$@" & twin=$!
        trap 'kill -INT $twin' TERM
        while kill -0 $twin 2>/dev/null; do sleep 0.1; done
        wait $twin; code=$?
        "$check" bag check "$bag" >&2 && echo "the bag is sound" >&2
        exit $code"#;
    let trial = ["-rm", "mount", "-t", "tmpfs", "none"];
    let trial = std::process::Command::new("unshare").args(trial).arg(folder.path()).output();
    if !trial.is_ok_and(|o| o.status.success()) {
        eprintln!("not tried: this system gives no private file system (unshare -rm)");
        return;
    }
    let bag = folder.path().join("run").display().to_string();
    let record = format!("record:={bag}");
    let place = folder.path().display().to_string();
    let mut arguments = vec!["-rm", "sh", "-c", script, "sh", &place, env!("CARGO_BIN_EXE_needle_twin"), &bag, TWIN];
    arguments.extend(COARSE);
    // the model in three dimensions says more, and so fills the disk
    let space = ["-p", "discretisation.dimension:=full"];
    arguments.extend(["-p", &record, "-p", "tissue_rate_hz:=200", "-p", "status_rate_hz:=200"].iter().chain(&space));
    let domain = free_domain();
    let node = Program::start("unshare", &arguments, domain, &[]);
    let mut peer = Peer::start(domain);
    let answered = insert(&mut peer) + insert(&mut peer);
    assert!(answered > 60, "the node goes on: {answered}");
    let (code, log, _) = node.stop("TERM");
    assert_eq!(code, Some(3), "{log}");
    assert_eq!(log.matches("the recording stops").count(), 1, "said once: {log}");
    assert!(log.contains("the bag is sound"), "{log}");
}
