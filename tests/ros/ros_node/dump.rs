//! `ros2 param dump`, and what it wrote given to `ros2 param load` and to the next start.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::ros::python::environment;
use crate::ros::{Peer, Program, TWIN, free_domain};
use serde_json::{Map, Value, json};

const NEEDLE_TWIN: &str = env!("CARGO_BIN_EXE_needle_twin");
const RIG: &str = env!("CARGO_BIN_EXE_rig_node");

/// Fields of ParameterValue by its type.
const FIELDS: [&str; 10] = [
    "",
    "bool_value",
    "integer_value",
    "double_value",
    "string_value",
    "byte_array_value",
    "bool_array_value",
    "integer_array_value",
    "double_array_value",
    "string_array_value",
];

fn call(peer: &mut Peer, node: &str, what: &str, kind: &str, request: Value) -> Value {
    let (service, kind) = (format!("{node}/{what}"), format!("rcl_interfaces/srv/{kind}"));
    peer.ask(json!({"op": "call", "service": service, "type": kind, "request": request}))["response"].clone()
}

/// All parameters of a node.
fn parameters(peer: &mut Peer, node: &str) -> Map<String, Value> {
    let listed = call(peer, node, "list_parameters", "ListParameters", json!({"prefixes": [], "depth": 0}));
    let names = listed["result"]["names"].clone();
    let got = call(peer, node, "get_parameters", "GetParameters", json!({"names": names}));
    let value = |v: &Value| v[FIELDS[usize::try_from(v["type"].as_u64().unwrap()).unwrap()]].clone();
    let (names, values) = (names.as_array().unwrap().iter(), got["values"].as_array().unwrap().iter());
    names.zip(values).map(|(name, v)| (name.as_str().unwrap().to_owned(), value(v))).collect()
}

/// Dumps parameters into a file; what a load makes of them.
fn dumped(parameters: &Map<String, Value>, file: &Path, node: &str) -> Map<String, Value> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers/param_file.py");
    // The YAML reader of ROS 2's commands.
    let mut child = Command::new(environment("python-yaml", &["PyYAML==6.0.3"]))
        .args([Path::new(script), file, Path::new(node)])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(&serde_json::to_vec(parameters).unwrap()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{node}: the file can't be loaded");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// As a load sends it.
fn typed(value: &Value) -> Value {
    let of = |v: &Value| match v {
        Value::Bool(_) => 1,
        Value::Number(n) if n.is_f64() => 3,
        Value::Number(_) => 2,
        _ => 4,
    };
    let kind = match value {
        Value::Array(items) => 5 + items.first().map_or(1, of),
        single => of(single),
    };
    json!({"type": kind, FIELDS[kind]: value})
}

#[test]
fn what_is_dumped_can_be_loaded_and_started_with() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("dump.yaml");
    let from_file = ["--ros-args", "--params-file", file.to_str().unwrap()];
    let idle = ["--ros-args", "-p", "autostart:=false"];
    let nodes: [(&str, &str, Vec<&str>); 6] = [
        ("/twin", TWIN, [&["--scene", "compression"][..], &idle].concat()),
        ("/twin", TWIN, [&["--scene", "indentation"][..], &idle].concat()),
        ("/twin", TWIN, [&["--scene", "needle_insertion"][..], &idle].concat()),
        ("/twin", TWIN, [&["--scene", "layered_tissue"][..], &idle].concat()),
        ("/rig", RIG, vec!["--ros-args", "-p", "mode:=driver"]),
        ("/guard", NEEDLE_TWIN, vec!["guard"]),
    ];
    for (name, program, arguments) in nodes {
        let domain = free_domain();
        let mut peer = Peer::start(domain);
        let node = Program::start(program, &arguments, domain, &[]);
        let before = parameters(&mut peer, name);
        assert!(before.len() > 20, "{before:?}");
        let loaded = dumped(&before, &file, name);
        let changes: Vec<Value> = loaded.iter().map(|(n, v)| json!({"name": n, "value": typed(v)})).collect();
        let set = call(&mut peer, name, "set_parameters", "SetParameters", json!({"parameters": changes}));
        for (result, change) in set["results"].as_array().unwrap().iter().zip(&changes) {
            let fixed = result["reason"].as_str().unwrap().contains("is fixed while the node runs");
            assert!(result["successful"] == true || fixed, "{name}: {change}: {result}");
        }
        for (key, was) in before.iter().filter(|(_, was)| was.is_string()) {
            assert_eq!(&loaded[key], was, "{name}: {key} is another text");
        }
        assert_eq!(parameters(&mut peer, name), before, "{name} {arguments:?}");
        node.stop("INT");

        let node =
            Program::start(program, &[&arguments[..usize::from(name == "/guard")], &from_file].concat(), domain, &[]);
        assert_eq!(parameters(&mut peer, name), before, "{name} {arguments:?}, from the file");
        node.stop("INT");
    }
}
