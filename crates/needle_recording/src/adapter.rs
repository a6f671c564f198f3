//! Converts messages to poses. Live node, replay and calibration all use this module to decide what a depth or a pose
//! is.

use ros2_messages::geometry_msgs::{PoseStamped, Quaternion};
use ros2_messages::sensor_msgs::JointState;

use super::selection::TopicNames;
use needle_core::twin::Pose;

/// Norms of a quaternion that counts as a rotation, with a tolerance for rounding.
const ROTATION: std::ops::RangeInclusive<f64> = 0.9..=1.1;

/// What a message must contain to be accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Adapter<'a> {
    /// Joint whose position is the depth.
    pub joint: &'a str,
    /// Frame of the poses: origin at the centre of the sample's bottom face, z up.
    pub frame_id: &'a str,
}

/// Why a message is rejected; the text says what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The message has no such joint.
    #[error(
        "it has no joint `{wanted}` but {}; name the one whose position is the depth in m (joint_name of the node, \
         --joint of a replay)",
        if found.is_empty() { "joints without names".to_owned() } else { found.join(", ") }
    )]
    NoSuchJoint {
        /// The joint that is wanted.
        wanted: String,
        /// The joints of the message.
        found: Vec<String>,
    },
    /// The joint has no position.
    #[error("it names the joint `{wanted}` but has no position for it")]
    NoPosition {
        /// The joint that is wanted.
        wanted: String,
    },
    /// The position is not finite.
    #[error("its position {depth_m} is not finite; check the sensor")]
    Depth {
        /// The received value.
        depth_m: f64,
    },
    /// The pose is in another frame.
    #[error(
        "it is in frame `{found}`, the twin needs `{wanted}` (origin at the centre of the sample's bottom face, z up): \
         transform it (--sample-pose of a replay: the sample's pose in `{found}`), or name the frame if it is the sample's (frame_id of \
         the node, --frame-id of a replay{})",
        if found.is_empty() { ": --frame-id \"\" where there is none" } else { "" }
    )]
    WrongFrame {
        /// The frame that the twin needs.
        wanted: String,
        /// The received frame.
        found: String,
    },
    /// The pose is that of another frame than the tip's.
    #[error("it is the pose of `{found}`, and the tip is `{wanted}` (joint_name of the node, --joint of a replay)")]
    OtherTool {
        /// The frame that the message is of.
        found: String,
        /// The tip's frame.
        wanted: String,
    },
    /// Several frames share the topic, and none is named.
    #[error(
        "the topic has the poses of `{0}` and of `{1}`: name that of the tip (joint_name of the node, --joint of a replay)"
    )]
    SeveralTools(String, String),
    /// A coordinate is not finite.
    #[error("its position {position:?} is not finite; check the sensor")]
    Position {
        /// The received position, m.
        position: [f64; 3],
    },
    /// The quaternion is not a rotation.
    #[error("its quaternion has the norm {norm}, that of a rotation is 1 (taken are {} to {})", ROTATION.start(), ROTATION.end())]
    NoRotation {
        /// The received norm.
        norm: f64,
    },
}

/// The frames of which a topic has the poses: a tracker may publish all its tools on one.
#[derive(Clone, Debug, Default)]
pub struct Tools {
    first: String,
    other: Option<String>,
}

impl Tools {
    /// Whether a pose is that of the tip. `joint`: the frame of the tip, or the default if none was named; `tool`: the frame of the pose,
    /// "" of messages that name none.
    ///
    /// # Errors
    /// [`Refusal::OtherTool`]; [`Refusal::SeveralTools`] if none was named and poses of two frames came.
    pub fn check(&mut self, tool: &str, joint: &str) -> Result<(), Refusal> {
        if tool.is_empty() || joint == tool {
            return Ok(());
        }
        if joint != TopicNames::default().joint {
            return Err(Refusal::OtherTool { found: tool.to_owned(), wanted: joint.to_owned() });
        }
        if self.first.is_empty() {
            tool.clone_into(&mut self.first);
        } else if self.first != tool {
            self.other.get_or_insert_with(|| tool.to_owned());
        }
        let several = |other: &String| Refusal::SeveralTools(self.first.clone(), other.clone());
        self.other.as_ref().map_or(Ok(()), |other| Err(several(other)))
    }
}

impl Adapter<'_> {
    /// Depth of the tip below the undeformed top surface, m: the position of the joint. If a message has one position
    /// and no names, it is taken as that joint's.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn depth(&self, message: &JointState) -> Result<f64, Refusal> {
        let wanted = || self.joint.to_owned();
        let none = || Refusal::NoSuchJoint { wanted: wanted(), found: message.name.clone() };
        let index = self.index(message).ok_or_else(none)?;
        let depth_m = *message.position.get(index).ok_or_else(|| Refusal::NoPosition { wanted: wanted() })?;
        if depth_m.is_finite() { Ok(depth_m) } else { Err(Refusal::Depth { depth_m }) }
    }

    /// Velocity of the joint, m/s: 0 if the message has none.
    #[must_use]
    pub fn velocity(&self, message: &JointState) -> f64 {
        let velocity = self.index(message).and_then(|index| message.velocity.get(index)).copied();
        velocity.filter(|v| v.is_finite()).unwrap_or_default()
    }

    fn index(&self, message: &JointState) -> Option<usize> {
        let alone = message.name.is_empty() && message.position.len() == 1;
        message.name.iter().position(|name| name == self.joint).or_else(|| alone.then_some(0))
    }

    /// Pose of the tip in the sample's frame.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn pose(&self, message: &PoseStamped) -> Result<Pose, Refusal> {
        let frame = |name: &str| name.trim_start_matches('/').to_owned();
        if message.header.frame_id.trim_start_matches('/') != self.frame_id.trim_start_matches('/') {
            return Err(Refusal::WrongFrame { wanted: frame(self.frame_id), found: frame(&message.header.frame_id) });
        }
        let tip: [f64; 3] = message.pose.position.into();
        if !tip.iter().all(|x| x.is_finite()) {
            return Err(Refusal::Position { position: tip });
        }
        pose_of(tip, message.pose.orientation)
    }
}

/// The pose of an instrument that points along +z of its own frame.
pub(super) fn pose_of(tip: [f64; 3], q: Quaternion) -> Result<Pose, Refusal> {
    let axis = forward(q)?;
    let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    let (x, y, z, w) = (q.x / norm, q.y / norm, q.z / norm, q.w / norm);
    // first column of the rotation matrix
    let first = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)];
    Ok(Pose::with_x_axis(tip, axis, first))
}

/// The orientation of an instrument that does not point straight up: half a turn about x, then the shortest way from straight down to its axis, then
/// its roll.
#[must_use]
pub fn orientation(pose: &Pose) -> Quaternion {
    let [x, y, z] = pose.axis;
    let norm = (2.0 * (1.0 - z)).sqrt();
    let [qx, qz, qw] = [(1.0 - z) / norm, x / norm, (0.0 - y) / norm];
    let upright = Quaternion { x: qx, y: 0.0, z: qz, w: qw };
    let turn = pose.roll_rad - pose_of(pose.tip, upright).map_or(0.0, |upright| upright.roll_rad);
    if turn.sin().abs() < 1e-12 && turn.cos() > 0.0 {
        return upright;
    }
    // about the instrument's own z, which points down
    let (s, c) = (-0.5 * turn).sin_cos();
    Quaternion { x: qx * c, y: 0.0 - qx * s, z: qz * c + qw * s, w: qw * c - qz * s }
}

/// The instrument points along +z of its own frame (CRTK's tool frame): third column of the rotation matrix.
pub(super) fn forward(q: Quaternion) -> Result<[f64; 3], Refusal> {
    let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    if !ROTATION.contains(&norm) {
        return Err(Refusal::NoRotation { norm });
    }
    let (x, y, z, w) = (q.x / norm, q.y / norm, q.z / norm, q.w / norm);
    Ok([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn an_orientation_is_read_back_with_its_roll() {
        for axis in [[0.0, 0.0, -1.0], [0.36, -0.48, -0.8], [0.6, 0.8, 0.0], [0.0, -0.6, -0.8]] {
            for i in -6..7 {
                let pose = Pose { tip: [1.0, 2.0, 3.0], axis, roll_rad: 0.5 * f64::from(i) };
                let again = pose_of(pose.tip, orientation(&pose)).unwrap();
                assert!((again.roll_rad - pose.roll_rad).abs() < 1e-9, "{pose:?} {again:?}");
                assert!(again.axis.iter().zip(axis).all(|(a, b)| (a - b).abs() < 1e-12), "{pose:?} {again:?}");
            }
        }
        // x of the tool along y of the frame: a quarter of a turn, counter-clockwise as seen from above
        let quarter = Pose::with_x_axis([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]);
        assert!((quarter.roll_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn straight_down_is_half_a_turn_about_x() {
        let axis = forward(Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 }).unwrap();
        assert!((axis[2] + 1.0).abs() < 1e-12);
        for (x, w) in [(0.0, 0.0), (f64::NAN, 1.0), (2.0, 0.0), (0.0, 0.89)] {
            assert!(forward(Quaternion { x, y: 0.0, z: 0.0, w }).is_err(), "{x} {w}");
        }
    }
}
