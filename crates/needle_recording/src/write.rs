//! Writes a recording as a bag with the topics that the twin reads. The stamps are those of the recording.

use std::collections::BTreeMap;
use std::path::Path;

use super::Recording;
use super::adapter::orientation;
use super::sample::{DepthSample, ForceSample, MarkerSample, PoseSample, Sample};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Point, Pose, PoseArray, PoseStamped, Vector3, Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagError, BagWriter, Qos, TopicId, WriterOptions, Written};

/// Earlier times are seconds of a free-running clock: 1980-01-06, the epoch of GPS.
const OWN_CLOCK_NS: i64 = 315_964_800 * 1_000_000_000;
/// Origin for such a clock: 2000-01-01. A stamp of zero would count as missing.
const ZERO_NS: i64 = 946_684_800 * 1_000_000_000;

/// The bag that is being written.
pub(super) struct Topics<'a> {
    bag: BagWriter,
    of: &'a Recording,
    /// Time 0 of the series, ns.
    origin_ns: i64,
    /// Depths, poses, forces, markers, as far as they exist.
    topics: [Option<TopicId>; 4],
    // reused, since only the numbers differ between a million readings
    joint: JointState,
    cell: WrenchStamped,
}

impl<'a> Topics<'a> {
    /// Makes the folder; `has`: whether there are depths, poses, forces and markers.
    pub(super) fn create(
        of: &'a Recording,
        has: [bool; 4],
        folder: &Path,
        scene: Option<&str>,
    ) -> Result<Self, BagError> {
        let mut custom_data: BTreeMap<String, String> =
            [("description".to_owned(), format!("imported from {}", of.source))].into();
        custom_data.extend(scene.or(of.scene.as_deref()).map(|scene| ("scene".to_owned(), scene.to_owned())));
        if of.one_clock {
            custom_data.insert("one_clock".to_owned(), "true".to_owned());
        }
        let own_clock = of.origin_ns < OWN_CLOCK_NS;
        if own_clock {
            custom_data.insert("clock".to_owned(), "its own: 2000-01-01 is its time 0".to_owned());
        }
        let origin_ns = of.origin_ns + if own_clock { ZERO_NS } else { 0 };
        let library = needle_core::WRITER.to_owned();
        // takes two thirds of the time of zstd's default level, without a larger file for these messages
        let options =
            WriterOptions { flush_after: None, custom_data, library, compression_level: 1, ..WriterOptions::default() };
        let mut bag = BagWriter::create(folder, options)?;
        let reliable = Qos::reliable(10);
        let topics = [
            has[0].then(|| bag.add_topic::<JointState>("/measured_js", &reliable)).transpose()?,
            has[1].then(|| bag.add_topic::<PoseStamped>("/measured_cp", &reliable)).transpose()?,
            has[2].then(|| bag.add_topic::<WrenchStamped>("/measured_cf", &reliable)).transpose()?,
            has[3].then(|| bag.add_topic::<PoseArray>("/measured_targets", &reliable)).transpose()?,
        ];
        let (name, position) = (vec![of.topics.joint.clone()], vec![0.0]);
        let joint = JointState { name, position, ..JointState::default() };
        let frame = if of.force_frame.is_empty() { &of.topics.frame_id } else { &of.force_frame };
        let cell = WrenchStamped { header: header(0, frame), ..WrenchStamped::default() };
        Ok(Self { bag, of, origin_ns, topics, joint, cell })
    }

    /// Writes one sample. One of a series that was said not to exist is left out.
    pub(super) fn write(&mut self, sample: &Sample) -> Result<(), BagError> {
        let origin_ns = self.origin_ns;
        let stamp = |time_s: f64| origin_ns + (time_s * 1e9).round() as i64;
        let [depth, pose, force, targets] = self.topics;
        let Self { bag, of, joint, cell, .. } = self;
        match sample {
            Sample::Depth(DepthSample { time_s, depth_m }) => {
                let ns = stamp(*time_s);
                joint.header.stamp = Time::from_nanos(ns);
                joint.position[0] = *depth_m;
                depth.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, joint))
            }
            Sample::Pose(sample) => {
                let (PoseSample { time_s, tip: [x, y, z], .. }, orientation) = (sample, orientation(&sample.pose()));
                let ns = stamp(*time_s);
                let message = PoseStamped {
                    header: header(ns, &of.topics.frame_id),
                    pose: Pose { position: Point { x: *x, y: *y, z: *z }, orientation },
                };
                pose.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, &message))
            }
            Sample::Markers(MarkerSample { time_s, positions }) => {
                let ns = stamp(*time_s);
                let point = |&[x, y, z]: &[f64; 3]| Pose { position: Point { x, y, z }, ..Pose::default() };
                let poses = positions.iter().map(point).collect();
                let message = PoseArray { header: header(ns, &of.topics.frame_id), poses };
                targets.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, &message))
            }
            Sample::Force(ForceSample { time_s, force_n }) => {
                let ns = stamp(*time_s);
                cell.header.stamp = Time::from_nanos(ns);
                cell.wrench = Wrench { force: (*force_n).into(), torque: Vector3::default() };
                force.map_or(Ok(()), |topic| bag.write(topic, ns as u64, ns as u64, cell))
            }
        }
    }

    pub(super) fn finish(self) -> Result<Written, BagError> {
        self.bag.finish()
    }
}

fn header(ns: i64, frame: &str) -> Header {
    Header { stamp: Time::from_nanos(ns), frame_id: frame.to_owned() }
}

impl Recording {
    /// Writes the series as a rosbag2 folder: `/measured_js`, `/measured_cp`, `/measured_cf`, `/measured_targets`, as
    /// far as they exist. The same recording gives the same bytes.
    ///
    /// # Errors
    /// [`BagError`] if the folder exists, or can't be written.
    pub fn write(&self, folder: &Path, scene: Option<&str>) -> Result<Written, BagError> {
        let empty = [self.depths.is_empty(), self.poses.is_empty(), self.forces.is_empty(), self.markers.is_empty()];
        let mut topics = Topics::create(self, empty.map(|empty| !empty), folder, scene)?;
        self.in_time().try_for_each(|sample| topics.write(&sample))?;
        topics.finish()
    }
}
