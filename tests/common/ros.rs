//! Nodes started as a user starts them, and the independent peer that talks to them.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

pub use testkit::python;

/// Loopback only and no multicast, so that nothing leaks to a real network.
pub const CYCLONE: &str = r#"<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"#;

/// As rmw_cyclonedds_cpp of Jazzy configures it with `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`: no interface is named, so a network card
/// is announced and datagrams are those of a card, 1.4 kB.
pub const CYCLONE_AS_ROS: &str = r#"<CycloneDDS><Domain Id="any"><General><AllowMulticast>spdp</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer Address="localhost"/></Peers></Discovery></Domain></CycloneDDS>"#;

/// The same at ROS's default range, SUBNET: discovery by multicast through the network card alone.
pub const CYCLONE_SUBNET: &str = r#"<CycloneDDS><Domain Id="any"><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>"#;

/// How a node is to find the router of [`Peer`] in the domain: as by default, but at a port of its own.
pub fn zenoh_router(domain: u16) -> String {
    let quick = "connect/retry={period_init_ms:100,period_max_ms:200,period_increase_factor:2}";
    format!("connect/endpoints=[\"tcp/127.0.0.1:{}\"];{quick}", router_port(domain))
}

/// Below the ports that Linux gives away.
fn router_port(domain: u16) -> u16 {
    20_000 + domain
}

/// What `zenoh_peer.py` needs, at the versions that were tried.
const ZENOH_PACKAGES: [&str; 3] = ["cyclonedds==11.0.1", "eclipse-zenoh==1.10.2", "zenoh-ros2-sdk==0.1.8"];

/// The twin as a program.
pub const TWIN: &str = env!("CARGO_BIN_EXE_twin_node");

/// A plate on a sample that is coarse enough to be answered at once, whatever else the machine does.
pub const COARSE: [&str; 9] = [
    "--scene",
    "compression",
    "--ros-args",
    "-p",
    "discretisation.spacing_m:=0.005",
    "-p",
    "discretisation.edge_refinement:=1.0",
    "-p",
    "stepping.max_steps_per_pose:=20",
];

/// The coarse twin with more ROS arguments.
pub fn coarse_twin(domain: u16, more: &[&str], environment: &[(&str, &str)]) -> Program {
    Program::start(TWIN, &[&COARSE, more].concat(), domain, environment)
}

/// Sends a signal to a process.
pub fn signal(process: u32, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &process.to_string()]).status().unwrap();
    assert!(sent.success(), "kill -{name} {process}");
}

/// A running coarse twin that has built its model, and a peer that is connected with it.
pub fn connected_twin(domain: u16, more: &[&str]) -> (Program, Peer) {
    let node = coarse_twin(domain, more, &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    (node, peer)
}

/// The middleware process of a node.
pub fn middleware_of(node: u32) -> Option<u32> {
    let parent = |process: u32| -> Option<u32> {
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        stat.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()
    };
    let all = std::fs::read_dir("/proc").unwrap().flatten().filter_map(|e| e.file_name().to_str()?.parse().ok());
    all.into_iter().find(|process| parent(*process) == Some(node))
}

/// Resident memory of a process, MB; 0 if it has ended.
pub fn resident_mb(process: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmRSS")).unwrap_or("VmRSS: 0 kB");
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}

/// Resident memory of a node and its middleware process, MB.
pub fn node_mb(node: u32) -> f64 {
    resident_mb(node) + middleware_of(node).map_or(0.0, resident_mb)
}

/// A pose as a displacement sensor says it.
pub fn joint_state(sec: i64, nanosec: i64, depth_m: f64) -> Value {
    serde_json::json!({
        "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}, "name": ["insertion"], "position": [depth_m],
    })
}

/// A domain that nobody on this machine uses at present, another one for every call of this process.
pub fn free_domain() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let start = std::process::id() as u16;
    loop {
        let domain = 1 + start.wrapping_mul(37).wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)) % 100;
        // The first participant of a domain holds this port.
        if UdpSocket::bind(("0.0.0.0", 7410 + 250 * domain)).is_ok() {
            return domain;
        }
    }
}

/// How long a condition may take to come true on a machine that others keep busy. A test that passes waits a fraction of it.
const PATIENCE: Duration = Duration::from_secs(20);

/// A started program; killed when dropped.
pub struct Program {
    child: Child,
    log: std::thread::JoinHandle<()>,
    text: Arc<Mutex<String>>,
}

impl Program {
    /// Starts a program of this crate with a clean ROS environment.
    pub fn start(path: &str, arguments: &[&str], domain: u16, environment: &[(&str, &str)]) -> Self {
        let mut command = Command::new(path);
        for (name, _) in std::env::vars()
            .filter(|(name, _)| ["ROS_", "RMW_", "RCUTILS_", "ZENOH_"].iter().any(|prefix| name.starts_with(prefix)))
        {
            command.env_remove(name);
        }
        command.args(arguments).env("ROS_DOMAIN_ID", domain.to_string()).envs(environment.iter().copied());
        if crate::ZENOH {
            command.env("RMW_IMPLEMENTATION", "rmw_zenoh_cpp");
            if !environment.iter().any(|(name, _)| name.starts_with("ZENOH_")) {
                command.env("ZENOH_CONFIG_OVERRIDE", zenoh_router(domain));
            }
        }
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        let text: Arc<Mutex<String>> = Arc::default();
        let said = text.clone();
        let log = std::thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                eprintln!("    | {line}");
                let mut said = said.lock().unwrap();
                said.push_str(&line);
                said.push('\n');
            }
        });
        Self { child, log, text }
    }

    /// Waits until its log has these words, or for as long as the busiest machine may need. The assertion is the caller's.
    pub fn wait_for(&self, words: &str) {
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE && !self.text.lock().unwrap().contains(words) {
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// What it has logged to its end.
    fn logged(&mut self) -> String {
        std::mem::replace(&mut self.log, std::thread::spawn(|| ())).join().unwrap();
        std::mem::take(&mut self.text.lock().unwrap())
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal and waits for the end: exit code, what it logged, and how long it took.
    pub fn stop(mut self, signal: &str) -> (Option<i32>, String, Duration) {
        let begun = Instant::now();
        let killed = Command::new("kill").args([&format!("-{signal}"), &self.child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let status = self.wait(Duration::from_secs(10));
        let took = begun.elapsed();
        (status, self.logged(), took)
    }

    /// Exit code and log of a program that may have ended by itself; `None` if it had to be killed.
    pub fn end(mut self) -> (Option<i32>, String) {
        let code = self.child.try_wait().unwrap().map(|status| status.code().unwrap_or(-1));
        let _ = self.child.kill();
        (code, self.logged())
    }

    /// Waits for a program that ends by itself: exit code and what it logged.
    pub fn ended(mut self) -> (Option<i32>, String) {
        let code = self.wait(Duration::from_secs(60));
        (code, self.logged())
    }

    fn wait(&mut self, timeout: Duration) -> Option<i32> {
        let begun = Instant::now();
        while begun.elapsed() < timeout {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("the program does not end");
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The independent peer.
pub struct Peer {
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
}

impl Peer {
    pub fn start(domain: u16) -> Self {
        Self::start_with(domain, CYCLONE)
    }

    /// With a configuration of its own.
    pub fn start_with(domain: u16, configuration: &str) -> Self {
        Self::start_by(Command::new("env"), domain, configuration)
    }

    /// By a program that runs the command after its own arguments.
    pub fn start_by(mut program: Command, domain: u16, configuration: &str) -> Self {
        let script = if crate::ZENOH { "zenoh_peer.py" } else { "peer.py" };
        let mut child = program
            .arg(if crate::ZENOH { python::environment("python-zenoh", &ZENOH_PACKAGES) } else { python::python() })
            .arg(format!("{}/tests/peers/{script}", env!("CARGO_MANIFEST_DIR")))
            .env("ROUTER_PORT", router_port(domain).to_string())
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("CYCLONEDDS_URI", configuration)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let stdin = child.stdin.take().unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let mut peer = Self { child, stdin, stdout };
        assert_eq!(peer.line()["ready"], true);
        peer
    }

    fn line(&mut self) -> Value {
        let mut line = String::new();
        self.stdout.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|e| panic!("the peer said `{line}`: {e}"))
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Writes poses, reads forces and status; waits for the twin's model.
    pub fn connect(&mut self) {
        use serde_json::json;
        for (topic, kind, qos) in [
            ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
            ("/predicted_cf", "geometry_msgs/msg/WrenchStamped", "reliable"),
            ("/status", "needle_twin/msg/TwinStatus", "reliable"),
        ] {
            self.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
        }
        self.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
        let model = self.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
        assert_eq!(model["messages"].as_array().unwrap().len(), 1, "the twin has a model");
        let topics = ["/measured_js", "/predicted_cf", "/status"];
        assert_eq!(self.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    }

    /// Poses, one after the other: stamps (ns) and depths (m). The force that answered each, N.
    pub fn steps(&mut self, poses: &[(i64, f64)]) -> Vec<Option<f64>> {
        let answer = self.ask(serde_json::json!({
            "op": "steps", "topic": "/measured_js", "joint": "insertion", "poses": poses, "answers": "/predicted_cf",
        }));
        answer["forces"].as_array().unwrap().iter().map(Value::as_f64).collect()
    }

    /// The newest message of a topic, once it is as wanted; after [`PATIENCE`] the newest as it is, for the caller's assertion to show.
    pub fn until(&mut self, topic: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let (begun, mut newest) = (Instant::now(), Value::Null);
        while begun.elapsed() < PATIENCE {
            let heard = self.ask(serde_json::json!({"op": "last", "topic": topic, "seconds": 0.1}))["message"].clone();
            if !heard.is_null() {
                newest = heard;
            }
            if wanted(&newest) {
                break;
            }
        }
        newest
    }

    /// The newest `status`.
    pub fn status(&mut self) -> Value {
        self.ask(serde_json::json!({"op": "last", "topic": "/status", "seconds": 0.5}))["message"].clone()
    }

    /// One operation of `peer.py`; panics if it failed there.
    pub fn ask(&mut self, request: Value) -> Value {
        writeln!(self.stdin, "{request}").unwrap();
        let answer = self.line();
        assert!(answer.get("error").is_none(), "{request}: {}", answer["error"]);
        answer
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
