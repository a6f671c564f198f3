//! A small recording of a rig, made for a test: depth at 500 Hz, force at 200 Hz with stamps of its own.
#![allow(dead_code, clippy::unwrap_used)] // each test takes what it needs

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ros2_messages::RosMessage;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Point, Pose, PoseStamped, Quaternion, Vector3, Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagWriter, Qos, TopicId, WriterOptions};

/// Stamp of the first message, ns since 1970.
const START_NS: i64 = 1_767_225_600_000_000_000;
/// The load cell's first reading: off the poses' grid, so that no force has a pose's stamp.
const FORCE_DELAY_NS: i64 = 3_300_000;
/// Depth of the approach's start, m: the needle begins 0.2 mm above the sample.
const START_M: f64 = -0.0002;
/// Speed, m/s.
const SPEED: f64 = 0.02;
/// Stiffness that the pretended load cell shows, N/m.
pub const STIFFNESS: f64 = 10.0;
/// Height of the sample of every preset, m.
const HEIGHT_M: f64 = 0.017;

/// What goes into the bag.
pub struct RigBag {
    /// Scene that the bag names; the smallest of the presets by default.
    pub scene: Option<&'static str>,
    /// Depths as JointState on this topic.
    pub depth_topic: Option<&'static str>,
    /// The same as PoseStamped.
    pub pose_topic: Option<&'static str>,
    /// Load cell.
    pub force_topic: Option<&'static str>,
    /// Readings of the displacement sensor.
    pub readings: u32,
    /// Depth that is written in place of this reading's.
    pub nonsense: Option<(u32, f64)>,
}

impl Default for RigBag {
    fn default() -> Self {
        Self {
            scene: Some("compression"),
            depth_topic: Some("/measured_js"),
            pose_topic: None,
            force_topic: Some("/measured_cf"),
            readings: 50,
            nonsense: None,
        }
    }
}

impl RigBag {
    /// Writes the bag into `folder/NAME` and gives that path.
    pub fn write(&self, folder: &Path, name: &str) -> PathBuf {
        let custom_data: BTreeMap<_, _> = self.scene.map(|s| ("scene".to_owned(), s.to_owned())).into_iter().collect();
        let options = WriterOptions { chunk_bytes: 2000, flush_after: None, custom_data, ..WriterOptions::default() };
        let mut bag = BagWriter::create(folder.join(name), options).unwrap();
        let qos = Qos::reliable(10);
        let depths = self.depth_topic.map(|topic| bag.add_topic::<JointState>(topic, &qos).unwrap());
        let poses = self.pose_topic.map(|topic| bag.add_topic::<PoseStamped>(topic, &qos).unwrap());
        let forces = self.force_topic.map(|topic| bag.add_topic::<WrenchStamped>(topic, &qos).unwrap());
        let mut force_ns = FORCE_DELAY_NS;
        for k in 0..self.readings {
            let depth = match self.nonsense {
                Some((at, value)) if at == k => value,
                _ => depth_at(f64::from(k) / 500.0),
            };
            let ns = i64::from(k) * 2_000_000;
            put(&mut bag, depths, ns, &joint_state(ns, depth));
            put(&mut bag, poses, ns, &pose(ns, depth));
            while force_ns < ns + 2_000_000 {
                put(&mut bag, forces, force_ns, &wrench(force_ns));
                force_ns += 5_000_000;
            }
        }
        bag.finish().unwrap();
        folder.join(name)
    }
}

/// Depth of the motion, m.
pub fn depth_at(time_s: f64) -> f64 {
    START_M + SPEED * time_s
}

fn put<T: RosMessage>(bag: &mut BagWriter, topic: Option<TopicId>, ns: i64, message: &T) {
    let at = (START_NS + ns) as u64;
    topic.iter().for_each(|topic| bag.write(*topic, at + 300_000, at + 200_000, message).unwrap());
}

fn header(ns: i64) -> Header {
    Header { stamp: Time::from_nanos(START_NS + ns), frame_id: "sample".to_owned() }
}

fn joint_state(ns: i64, depth: f64) -> JointState {
    JointState {
        header: header(ns),
        name: vec!["insertion".to_owned()],
        position: vec![depth],
        ..JointState::default()
    }
}

fn pose(ns: i64, depth: f64) -> PoseStamped {
    // Half a turn about x: the tip's z axis points down, into the sample.
    let orientation = Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 };
    PoseStamped {
        header: header(ns),
        pose: Pose { position: Point { x: 0.0, y: 0.0, z: HEIGHT_M - depth }, orientation },
    }
}

fn wrench(ns: i64) -> WrenchStamped {
    let force = Vector3 { x: 0.0, y: 0.0, z: STIFFNESS * depth_at(ns as f64 * 1e-9) };
    WrenchStamped { header: header(ns), wrench: Wrench { force, torque: Vector3::default() } }
}
