//! OpenIGTLink: a running twin as `pyigtl` sees it, which shares no code with it.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::ros::python::environment;
use crate::ros::{Peer, Program, TWIN, free_domain};

/// At the version that was tried.
const PACKAGES: [&str; 2] = ["pyigtl==0.3.4", "numpy==2.4.6"];

/// Where the node's log says that the link is.
fn address(logs: &tempfile::TempDir) -> String {
    let begun = Instant::now();
    loop {
        for file in std::fs::read_dir(logs.path()).unwrap().flatten() {
            let text = std::fs::read_to_string(file.path()).unwrap_or_default();
            if let Some((_, rest)) = text.split_once("OpenIGTLink: ") {
                return rest.split_whitespace().next().unwrap().to_owned();
            }
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "the node says where its link is");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn twin() -> (Program, Peer, String) {
    let (domain, logs) = (free_domain(), tempfile::tempdir().unwrap());
    let coarse = ["--scene", "needle_insertion", "--ros-args", "-p", "discretisation.spacing_m:=0.003"];
    let link = ["-p", "openigtlink:=true", "-p", "openigtlink_port:=0"];
    let logs_at = [("ROS_LOG_DIR", logs.path().to_str().unwrap())];
    let node = Program::start(TWIN, &[&coarse[..], &link].concat(), domain, &logs_at);
    let address = address(&logs);
    let mut peer = Peer::start(domain);
    peer.connect();
    (node, peer, address)
}

#[test]
fn a_client_sees_instrument_surface_and_targets() {
    let python = environment("igtl-venv", &PACKAGES);
    let (node, mut peer, address) = twin();
    let (host, port) = address.split_once(':').unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/igtl_client.py");
    let mut client = Command::new(python);
    client.arg(script).args([host, port, "6"]).stdout(Stdio::piped());
    let mut client = client.spawn().unwrap();
    let mut said = BufReader::new(client.stdout.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert_eq!(line.trim(), "connected");
    let poses: Vec<(i64, f64)> = (0..20).map(|k| (100_000_000_000 + k * 10_000_000, 0.002 * k as f64 / 19.0)).collect();
    assert!(peer.steps(&poses).iter().all(Option::is_some));
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    assert!(client.wait().unwrap().success(), "{rest}");
    let seen: Value = serde_json::from_str(rest.lines().last().unwrap()).unwrap();
    // one pose may be all that a busy machine shows of twenty; the last one is always shown
    for name in ["TRANSFORM NeedleToSample", "POLYDATA Sample", "POINT Targets"] {
        assert!(seen["count"][name].as_u64().is_some_and(|n| n >= 1), "{name}: {seen}");
    }
    let matrix: Vec<Vec<f64>> = serde_json::from_value(seen["matrix"].clone()).unwrap();
    let close = |a: f64, b: f64| (a - b).abs() < 1e-4;
    let height = seen["polydata"]["high"][2].as_f64().unwrap();
    let low = seen["polydata"]["low"][2].as_f64().unwrap();
    assert!(close(low, 0.0), "the base stays: {seen}");
    assert!(
        close(matrix[2][2], -1.0) && close(matrix[2][3], 17.0 - 2.0),
        "mm, the third column into the sample: {seen}"
    );
    assert!((16.9..17.3).contains(&height), "the rim of the top stays: {seen}");
    assert!(close(seen["stamp"].as_f64().unwrap(), 100.19), "the pose's stamp: {seen}");
    let largest = seen["polydata"]["largest"].as_f64().unwrap();
    assert!(seen["polydata"]["scalar"] == "displacement (mm)" && (0.2..=2.01).contains(&largest), "{seen}");
    let targets = seen["targets"]["names"].as_array().unwrap();
    assert!(!targets.is_empty() && targets.len() == seen["targets"]["positions"].as_array().unwrap().len());
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}

#[test]
fn a_client_that_talks_without_end_is_dropped_and_a_port_that_is_taken_ends_the_node() {
    let (node, mut peer, address) = twin();
    let mut loud = TcpStream::connect(&address).unwrap();
    loud.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let noise = vec![0x5a; 1 << 16];
    let begun = Instant::now();
    while loud.write_all(&noise).is_ok() {
        assert!(begun.elapsed() < Duration::from_secs(30), "it is heard for ever");
    }
    let silent = TcpStream::connect(&address).unwrap();
    assert!(peer.steps(&[(100_000_000_000, 1e-4), (100_010_000_000, 2e-4)]).iter().all(Option::is_some));
    let taken = format!("openigtlink_port:={}", address.rsplit_once(':').unwrap().1);
    let other = Program::start(TWIN, &["--ros-args", "-p", "openigtlink:=true", "-p", &taken], free_domain(), &[]);
    let (code, log) = other.ended();
    assert!(code == Some(1) && log.contains("openigtlink_port"), "{code:?}: {log}");
    // one that is connected keeps nobody from leaving
    let (code, log, _) = node.stop("INT");
    drop(silent);
    assert_eq!(code, Some(0), "{log}");
}
