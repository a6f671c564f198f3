//! Writes a recording as a bag with the topics that the twin reads. The stamps are those of the recording.

use std::collections::BTreeMap;
use std::path::Path;

use super::Recording;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Point, Pose, PoseArray, PoseStamped, Quaternion, Vector3, Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagError, BagWriter, Qos, WriterOptions, Written};

/// Earlier times are seconds of a free-running clock: 1980-01-06, the epoch of GPS.
const OWN_CLOCK_NS: i64 = 315_964_800 * 1_000_000_000;
/// Origin for such a clock: 2000-01-01. A stamp of zero would count as missing.
const ZERO_NS: i64 = 946_684_800 * 1_000_000_000;

/// The next sample to be written.
enum Sample {
    Depth(usize),
    Pose(usize),
    Force(usize),
    Markers(usize),
}

impl Recording {
    /// Writes the series as a rosbag2 folder: `/measured_js`, `/measured_cp`, `/measured_cf`, `/measured_targets`, as
    /// far as they exist. The same recording gives the same bytes.
    ///
    /// # Errors
    /// [`BagError`] if the folder exists, or can't be written.
    pub fn write(&self, folder: &Path, scene: Option<&str>) -> Result<Written, BagError> {
        let mut custom_data: BTreeMap<String, String> =
            [("description".to_owned(), format!("imported from {}", self.source))].into();
        custom_data.extend(scene.or(self.scene.as_deref()).map(|scene| ("scene".to_owned(), scene.to_owned())));
        if self.one_clock {
            custom_data.insert("one_clock".to_owned(), "true".to_owned());
        }
        let own_clock = self.origin_ns < OWN_CLOCK_NS;
        if own_clock {
            custom_data.insert("clock".to_owned(), "its own: 2000-01-01 is its time 0".to_owned());
        }
        let origin_ns = self.origin_ns + if own_clock { ZERO_NS } else { 0 };
        let library = needle_core::WRITER.to_owned();
        // takes two thirds of the time of zstd's default level, without a larger file for these messages
        let options =
            WriterOptions { flush_after: None, custom_data, library, compression_level: 1, ..WriterOptions::default() };
        let mut bag = BagWriter::create(folder, options)?;
        let reliable = Qos::reliable(10);
        let some = |len: usize| (len > 0).then_some(());
        let depth =
            some(self.depths.len()).map(|()| bag.add_topic::<JointState>("/measured_js", &reliable)).transpose()?;
        let pose =
            some(self.poses.len()).map(|()| bag.add_topic::<PoseStamped>("/measured_cp", &reliable)).transpose()?;
        let force =
            some(self.forces.len()).map(|()| bag.add_topic::<WrenchStamped>("/measured_cf", &reliable)).transpose()?;
        let targets = some(self.markers.len())
            .map(|()| bag.add_topic::<PoseArray>("/measured_targets", &reliable))
            .transpose()?;
        let stamp = |time_s: f64| origin_ns + (time_s * 1e9).round() as i64;
        let header = |ns: i64, frame: &str| Header { stamp: Time::from_nanos(ns), frame_id: frame.to_owned() };
        // reused, since only the numbers differ between a million readings
        let (name, position) = (vec![self.topics.joint.clone()], vec![0.0]);
        let mut joint = JointState { header: header(0, ""), name, position, ..JointState::default() };
        let frame = if self.force_frame.is_empty() { &self.topics.frame_id } else { &self.force_frame };
        let mut cell = WrenchStamped { header: header(0, frame), ..WrenchStamped::default() };
        for sample in self.in_time() {
            match sample {
                Sample::Depth(i) => {
                    let ns = stamp(self.depths[i].time_s);
                    joint.header.stamp = Time::from_nanos(ns);
                    joint.position[0] = self.depths[i].depth_m;
                    depth.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, &joint))?;
                }
                Sample::Pose(i) => {
                    let (ns, at) = (stamp(self.poses[i].time_s), &self.poses[i]);
                    let [x, y, z] = at.tip;
                    let message = PoseStamped {
                        header: header(ns, &self.topics.frame_id),
                        pose: Pose { position: Point { x, y, z }, orientation: pointing(at.axis) },
                    };
                    pose.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, &message))?;
                }
                Sample::Markers(i) => {
                    let ns = stamp(self.markers[i].time_s);
                    let point = |&[x, y, z]: &[f64; 3]| Pose { position: Point { x, y, z }, ..Pose::default() };
                    let poses = self.markers[i].positions.iter().map(point).collect();
                    let message = PoseArray { header: header(ns, &self.topics.frame_id), poses };
                    targets.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, &message))?;
                }
                Sample::Force(i) => {
                    let ns = stamp(self.forces[i].time_s);
                    let wrench = Wrench { force: self.forces[i].force_n.into(), torque: Vector3::default() };
                    cell.header.stamp = Time::from_nanos(ns);
                    cell.wrench = wrench;
                    force.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, &cell))?;
                }
            }
        }
        bag.finish()
    }

    /// All samples in order of time; for equal times the motion's first.
    fn in_time(&self) -> impl Iterator<Item = Sample> {
        let mut next = [0_usize; 4];
        std::iter::from_fn(move || {
            let times = [
                self.depths.get(next[0]).map(|s| s.time_s),
                self.poses.get(next[1]).map(|s| s.time_s),
                self.forces.get(next[2]).map(|s| s.time_s),
                self.markers.get(next[3]).map(|s| s.time_s),
            ];
            let first = (0..4)
                .filter(|&k| times[k].is_some())
                .min_by(|&a, &b| times[a].partial_cmp(&times[b]).unwrap_or(std::cmp::Ordering::Equal))?;
            let at = next[first];
            next[first] += 1;
            Some([Sample::Depth, Sample::Pose, Sample::Force, Sample::Markers][first](at))
        })
    }
}

/// The shortest rotation of +z to a unit vector.
fn pointing([x, y, z]: [f64; 3]) -> Quaternion {
    if z < -1.0 + 1e-12 {
        return Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 };
    }
    let norm = (2.0 * (1.0 + z)).sqrt();
    Quaternion { x: -y / norm, y: x / norm, z: 0.0, w: 0.5 * norm }
}
