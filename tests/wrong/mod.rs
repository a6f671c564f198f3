//! Recordings of the project's own rig with a fault put in.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use needle_recording::{Recording, TopicNames};
use needle_rig::make::{RigRecording, RigScene};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Vector3, Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagWriter, Qos, WriterOptions};

/// What is wrong with a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Nothing.
    None,
    /// The force's stamps are a second late.
    Late,
    /// The sample is touched at a recorded depth of 1 mm.
    Deep,
    /// Force in mN.
    Millinewtons,
    /// Depth in mm.
    Millimetres,
    /// The sign of the force turned round.
    ForceTurned,
    /// That of the depth.
    DepthTurned,
    /// The force drops now and then as tissue gives way, as in liver.
    Drops,
    /// Friction on the way out.
    Rubs,
}

impl Fault {
    /// The six of the issue, and none.
    pub const ALL: [Self; 7] =
        [Self::None, Self::Late, Self::Deep, Self::Millinewtons, Self::Millimetres, Self::ForceTurned, Self::Drops];
}

/// A recording of 50 readings a second with a fault.
pub fn recorded(scene: RigScene, fault: Fault, seed: u64) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    RigRecording { seed, rate_hz: 50.0, ..RigRecording::of(scene) }.write(&bag).unwrap();
    let mut recording = Recording::load(&bag, &TopicNames::default()).unwrap();
    let deepest = recording.depths.iter().map(|d| d.depth_m).fold(0.0, f64::max);
    let times: Vec<(f64, f64)> = recording.depths.iter().map(|d| (d.time_s, d.depth_m)).collect();
    let depth_at = |t: f64| times[times.partition_point(|p| p.0 < t).min(times.len() - 1)].1;
    let last_deep = times[times.iter().rposition(|p| p.1 > 0.999 * deepest).unwrap()].0;
    let turn = times.iter().position(|p| p.1 > 0.999 * deepest).unwrap();
    for d in &mut recording.depths {
        d.depth_m = match fault {
            Fault::Deep => d.depth_m + 1e-3,
            Fault::Millimetres => 1e3 * d.depth_m,
            Fault::DepthTurned => -d.depth_m,
            _ => d.depth_m,
        };
    }
    for f in &mut recording.forces {
        match fault {
            Fault::Late => f.time_s += 1.0,
            Fault::Millinewtons => f.force_n[2] *= 1e3,
            Fault::ForceTurned => f.force_n[2] *= -1.0,
            Fault::Drops if f.time_s < times[turn].0 => f.force_n[2] *= held_share(depth_at(f.time_s) / deepest, seed),
            Fault::Rubs if f.time_s > last_deep => f.force_n[2] -= 0.02 * (depth_at(f.time_s) / deepest).max(0.0),
            _ => {}
        }
    }
    recording
}

/// What is left of a force that drops by a fifth to a half and comes back over an eighth of the depth.
fn held_share(share: f64, seed: u64) -> f64 {
    let drop = |k: u64| 0.2 + 0.3 * ((seed * 7 + k * 13) % 10) as f64 / 10.0;
    let place = |k: u64| 0.2 + 0.16 * k as f64 + 0.05 * ((seed * 3 + k * 5) % 7) as f64 / 7.0;
    (0..5).filter(|k| share >= place(*k)).map(|k| 1.0 - drop(k) * (-(share - place(k)) / 0.06).exp()).product()
}

const START_NS: i64 = 1_767_225_600_000_000_000;

/// Writes a recording as a bag that names a scene, or none.
pub fn write(recording: &Recording, scene: &str, folder: &Path) {
    let named = (!scene.is_empty()).then(|| ("scene".to_owned(), scene.to_owned()));
    let options = WriterOptions { custom_data: named.into_iter().collect(), ..WriterOptions::default() };
    let mut bag = BagWriter::create(folder, options).unwrap();
    let depth_topic = bag.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
    let force_topic = bag.add_topic::<WrenchStamped>("/measured_cf", &Qos::reliable(10)).unwrap();
    let nanos = |time_s: f64| START_NS + (time_s * 1e9) as i64;
    for d in &recording.depths {
        let at = nanos(d.time_s);
        let header = Header { stamp: Time::from_nanos(at), frame_id: String::new() };
        let (name, position) = (vec!["insertion".to_owned()], vec![d.depth_m]);
        let message = JointState { header, name, position, ..JointState::default() };
        bag.write(depth_topic, at as u64, at as u64, &message).unwrap();
    }
    for f in &recording.forces {
        let at = nanos(f.time_s);
        let header = Header { stamp: Time::from_nanos(at), frame_id: "sample".to_owned() };
        let wrench = Wrench { force: Vector3 { x: 0.0, y: 0.0, z: f.force_n[2] }, torque: Vector3::default() };
        bag.write(force_topic, at as u64, at as u64, &WrenchStamped { header, wrench }).unwrap();
    }
    bag.finish().unwrap();
}
