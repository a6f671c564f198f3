//! Contract: whatever stops, kills or floods the DDS of a node, the exchange comes back by itself, the node's memory and
//! that of its middleware process stay bounded, and the twin has forgotten nothing: tare, counters, tissue, model.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeSet;
use std::fs;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::ros::{CYCLONE, Peer, Program, coarse_twin, free_domain, middleware_of, python, resident_mb, signal};
use serde_json::{Value, json};

/// What is promised after a stop or a kill, s; below, a process is stopped for so long, which is too short for its node to kill it.
const BACK_S: f64 = 2.0;
const STOPPED: Duration = Duration::from_millis(300);
/// What is promised after a flood.
const AFTER_FLOOD: Duration = Duration::from_secs(5);
/// Default of `middleware_memory_mib` with room for the program itself, and what the node may take.
const PROCESS_MIB: u64 = 512 + 32;
const NODE_MIB: u64 = 150;

/// UDP ports on which a process listens, as RTPS numbers them.
fn ports(pid: u32) -> Vec<u16> {
    let sockets: BTreeSet<String> = fs::read_dir(format!("/proc/{pid}/fd"))
        .unwrap()
        .flatten()
        .filter_map(|fd| {
            Some(fs::read_link(fd.path()).ok()?.to_str()?.strip_prefix("socket:[")?.trim_end_matches(']').into())
        })
        .collect();
    let table = fs::read_to_string("/proc/net/udp").unwrap();
    let found: Vec<u16> = table
        .lines()
        .skip(1)
        .filter_map(|line| {
            let columns: Vec<&str> = line.split_whitespace().collect();
            let port = u16::from_str_radix(columns[1].rsplit_once(':')?.1, 16).ok()?;
            (sockets.contains(columns[9]) && (7400..32_768).contains(&port) && port % 250 >= 160).then_some(port)
        })
        .collect();
    assert!(found.len() >= 2, "{found:?} in {table}");
    found
}

/// A twin that has been tared, and a peer that streams to it.
fn tared(domain: u16) -> (Program, Peer) {
    let node = coarse_twin(domain, &["-p", "max_pose_age_s:=0"], &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/predicted_cf", "geometry_msgs/msg/WrenchStamped", "reliable"),
        ("/comparison", "needle_twin/msg/ForceComparison", "reliable"),
        ("/status", "needle_twin/msg/TwinStatus", "reliable"),
        ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    let topics = ["/measured_js", "/measured_cf", "/predicted_cf", "/tissue_model", "/comparison", "/status"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    stream(&mut peer, 1.0);
    let tare = peer.ask(json!({"op": "call", "service": "/twin/force_tare", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(tare["response"]["success"], true, "{tare}");
    (node, peer)
}

/// Poses at 50 Hz over a tenth of a millimetre, under a load cell that says 0.25 N.
fn stream(peer: &mut Peer, seconds: f64) -> Value {
    peer.ask(json!({
        "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": (50.0 * seconds) as u64, "rate_hz": 50.0,
        "from_m": 0.0004, "depth_m": 0.0005, "force_topic": "/measured_cf", "force_n": 0.25, "answers": "/predicted_cf",
    }))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("not a number: {value}"))
}

/// What the twin must not forget: poses and steps counted, and the tare.
fn memory(peer: &mut Peer) -> (f64, f64) {
    stream(peer, 0.5);
    let status = peer.ask(json!({"op": "last", "topic": "/status", "seconds": 0.5}))["message"].clone();
    let comparison = peer.until("/comparison", |c| !c.is_null());
    assert!(number(&comparison["measured_n"]).abs() < 1e-9, "the tare is forgotten: {comparison}");
    (number(&status["poses_received"]), number(&status["steps"]))
}

/// Kills it when the test ends early.
struct Flood(Child);

impl Drop for Flood {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Flood {
    fn start(domain: u16, what: &str, seconds: f64, ports: &[u16]) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers/flood.py");
        let mut command = Command::new(python::python());
        command.args([script, what, &seconds.to_string(), "7"]).args(ports.iter().map(u16::to_string));
        let domain = domain.to_string();
        command.env("ROS_DOMAIN_ID", domain).env("CYCLONEDDS_URI", CYCLONE).env("PYTHONDONTWRITEBYTECODE", "1");
        Self(command.stdout(Stdio::piped()).spawn().unwrap())
    }

    /// Packets that were sent.
    fn end(mut self) -> u64 {
        assert!(self.0.wait().unwrap().success());
        let said = std::io::read_to_string(self.0.stdout.take().unwrap()).unwrap();
        said.split_whitespace().next().unwrap().parse().unwrap()
    }
}

#[test]
fn what_stops_or_kills_the_dds_costs_the_twin_a_moment_and_no_memory() {
    let domain = free_domain();
    let (node, mut peer) = tared(domain);
    let mut before = memory(&mut peer);
    let id = node.id();
    let process = || middleware_of(id).unwrap();
    type Fault<'a> = (&'a str, bool, Box<dyn Fn() + Send + Sync + 'a>);
    let stop_and_go = |pids: &[u32]| {
        pids.iter().for_each(|pid| signal(*pid, "STOP"));
        sleep(STOPPED);
        pids.iter().for_each(|pid| signal(*pid, "CONT"));
    };
    let faults: [Fault; 5] = [
        ("process killed", true, Box::new(|| signal(process(), "KILL"))),
        ("process stopped for good", true, Box::new(|| signal(process(), "STOP"))),
        ("process stopped and continued", true, Box::new(|| stop_and_go(&[process()]))),
        ("node stopped and continued", false, Box::new(|| stop_and_go(&[id]))),
        ("both stopped and continued", true, Box::new(|| stop_and_go(&[id, process()]))),
    ];
    for (what, replaced, fault) in &faults {
        let old = process();
        let seen = std::thread::scope(|scope| {
            scope.spawn(|| {
                sleep(Duration::from_secs(1));
                fault();
            });
            stream(&mut peer, 5.0)
        });
        let gap = number(&seen["longest_gap_s"]);
        eprintln!("{what}: {gap:.3} s without an answer, {} of {} answered", seen["answered"], seen["sent"]);
        assert!(gap < STOPPED.as_secs_f64() + BACK_S, "{what}: {seen}");
        assert_eq!(seen["unasked"], 0, "{what}: {seen}");
        assert!(!replaced || process() != old, "{what}: the process lives on, deaf");
        let after = memory(&mut peer);
        assert!(after.0 > before.0 && after.1 > before.1, "{what}: {before:?}, then {after:?}");
        before = after;
    }
    // Who comes late still gets what was published before the process was.
    let mut late = Peer::start(domain);
    late.ask(
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"}),
    );
    let models = late.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 20.0}));
    assert_eq!(models["messages"].as_array().unwrap().len(), 1, "{models}");
    let diagnostics = peer.until("/diagnostics", |d| !d.is_null());
    let of_process =
        diagnostics["status"].as_array().unwrap().iter().find(|s| s["name"] == "twin: middleware").unwrap();
    let count = of_process["values"].as_array().unwrap().iter().find(|v| v["key"] == "replaced").unwrap();
    assert!(count["value"].as_str().unwrap().parse::<u32>().unwrap() >= 4, "{of_process}");
    let (code, log, took) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(took < Duration::from_secs(2), "the leave took {took:?}");
    assert!(log.contains("was killed") && log.contains("its DDS threads have ended"), "{log}");
    assert!(!log.contains("if it goes deaf"), "a later RustDDS complains in other words: {log}");
    assert!(log.contains("is stopped (SIGSTOP") && log.contains("a new middleware process is ready"), "{log}");
}

/// The participant of a process that was killed is taken off the list by the next one, that of a killed node by its process, and not by
/// its lease of 50 s.
#[test]
fn a_killed_process_leaves_no_second_node_on_the_list() {
    let domain = free_domain();
    let node = coarse_twin(domain, &[], &[]);
    let mut peer = Peer::start(domain);
    let mut others =
        |wanted: u32| peer.ask(json!({"op": "participants", "wanted": wanted, "timeout": 25.0}))["others"].clone();
    assert_eq!(others(1), 1);
    for _ in 0..2 {
        let process = middleware_of(node.id()).unwrap();
        signal(process, "KILL");
        let begun = Instant::now();
        while middleware_of(node.id()).is_none_or(|p| p == process) && begun.elapsed() < Duration::from_secs(20) {
            sleep(Duration::from_millis(20));
        }
        // the next one is there when the old one has gone
        sleep(Duration::from_secs(1));
        assert_eq!(others(1), 1);
    }
    node.stop("KILL");
    let begun = Instant::now();
    assert_eq!(others(0), 0);
    eprintln!("a killed node is off the list after {:.3} s", begun.elapsed().as_secs_f64());
    assert!(begun.elapsed() < Duration::from_secs(3), "{:?}", begun.elapsed());
}

/// What the node sends to a process that is stopped is no sign of the process's life.
#[test]
fn a_process_that_is_stopped_under_large_messages_is_replaced() {
    let domain = free_domain();
    let folder = tempfile::tempdir().unwrap();
    let bag = format!("record:={}", folder.path().join("bag").display());
    let fine = ["discretisation.spacing_m:=0.0015", "tissue_rate_hz:=100.0", &bag];
    let more: Vec<&str> = fine.iter().flat_map(|p| ["-p", p]).chain(["-p", "max_pose_age_s:=0"]).collect();
    let (node, mut peer) = crate::ros::connected_twin(domain, &more);
    peer.ask(json!({"op": "subscribe", "topic": "/tissue_state", "type": "needle_twin/msg/TissueState", "qos": "best_effort"}));
    let process = middleware_of(node.id()).unwrap();
    let seen = std::thread::scope(|scope| {
        scope.spawn(|| {
            sleep(Duration::from_secs(1));
            signal(process, "STOP");
        });
        let poses = json!({"op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": 400, "rate_hz": 50.0,
            "depth_m": 0.0005, "answers": "/predicted_cf"});
        peer.ask(poses)
    });
    assert_ne!(middleware_of(node.id()), Some(process), "{seen}");
    let (code, log, _) = node.stop("INT");
    assert!(code == Some(0) && log.contains("is stopped (SIGSTOP"), "{log}");
}

#[test]
fn a_flood_of_lies_costs_neither_memory_nor_state_and_the_exchange_comes_back() {
    let domain = free_domain();
    let (node, mut peer) = tared(domain);
    let before = memory(&mut peer);
    let id = node.id();
    let old = middleware_of(id).unwrap();
    let flood = Flood::start(domain, "all", 12.0, &ports(old));
    let (over, of_node, of_process) = (AtomicBool::new(false), AtomicU64::new(0), AtomicU64::new(0));
    let sent = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Relaxed) {
                of_node.fetch_max(resident_mb(id) as u64, Relaxed);
                of_process.fetch_max(middleware_of(id).map_or(0.0, resident_mb) as u64, Relaxed);
                sleep(Duration::from_millis(2));
            }
        });
        let sent = flood.end();
        over.store(true, Relaxed);
        sent
    });
    let ended = Instant::now();
    let mut answered = 0;
    while answered == 0 && ended.elapsed() < 4 * AFTER_FLOOD {
        answered = stream(&mut peer, 0.2)["answered"].as_u64().unwrap();
    }
    let back = ended.elapsed();
    let (of_node, of_process) = (of_node.into_inner(), of_process.into_inner());
    eprintln!("{sent} packets: node {of_node} MiB, process {of_process} MiB, answers {back:?} after the flood");
    assert!(sent > 10_000, "{sent} packets are no flood");
    assert!(back < AFTER_FLOOD, "{back:?} until the first answer");
    assert!(of_node < NODE_MIB && of_process < PROCESS_MIB, "node {of_node} MiB, process {of_process} MiB");
    // What the flood has poisoned is forgotten a moment later, with one more process.
    sleep(Duration::from_secs(3));
    let seen = stream(&mut peer, 2.0);
    assert!(number(&seen["answered"]) > 50.0, "the exchange goes on: {seen}");
    let after = memory(&mut peer);
    assert!(after.0 > before.0 && after.1 > before.1, "{before:?}, then {after:?}");
    assert_ne!(middleware_of(id), Some(old));
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("it is replaced, the node's state is kept"), "{log}");
}

#[test]
fn one_lie_that_makes_it_deaf_for_a_publisher_is_forgotten() {
    let domain = free_domain();
    let (node, mut peer) = tared(domain);
    let old = middleware_of(node.id()).unwrap();
    assert!(Flood::start(domain, "leap", 0.0, &ports(old)).end() > 0);
    let told = Instant::now();
    let mut answered = 0;
    while answered == 0 && told.elapsed() < 4 * AFTER_FLOOD {
        answered = stream(&mut peer, 0.2)["answered"].as_u64().unwrap();
    }
    eprintln!("answers {:?} after the lie", told.elapsed());
    assert!(told.elapsed() < AFTER_FLOOD, "{:?}", told.elapsed());
    memory(&mut peer);
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("was told of messages that no publisher has sent"), "{log}");
}

#[test]
fn the_process_ends_with_the_node_and_a_node_or_peer_that_starts_again_is_heard_at_once() {
    let domain = free_domain();
    let (node, peer) = tared(domain);
    let process = middleware_of(node.id()).unwrap();
    // A peer is killed, another one comes.
    drop(peer);
    sleep(Duration::from_secs(1));
    let mut peer = Peer::start(domain);
    let begun = Instant::now();
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "subscribe", "topic": "/predicted_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    let asked_s = begun.elapsed().as_secs_f64();
    let seen = stream(&mut peer, 3.0);
    let first = asked_s + number(&seen["first_s"]);
    eprintln!("a new peer is answered after {first:.3} s");
    assert!(first < 2.0, "{seen}");
    let (_, log, _) = {
        sleep(Duration::from_secs(1));
        let seen = stream(&mut peer, 0.5);
        assert!(number(&seen["answered"]) > 10.0, "{seen}");
        node.stop("KILL")
    };
    assert!(log.contains("without one, and without a prediction"), "what was missed is said: {log}");
    let gone = Instant::now();
    while fs::exists(format!("/proc/{process}/exe")).unwrap() && fs::read_link(format!("/proc/{process}/exe")).is_ok() {
        assert!(gone.elapsed() < Duration::from_secs(2), "the process outlives its node");
        sleep(Duration::from_millis(5));
    }
    // The node is started again while the peer streams.
    let seen = std::thread::scope(|scope| {
        let next = scope.spawn(|| coarse_twin(domain, &[], &[]));
        let seen = stream(&mut peer, 5.0);
        drop(next.join().unwrap());
        seen
    });
    let first = number(&seen["first_s"]);
    eprintln!("a new node answers after {first:.3} s, start and model included");
    assert!(first < 3.0, "{seen}");
}
