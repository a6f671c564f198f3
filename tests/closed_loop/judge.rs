//! Listens beside driver, twin and guard, and carries the sensors' words to guard and twin: it can cut the cable and add force.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use ros2_messages::geometry_msgs::{PoseArray, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Bool;
use ros2_node::arguments::RosArguments;
use ros2_node::clock::wall_nanos;
use ros2_node::environment::Environment;
use ros2_node::names::Names;
use ros2_node::participant::Participant;
use ros2_node::qos;

use crate::TOP_M;
use crate::ros::TWIN;

#[derive(Default)]
pub struct Heard {
    /// Stamp (ns) and position of every `measured_js`, from the driver itself.
    pub motion: Vec<(i64, f64)>,
    /// Largest force that the twin predicted, N.
    pub peak_n: f64,
    /// Depth of the target as the twin says it.
    pub target_m: Option<f64>,
    pub safe: Vec<(i64, bool)>,
}

/// Listens, and carries the sensors' words to guard and twin.
pub struct Judge {
    pub domain: u16,
    pub heard: Arc<Mutex<Heard>>,
    pub cut: Arc<AtomicBool>,
    /// Bits of a force in N.
    pub push: Arc<AtomicU64>,
    /// When the last position passed, ns.
    pub passed_ns: Arc<AtomicU64>,
    /// When the first force passed that was too high, ns.
    pub push_ns: Arc<AtomicU64>,
    pub stop: Arc<AtomicBool>,
    pub thread: Option<JoinHandle<()>>,
}

impl Judge {
    pub fn start(domain: u16) -> Self {
        let mut judge = Self {
            domain,
            heard: Arc::default(),
            cut: Arc::default(),
            push: Arc::default(),
            passed_ns: Arc::default(),
            push_ns: Arc::default(),
            stop: Arc::default(),
            thread: None,
        };
        let (heard, cut, push) = (Arc::clone(&judge.heard), Arc::clone(&judge.cut), Arc::clone(&judge.push));
        let (passed_ns, push_ns, stop) =
            (Arc::clone(&judge.passed_ns), Arc::clone(&judge.push_ns), Arc::clone(&judge.stop));
        let thread = std::thread::spawn(move || {
            let domain = domain.to_string();
            let environment =
                Environment::from_lookup(|name| (name == "ROS_DOMAIN_ID").then(|| domain.clone())).unwrap();
            let names = Names::new("judge", &[]).unwrap();
            let mut node = Participant::new(names, &environment, &RosArguments::default()).unwrap();
            node.set_program(TWIN);
            let measured = node.subscription::<JointState>("measured_js", qos::sensor(1000)).unwrap();
            let predicted = node.subscription::<WrenchStamped>("predicted_cf", qos::sensor(1000)).unwrap();
            let targets = node.subscription::<PoseArray>("targets", qos::sensor(100)).unwrap();
            let safe = node.subscription::<Bool>("safe_to_go_on", qos::sensor(100)).unwrap();
            let cable = node.publisher::<JointState>("cable_js", qos::reliable(10)).unwrap();
            let force = node.publisher::<WrenchStamped>("cable_cf", qos::reliable(10)).unwrap();
            node.start(None).unwrap();
            let mut pushed = false;
            while !stop.load(Relaxed) {
                while let Some(message) = measured.take() {
                    heard.lock().unwrap().motion.push((message.header.stamp.nanos(), message.position[0]));
                    if !cut.load(Relaxed) {
                        cable.send(message);
                        passed_ns.store(wall_nanos() as u64, Relaxed);
                    }
                }
                while let Some(mut message) = predicted.take() {
                    let mut heard = heard.lock().unwrap();
                    heard.peak_n = heard.peak_n.max(message.wrench.force.z);
                    let more = f64::from_bits(push.load(Relaxed));
                    if more > 0.0 && !pushed {
                        pushed = true;
                        push_ns.store(wall_nanos() as u64, Relaxed);
                    }
                    message.wrench.force.z += more;
                    force.send(message);
                }
                while let Some(message) = targets.take() {
                    heard.lock().unwrap().target_m = message.poses.first().map(|p| TOP_M - p.position.z);
                }
                while let Some(message) = safe.take() {
                    heard.lock().unwrap().safe.push((wall_nanos(), message.data));
                }
                sleep(Duration::from_micros(300));
            }
        });
        judge.thread = Some(thread);
        judge
    }

    pub fn depth_m(&self) -> f64 {
        self.heard.lock().unwrap().motion.last().map_or(0.0, |m| m.1)
    }

    /// Waits until the needle is so deep.
    pub fn wait_for(&self, depth_m: f64, who: &str) {
        let begun = Instant::now();
        while self.depth_m() < depth_m {
            assert!(begun.elapsed() < Duration::from_secs(60), "{who}: the needle is at {} m", self.depth_m());
            sleep(Duration::from_millis(1));
        }
    }

    /// Time from the fault to the last moment at which the driver still moved, s.
    pub fn stopped_after_s(&self, fault_ns: i64) -> f64 {
        sleep(Duration::from_millis(600));
        let heard = self.heard.lock().unwrap();
        let moved = heard.motion.windows(2).filter(|w| (w[1].1 - w[0].1).abs() > 1e-9);
        let last = moved.map(|w| w[1].0).next_back().unwrap();
        let after: Vec<_> = heard.motion.iter().filter(|m| m.0 > fault_ns).collect();
        assert!(after.len() > 20, "the driver still speaks");
        (last - fault_ns) as f64 * 1e-9
    }
}

impl Drop for Judge {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
