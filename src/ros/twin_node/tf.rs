//! The frames: where the sample, the instrument's tip and the load cell are, on `/tf_static` and `/tf`.

use std::time::{Duration, Instant};

use super::declared;
use needle_core::scene::Scene;
use needle_core::twin::Pose;
use needle_recording::orientation;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Pose as PoseMessage, Transform, TransformStamped, Vector3};
use ros2_messages::std_msgs::Header;
use ros2_messages::tf2_msgs::TFMessage;
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;

/// Shortest mean interval between two transforms of the tip.
const PERIOD: Duration = Duration::from_millis(10);

/// The publishers, and the names of the frames.
pub(super) struct Transforms {
    moving: Output<TFMessage>,
    fixed: Output<TFMessage>,
    /// Frame in which the sample is; empty: somebody else publishes it.
    parent: String,
    sample: String,
    tip: String,
    load_cell: String,
    load_cell_height_m: f64,
}

impl Transforms {
    /// None with `publish_tf` off.
    pub(crate) fn new(
        participant: &mut Participant,
        parameters: &Parameters,
        scene: &Scene,
    ) -> Result<Option<Self>, ParticipantError> {
        if !parameters.get(declared::PUBLISH_TF) {
            return Ok(None);
        }
        let sample = parameters.get(declared::FRAME_ID);
        let beside = |name: &str| format!("{}{name}", &sample[..sample.rfind('/').map_or(0, |at| at + 1)]);
        let (tip, load_cell) = (beside("needle_tip"), beside("load_cell"));
        Ok(Some(Self {
            // as tf2_ros has them
            moving: participant.publisher("/tf", qos::reliable(100))?,
            fixed: participant.publisher("/tf_static", qos::latched())?,
            parent: parameters.get(declared::PARENT_FRAME_ID),
            sample,
            tip,
            load_cell,
            load_cell_height_m: scene.instrument.map_or(0.0, |instrument| instrument.load_cell_height.get()),
        }))
    }

    /// Publishes what does not move: once, since late subscribers receive it too. A publisher of `/tf_static` keeps one
    /// message, so all of them are in it.
    pub(crate) fn announce(&self, stamp: Time) {
        let mut transforms = Vec::new();
        if !self.parent.is_empty() && self.parent != self.sample {
            transforms.push(transform(stamp, &self.parent, &self.sample, Transform::default()));
        }
        let up = Vector3 { x: 0.0, y: 0.0, z: 0.0 - self.load_cell_height_m };
        let height = Transform { translation: up, ..Transform::default() };
        transforms.push(transform(stamp, &self.tip, &self.load_cell, height));
        self.fixed.send(TFMessage { transforms });
    }

    /// Publishes where the tip is.
    pub(crate) fn moved(&self, stamp: Time, pose: &Pose) {
        if self.moving.is_wanted() {
            let there = Transform { translation: pose.tip.into(), rotation: orientation(pose) };
            self.moving.send(TFMessage { transforms: vec![transform(stamp, &self.sample, &self.tip, there)] });
        }
    }

    pub(crate) fn failed(&self) -> u64 {
        self.moving.failed() + self.fixed.failed()
    }
}

fn transform(stamp: Time, parent: &str, child: &str, transform: Transform) -> TransformStamped {
    let header = Header { stamp, frame_id: parent.to_owned() };
    TransformStamped { header, child_frame_id: child.to_owned(), transform }
}

/// A pose as a message has it.
pub(super) fn pose(pose: &Pose) -> PoseMessage {
    PoseMessage { position: pose.tip.into(), orientation: orientation(pose) }
}

/// The newest pose, until its transform is due.
pub(super) struct Newest {
    pose: Option<(Time, Pose)>,
    due: Instant,
}

impl Newest {
    pub(crate) fn new(now: Instant) -> Self {
        Self { pose: None, due: now }
    }

    /// `None` forgets the pose.
    pub(crate) fn put(&mut self, pose: Option<(Time, Pose)>) {
        self.pose = pose;
    }

    /// When the pose is due, if there is one.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.pose.map(|_| self.due)
    }

    /// The pose, if it is due. On average one in [`PERIOD`].
    pub(crate) fn take(&mut self, now: Instant) -> Option<(Time, Pose)> {
        if now < self.due {
            return None;
        }
        let pose = self.pose.take()?;
        self.due = (self.due + PERIOD).max(now);
        Some(pose)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_messages::geometry_msgs::Quaternion;

    /// R z by the matrix of a quaternion.
    fn along(q: &Quaternion) -> [f64; 3] {
        [2.0 * (q.x * q.z + q.w * q.y), 2.0 * (q.y * q.z - q.w * q.x), 1.0 - 2.0 * (q.x * q.x + q.y * q.y)]
    }

    #[test]
    fn the_tip_looks_along_the_instrument() {
        let (oblique, flat) = ([0.36, -0.48, -0.8], [0.6, 0.8, 0.0]);
        for axis in [[0.0, 0.0, -1.0], oblique, flat] {
            let q = orientation(&Pose { tip: [0.0; 3], axis, roll_rad: 0.0 });
            let norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
            assert!((norm - 1.0).abs() < 1e-15, "{q:?}");
            assert!(along(&q).iter().zip(axis).all(|(a, b)| (a - b).abs() < 1e-15), "{q:?} for {axis:?}");
        }
        let down = Pose { tip: [0.0; 3], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 };
        assert_eq!(orientation(&down), Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 });
    }

    #[test]
    fn a_kilohertz_of_poses_is_a_hundred_transforms_and_the_last_one_is_among_them() {
        let begun = Instant::now();
        let pose = Pose { tip: [0.0; 3], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 };
        let (mut newest, mut said) = (Newest::new(begun), Vec::new());
        for ms in 0..1005_u32 {
            newest.put(Some((Time::from_nanos(i64::from(ms)), pose)));
            said.extend(newest.take(begun + Duration::from_millis(ms.into())).map(|(stamp, _)| stamp.nanos()));
        }
        assert_eq!((said.len(), said.last()), (101, Some(&1000)));
        let due = newest.due();
        assert_eq!(due, Some(begun + Duration::from_millis(1010)), "the last pose waits for its turn");
        assert_eq!(due.and_then(|due| newest.take(due)).map(|(stamp, _)| stamp.nanos()), Some(1004));
        assert_eq!(newest.due(), None);
    }
}
