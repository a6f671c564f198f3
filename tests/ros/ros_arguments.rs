//! What a ROS user types at the programs works, and what is wrong is said with the culprit's name.
//!
//! Contract: exit code 2 and one message for a wrong command line, environment or parameter; names, namespaces and
//! remaps move every topic and service; parameter files, wildcards and the order of the command line count.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::command_line;
use std::process::{Command, Output};

use crate::ros::{Peer, Program, free_domain};
use proptest::prelude::*;
use serde_json::json;

const TWIN: &str = env!("CARGO_BIN_EXE_twin_node");
const CYCLONE_SERVICES: [(&str, &str); 1] = [("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")];

fn output(arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    Command::new(TWIN)
        .args(arguments)
        .env("ROS_DOMAIN_ID", free_domain().to_string())
        .envs(environment.iter().copied())
        .output()
        .unwrap()
}

#[test]
fn wrong_usage_ends_with_2_and_one_message_that_names_the_culprit() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let unknown = file("unknown.yaml", "/twin:\n  ros__parameters:\n    joint_nam: x\n");
    let kind = file("kind.yaml", "/**:\n  ros__parameters:\n    a:\n      - 1\n    threads: two\n");
    let range = file("range.yaml", "twin:\n  ros__parameters:\n    material:\n      poisson_ratio: 0.5\n");
    let broken = file("broken.yaml", "/twin:\n  ros__parameters: [\n");
    for (arguments, environment, words) in [
        (vec!["--ros-args", "-p", "joint_nam:=x"], vec![], vec!["joint_nam", "joint_name"]),
        (vec!["--ros-args", "-p", "input_timeout_s:=soon"], vec![], vec!["input_timeout_s", "double"]),
        (vec!["--ros-args", "-p", "input_timeout_s:=0"], vec![], vec!["input_timeout_s", "0.01"]),
        (vec!["--ros-args", "-p", "scene:=needle_insertoin"], vec![], vec!["needle_insertoin", "needle_insertion"]),
        (vec!["--ros-args", "-p", "material.poisson_ratio:=0.5"], vec![], vec!["material.poisson_ratio", "0.5"]),
        (vec!["--ros-args", "-r", "measured_js=x"], vec![], vec!["measured_js=x"]),
        (vec!["--ros-args", "-r", "a b:=x"], vec![], vec!["a b"]),
        (vec!["--ros-args", "--log-levl", "debug"], vec![], vec!["--log-levl", "--log-level"]),
        (vec!["--ros-args", "--params-file", "/nowhere.yaml"], vec![], vec!["/nowhere.yaml"]),
        (vec!["--ros-args", "--params-file", &unknown], vec![], vec!["unknown.yaml:3", "joint_name"]),
        (vec!["--ros-args", "--params-file", &kind], vec![], vec!["kind.yaml:5", "threads", "integer"]),
        (vec!["--ros-args", "--params-file", &range], vec![], vec!["range.yaml:4", "poisson_ratio"]),
        (vec!["--ros-args", "--params-file", &broken], vec![], vec!["broken.yaml:"]),
        (vec!["--ros-args", "-p", "qos_overrides./measured_js.subscription.depth:=-1"], vec![], vec!["depth"]),
        (vec!["--scene"], vec![], vec!["--scene"]),
        (vec!["--speed", "9"], vec![], vec!["--speed"]),
        (vec![], vec![("ROS_DOMAIN_ID", "300")], vec!["ROS_DOMAIN_ID", "300"]),
        (vec![], vec![("ROS_SECURITY_ENABLE", "true")], vec!["ROS_SECURITY_ENABLE"]),
    ] {
        let out = output(&arguments, &environment);
        let text = String::from_utf8_lossy(&out.stderr);
        let code = out.status.code().unwrap();
        assert!(code == 2 || code == 1, "{arguments:?} {environment:?}: {code} {text}");
        assert!(out.stdout.is_empty(), "diagnostics go to stderr");
        for word in words {
            assert!(text.contains(word), "{arguments:?} {environment:?}: `{word}` is not in: {text}");
        }
        assert_eq!(
            text.matches("twin_node: ").count(),
            usize::from(!text.starts_with("error:")),
            "one message: {text}"
        );
    }
}

#[test]
fn help_and_version_go_to_stdout() {
    for flag in ["--help", "--version"] {
        let out = output(&[flag], &[]);
        assert_eq!(out.status.code(), Some(0));
        assert!(String::from_utf8_lossy(&out.stdout).contains("twin_node"));
    }
}

#[test]
fn two_twins_in_two_namespaces_hear_only_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let parameters = folder.path().join("p.yaml");
    // Wildcards, nesting and order: the second node's own entry wins over the one for all.
    std::fs::write(
        &parameters,
        "/**:\n  ros__parameters:\n    joint_name: all\n    discretisation:\n      spacing_m: 0.005\n      edge_refinement: 1.0\n\
         /or2/sim:\n  ros__parameters:\n    joint_name: second\n",
    )
    .unwrap();
    let file = parameters.display().to_string();
    let domain = free_domain();
    // As `ros2 launch` writes it: several groups.
    let first = Program::start(
        TWIN,
        &[
            "--scene",
            "compression",
            "--ros-args",
            "--log-level",
            "info",
            "--ros-args",
            "-r",
            "__ns:=/or1",
            "--params-file",
            &file,
        ],
        domain,
        &CYCLONE_SERVICES,
    );
    let second = Program::start(
        TWIN,
        &[
            "--scene",
            "compression",
            "--ros-args",
            "-r",
            "__node:=sim",
            "-r",
            "__ns:=/or2",
            "--params-file",
            &file,
            "-r",
            "predicted_cf:=/or2/force",
            "-r",
            "~/reset:=/or2/clear",
        ],
        domain,
        &CYCLONE_SERVICES,
    );
    let mut peer = Peer::start(domain);
    for (topic, kind) in [
        ("/or1/status", "needle_twin/msg/TwinStatus"),
        ("/or2/status", "needle_twin/msg/TwinStatus"),
        ("/or1/predicted_cf", "geometry_msgs/msg/WrenchStamped"),
        ("/or2/force", "geometry_msgs/msg/WrenchStamped"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind}));
    }
    for topic in ["/or1/measured_js", "/or2/measured_js"] {
        peer.ask(json!({"op": "advertise", "topic": topic, "type": "sensor_msgs/msg/JointState"}));
    }
    for topic in ["/or1/tissue_model", "/or2/tissue_model"] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": "needle_twin/msg/TissueModel", "qos": "latched"}));
        let built = peer.ask(json!({"op": "take", "topic": topic, "timeout": 60.0}))["messages"].clone();
        assert_eq!(built.as_array().unwrap().len(), 1, "{topic}");
    }
    let topics =
        ["/or1/status", "/or2/status", "/or1/predicted_cf", "/or2/force", "/or1/measured_js", "/or2/measured_js"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));

    let pose =
        json!({"header": {"stamp": {"sec": 1_700_000_000, "nanosec": 5}}, "name": ["second"], "position": [-0.001]});
    peer.ask(json!({"op": "publish", "topic": "/or2/measured_js", "value": pose}));
    let answer = peer.ask(json!({"op": "take", "topic": "/or2/force", "timeout": 10.0}))["messages"].clone();
    assert_eq!(answer[0]["header"]["stamp"]["nanosec"], 5);
    let silent = peer.ask(json!({"op": "last", "topic": "/or1/predicted_cf", "seconds": 0.3}));
    assert_eq!(silent["count"], 0);
    let status = peer.ask(json!({"op": "last", "topic": "/or1/status", "seconds": 0.5}))["message"].clone();
    assert_eq!((&status["poses_received"], &status["poses_rejected"]), (&json!(0), &json!(0)));

    let cleared = peer.ask(json!({"op": "call", "service": "/or2/clear", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(cleared["response"]["success"], true);
    let names = json!({"names": ["joint_name", "discretisation.spacing_m"]});
    let values = peer.ask(json!({
        "op": "call", "service": "/or2/sim/get_parameters", "type": "rcl_interfaces/srv/GetParameters", "request": names,
    }));
    assert_eq!(values["response"]["values"][0]["string_value"], "second");
    assert_eq!(values["response"]["values"][1]["double_value"], 0.005);
    for node in [first, second] {
        let (code, log, _) = node.stop("INT");
        assert_eq!(code, Some(0), "{log}");
        assert!(!log.contains("ERROR"), "{log}");
    }
}

#[test]
fn a_qos_that_does_not_fit_is_said_with_the_remedy_and_the_remedy_works() {
    let domain = free_domain();
    let strict = "qos_overrides./measured_js.subscription.reliability:=reliable";
    let coarse = "scene:=compression";
    let node = Program::start(TWIN, &["--ros-args", "-p", strict, "-p", coarse], domain, &[]);
    let mut peer = Peer::start(domain);
    peer.ask(
        json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState", "qos": "best_effort"}),
    );
    peer.ask(json!({"op": "advertise", "topic": "/measured_cp", "type": "sensor_msgs/msg/JointState"}));
    node.wait_for("-p qos_overrides./measured_js.subscription.reliability:=best_effort");
    node.wait_for("JointState, and");
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("-p qos_overrides./measured_js.subscription.reliability:=best_effort"), "{log}");
    assert!(log.contains("/measured_cp") && log.contains("JointState"), "a foreign type is said too: {log}");

    let node = Program::start(TWIN, &["--ros-args", "-p", coarse], domain, &[]);
    let matched = peer.ask(json!({"op": "wait_matched", "topics": ["/measured_js"]}));
    assert_eq!(matched["missing"], json!([]));
    drop(node);
}

#[test]
fn without_input_it_says_what_it_waits_for() {
    let domain = free_domain();
    let node =
        Program::start(TWIN, &["--ros-args", "-p", "scene:=compression", "-r", "measured_js:=/rig/depth"], domain, &[]);
    node.wait_for("waiting for");
    let (code, log, _) = node.stop("TERM");
    assert_eq!(code, Some(0));
    let line = log.lines().find(|l| l.contains("waiting for")).unwrap_or_else(|| panic!("{log}"));
    for word in [
        "/rig/depth",
        "sensor_msgs/msg/JointState",
        "best_effort",
        "nobody publishes it",
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET",
    ] {
        assert!(line.contains(word), "{line}");
    }
}

/// Words that mean something, and pieces of them.
const WORDS: [&str; 52] = [
    "--ros-args",
    "--ros-args",
    "--ros-args",
    "--",
    "-r",
    "--remap",
    "-p",
    "--param",
    "--log-level",
    "-e",
    "--enclave",
    "--log-config-file",
    "--enable-rosout-logs",
    "--disable-stdout-logs",
    "--log-file-name",
    "--scene",
    "measured_js:=/a/b",
    "__ns:=/or1",
    "__node:=sim",
    "twin:a:=b",
    "rostopic://a:=b",
    "rosservice://~/x:=y",
    "~:=x",
    "rate:=1",
    "rate:=[1, 2]",
    "scene:=true",
    "topics:=[a, 'b']",
    "topics:=[]",
    "twin:rate:=2",
    "/or1/twin:rate:=.nan",
    "qos_overrides./a.publisher.depth:=3",
    "debug",
    "twin:=warn",
    ":=",
    ":",
    "/",
    "\u{e4}",
    "a:=&a [*a]",
    "rate:=!!float 1",
    "rate:=0x1F",
    "rate:=1_000",
    "scene:=|",
    "---",
    "/**:",
    "  ros__parameters:",
    "    rate: 3",
    "    a: {b: [1]}",
    "    a.b: 2",
    "twin:",
    "    rate: &x 1",
    "    topics: [*x]",
    "\t- [",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, ..ProptestConfig::default() })]

    #[test]
    fn no_command_line_and_no_parameter_file_does_harm(
        words in prop::collection::vec(prop::sample::select(WORDS.to_vec()), 0..16),
        noise in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..3),
    ) {
        let mut data = words.join("\n").into_bytes();
        for (at, byte) in noise {
            if !data.is_empty() {
                let at = at.index(data.len());
                data[at] = byte;
            }
        }
        command_line::exercise(&data);
    }
}

#[test]
fn what_has_no_effect_is_said_by_name() {
    let node = Program::start(
        TWIN,
        &[
            "--scene",
            "compression",
            "--ros-args",
            "-p",
            "autostart:=false",
            "--log-file-name",
            "x",
            "-e",
            "/keys",
            "--enable-external-lib-logs",
            "--log-level",
            "warn",
            "--log-level",
            "twin:=info",
        ],
        free_domain(),
        &[("ROS_STATIC_PEERS", "10.0.0.1"), ("RCUTILS_CONSOLE_OUTPUT_FORMAT", "{severity}|{name}|{message}")],
    );
    std::thread::sleep(std::time::Duration::from_millis(1500));
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    for word in ["--log-file-name x", "-e /keys", "--enable-external-lib-logs", "ROS_STATIC_PEERS"] {
        assert!(log.lines().any(|l| l.starts_with("WARN|twin|") && l.contains(word)), "{word}: {log}");
    }
    assert!(log.contains("INFO|twin|/twin on domain"), "the logger's own level counts: {log}");
}
