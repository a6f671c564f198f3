//! Recordings of other rigs: selects the topics of displacement and force, and converts their units.
//!
//! The results have the types of this project's twin: a `JointState` whose position is the depth in m, and a
//! `WrenchStamped` with the force of the tissue on the instrument in N.

use ros2_messages::RosMessage;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{
    PointStamped, Pose, PoseStamped, PoseWithCovarianceStamped, Quaternion, TransformStamped, Vector3, Wrench,
    WrenchStamped,
};
use ros2_messages::sensor_msgs::{JointState, Range};
use ros2_messages::std_msgs::{Float32, Float64, Float64MultiArray, Header};
use ros2_messages::tf2_msgs::TFMessage;
use rosbag2_mcap::{BagReader, Message};

/// Why a topic can't be used as the user requests.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ForeignError {
    /// The bag has no such topic.
    #[error("{bag}: there is no topic {topic} ({parameter}); it has {available}")]
    NoTopic {
        /// The bag.
        bag: String,
        /// The topic that was requested.
        topic: String,
        /// The parameter that requested it.
        parameter: &'static str,
        /// The topics of the bag.
        available: String,
    },
    /// Its type does not contain the quantity.
    #[error("{bag}: {topic} is a {found}, and {parameter} takes {wanted}")]
    Type {
        /// The bag.
        bag: String,
        /// The topic.
        topic: String,
        /// Its type.
        found: String,
        /// The parameter that requested it.
        parameter: &'static str,
        /// Suitable types.
        wanted: &'static str,
    },
}

/// The topic of the displacement sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionSource {
    /// Recorded name; `/name[3]` is the element 3, from 0, of an array.
    pub topic: String,
    /// Joint to take from a `JointState`; empty: [`PositionSource::joint_name`], or the only one.
    pub joint: String,
    /// Depth in m per unit of the recorded number; negative if the number falls during insertion.
    pub m_per_unit: f64,
    /// Depth in m at the recorded number 0.
    pub offset_m: f64,
    /// Name of the joint that is published.
    pub joint_name: String,
}

/// The topic of the load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceSource {
    /// Recorded name; `/name[3]` is the element 3, from 0, of an array.
    pub topic: String,
    /// Force in N per unit of the recorded number; negative if the cell measures the force on the tissue.
    pub n_per_unit: f64,
    /// Direction of a force that is a single number, as a unit vector.
    pub axis: [f64; 3],
    /// Frame of the force, if the recorded message has none.
    pub frame_id: String,
}

/// Name of the topic, and the element of its array.
fn element(topic: &str) -> (&str, Option<usize>) {
    let parts = topic.strip_suffix(']').and_then(|t| t.split_once('['));
    parts.and_then(|(name, index)| Some((name, Some(index.parse().ok()?)))).unwrap_or((topic, None))
}

/// The number in a message: `Float64`, `Float32`, or an element of `Float64MultiArray`.
fn number(bag: &BagReader, message: &Message, kind: &str, topic: &str) -> Result<f64, String> {
    if kind == Float64::TYPE {
        return Ok(bag.decode::<Float64>(message)?.data);
    }
    if kind == Float32::TYPE {
        return Ok(f64::from(bag.decode::<Float32>(message)?.data));
    }
    let data = bag.decode::<Float64MultiArray>(message)?.data;
    let index = match element(topic).1 {
        Some(index) => index,
        None if data.len() == 1 => 0,
        None => {
            return Err(format!(
                "it is an array of {} numbers: name the one to take as {topic}[INDEX], from 0",
                data.len()
            ));
        }
    };
    data.get(index)
        .copied()
        .ok_or_else(|| format!("it has {} numbers, so none with the index {index}, from 0", data.len()))
}

/// Index of the topic in the bag.
fn find(
    bag: &BagReader,
    name: &str,
    parameter: &'static str,
    types: &[&str],
    wanted: &'static str,
) -> Result<usize, ForeignError> {
    let bare = element(name).0.trim_start_matches('/');
    let found = bag.topics().iter().position(|t| t.name.trim_start_matches('/') == bare);
    let number = found.ok_or_else(|| ForeignError::NoTopic {
        bag: bag.name().to_owned(),
        topic: name.to_owned(),
        parameter,
        available: bag.describe_topics(),
    })?;
    let topic = &bag.topics()[number];
    if types.contains(&topic.type_name.as_str()) {
        return Ok(number);
    }
    Err(ForeignError::Type {
        bag: bag.name().to_owned(),
        topic: name.to_owned(),
        found: topic.type_name.clone(),
        parameter,
        wanted,
    })
}

/// Types of a topic that contain the tip's pose.
pub const POSES: [&str; 4] =
    [PoseStamped::TYPE, TransformStamped::TYPE, PoseWithCovarianceStamped::TYPE, PointStamped::TYPE];
/// The same in a bag, where a tree of transforms is read as well.
pub(super) const POSES_OF_BAGS: [&str; 5] = [POSES[0], POSES[1], POSES[2], POSES[3], TFMessage::TYPE];
/// Types of a topic that contain a force with three components.
pub const WRENCHES: [&str; 2] = [WrenchStamped::TYPE, Wrench::TYPE];
/// Orientation of an instrument that points straight down: a rotation by 180 degrees about x.
const DOWN: Quaternion = Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 };

/// A message that holds the tip's pose or a wrench, live or recorded.
pub trait Holds<T>: RosMessage + 'static {
    /// The pose or wrench with stamp and frame, as far as the message has them.
    fn held(self) -> T;

    /// The frame whose pose it is, "" if it names none.
    fn tool(&self) -> &str {
        ""
    }
}

/// A pose and the frame that it is of, "" if it is not named.
#[derive(Clone, Debug, PartialEq)]
pub struct Posed {
    /// The pose.
    pub pose: PoseStamped,
    /// The frame.
    pub tool: String,
}

impl<M: Holds<PoseStamped>> Holds<Posed> for M {
    fn held(self) -> Posed {
        Posed { tool: Holds::<PoseStamped>::tool(&self).to_owned(), pose: self.held() }
    }
}

impl Holds<Self> for PoseStamped {
    fn held(self) -> Self {
        self
    }
}

impl Holds<PoseStamped> for TransformStamped {
    fn held(self) -> PoseStamped {
        let position = <[f64; 3]>::from(self.transform.translation).into();
        PoseStamped { header: self.header, pose: Pose { position, orientation: self.transform.rotation } }
    }

    fn tool(&self) -> &str {
        &self.child_frame_id
    }
}

impl Holds<PoseStamped> for PoseWithCovarianceStamped {
    fn held(self) -> PoseStamped {
        PoseStamped { header: self.header, pose: self.pose.pose }
    }
}

/// The instrument points straight down.
impl Holds<PoseStamped> for PointStamped {
    fn held(self) -> PoseStamped {
        PoseStamped { header: self.header, pose: Pose { position: self.point, orientation: DOWN } }
    }
}

impl Holds<Self> for WrenchStamped {
    fn held(self) -> Self {
        self
    }
}

impl Holds<WrenchStamped> for Wrench {
    fn held(self) -> WrenchStamped {
        WrenchStamped { header: Header::default(), wrench: self }
    }
}

/// The poses in a message of one of [`POSES_OF_BAGS`]: several in one of transforms.
pub(super) fn poses_of(bag: &BagReader, message: &Message) -> Result<Vec<Posed>, String> {
    let one = |posed: Posed| vec![posed];
    match bag.topics().get(message.topic).map_or("", |t| t.type_name.as_str()) {
        TransformStamped::TYPE => bag.decode::<TransformStamped>(message).map(Holds::held).map(one),
        PoseWithCovarianceStamped::TYPE => bag.decode::<PoseWithCovarianceStamped>(message).map(Holds::held).map(one),
        PointStamped::TYPE => bag.decode::<PointStamped>(message).map(Holds::held).map(one),
        TFMessage::TYPE => Ok(bag.decode::<TFMessage>(message)?.transforms.into_iter().map(Holds::held).collect()),
        _ => bag.decode::<PoseStamped>(message).map(Holds::held).map(one),
    }
}

/// The wrench from a message of one of [`WRENCHES`].
pub(super) fn wrench_of(bag: &BagReader, message: &Message) -> Result<WrenchStamped, String> {
    let kind = bag.topics().get(message.topic).map_or("", |t| t.type_name.as_str());
    if kind == Wrench::TYPE {
        return Ok(WrenchStamped { header: unstamped(message, ""), wrench: bag.decode(message)? });
    }
    bag.decode(message)
}

/// A message's own stamp, or the time of its recording.
fn stamped(header: Header, message: &Message) -> Header {
    if header.stamp.is_zero() { Header { stamp: recorded(message), ..header } } else { header }
}

fn recorded(message: &Message) -> Time {
    Time::from_nanos(i64::try_from(message.log_ns).unwrap_or(i64::MAX))
}

fn unstamped(message: &Message, frame_id: &str) -> Header {
    Header { stamp: recorded(message), frame_id: frame_id.to_owned() }
}

impl PositionSource {
    /// The topic's index in the bag, if it exists with a type that contains a position.
    ///
    /// # Errors
    /// [`ForeignError`].
    pub fn check(&self, bag: &BagReader) -> Result<usize, ForeignError> {
        let types = [JointState::TYPE, Range::TYPE, Float64::TYPE, Float32::TYPE, Float64MultiArray::TYPE];
        let wanted = "sensor_msgs/msg/JointState, sensor_msgs/msg/Range, std_msgs/msg/Float64, std_msgs/msg/Float32 or an element \
                      of std_msgs/msg/Float64MultiArray";
        find(bag, &self.topic, "position_topic", &types, wanted)
    }

    /// The depth in a message of the topic.
    ///
    /// # Errors
    /// Why the message has none.
    pub fn convert(&self, bag: &BagReader, message: &Message) -> Result<JointState, String> {
        let kind = bag.topics().get(message.topic).map_or("", |t| t.type_name.as_str());
        if kind == JointState::TYPE {
            return self.joint_state(bag.decode(message)?, message);
        }
        let (header, value) = if kind == Range::TYPE {
            let range: Range = bag.decode(message)?;
            (stamped(range.header, message), f64::from(range.range))
        } else {
            (unstamped(message, ""), number(bag, message, kind, &self.topic)?)
        };
        Ok(self.depth(header, value, None))
    }

    fn joint_state(&self, from: JointState, message: &Message) -> Result<JointState, String> {
        let wanted = if self.joint.is_empty() { &self.joint_name } else { &self.joint };
        let index = match from.name.iter().position(|name| name == wanted) {
            None if self.joint.is_empty() && from.position.len() == 1 => 0,
            found => found.ok_or_else(|| {
                format!(
                    "it has the joints {:?}, not `{wanted}`: set position_joint to the one that is the depth",
                    from.name
                )
            })?,
        };
        let value = *from.position.get(index).ok_or("it names the joint but has no position for it")?;
        let velocity = from.velocity.get(index).copied();
        Ok(self.depth(stamped(from.header, message), value, velocity))
    }

    fn depth(&self, header: Header, value: f64, velocity: Option<f64>) -> JointState {
        JointState {
            header,
            name: vec![self.joint_name.clone()],
            position: vec![self.m_per_unit * value + self.offset_m],
            velocity: velocity.map(|v| self.m_per_unit * v).into_iter().collect(),
            effort: Vec::new(),
        }
    }
}

impl ForceSource {
    /// The topic's index in the bag, if it exists with a type that contains a force.
    ///
    /// # Errors
    /// [`ForeignError`].
    pub fn check(&self, bag: &BagReader) -> Result<usize, ForeignError> {
        let types = [WrenchStamped::TYPE, Wrench::TYPE, Float64::TYPE, Float32::TYPE, Float64MultiArray::TYPE];
        let wanted = "geometry_msgs/msg/WrenchStamped, geometry_msgs/msg/Wrench, std_msgs/msg/Float64, std_msgs/msg/Float32 or an element of \
                      std_msgs/msg/Float64MultiArray";
        find(bag, &self.topic, "force_topic", &types, wanted)
    }

    /// The force in a message of the topic.
    ///
    /// # Errors
    /// Why the message has none.
    pub fn convert(&self, bag: &BagReader, message: &Message) -> Result<WrenchStamped, String> {
        let kind = bag.topics().get(message.topic).map_or("", |t| t.type_name.as_str());
        if [WrenchStamped::TYPE, Wrench::TYPE].contains(&kind) {
            let from = wrench_of(bag, message)?;
            let mut header = stamped(from.header, message);
            if header.frame_id.is_empty() {
                header.frame_id.clone_from(&self.frame_id);
            }
            let wrench = Wrench { force: self.scaled(from.wrench.force), torque: self.scaled(from.wrench.torque) };
            return Ok(WrenchStamped { header, wrench });
        }
        let value = number(bag, message, kind, &self.topic)?;
        let force = self.axis.map(|a| a * self.n_per_unit * value).into();
        Ok(WrenchStamped {
            header: unstamped(message, &self.frame_id),
            wrench: Wrench { force, torque: Vector3::default() },
        })
    }

    fn scaled(&self, v: Vector3) -> Vector3 {
        <[f64; 3]>::from(v).map(|x| self.n_per_unit * x).into()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rosbag2_mcap::{BagWriter, Qos, WriterOptions};

    const STAMP: Time = Time { sec: 7, nanosec: 5 };
    const LOG: u64 = 9_000_000_000;

    fn position(topic: &str) -> PositionSource {
        PositionSource {
            topic: topic.to_owned(),
            joint: String::new(),
            m_per_unit: -1e-3,
            offset_m: 0.1,
            joint_name: "insertion".to_owned(),
        }
    }

    fn force(topic: &str) -> ForceSource {
        ForceSource { topic: topic.to_owned(), n_per_unit: -9.81e-3, axis: [0.0, 0.0, 1.0], frame_id: "sample".into() }
    }

    fn bag(folder: &std::path::Path) -> BagReader {
        let mut writer = BagWriter::create(folder.join("b"), WriterOptions::default()).unwrap();
        let number = writer.add_topic::<Float64>("/number", &Qos::reliable(10)).unwrap();
        let joints = writer.add_topic::<JointState>("/joints", &Qos::reliable(10)).unwrap();
        let cell = writer.add_topic::<WrenchStamped>("/cell", &Qos::reliable(10)).unwrap();
        writer.write(number, LOG, LOG, &Float64 { data: 40.0 }).unwrap();
        let header = Header { stamp: STAMP, frame_id: String::new() };
        let two = JointState {
            header: header.clone(),
            name: vec!["elbow".into(), "z".into()],
            position: vec![1.0, 50.0],
            velocity: vec![0.0, 2.0],
            effort: Vec::new(),
        };
        writer.write(joints, LOG + 1, LOG, &two).unwrap();
        let wrench = Wrench { force: [1.0, 0.0, -100.0].into(), torque: Vector3::default() };
        writer.write(cell, LOG + 2, LOG, &WrenchStamped { header, wrench }).unwrap();
        BagReader::open(writer.finish().unwrap().folder).unwrap()
    }

    #[test]
    fn units_signs_and_stamps() {
        let folder = tempfile::tempdir().unwrap();
        let bag = bag(folder.path());
        let messages: Vec<Message> = bag.messages().collect();
        let depth = position("/number").convert(&bag, &messages[0]).unwrap();
        assert_eq!((depth.header.stamp.sec, depth.name[0].as_str()), (9, "insertion"), "no stamp: the recording's");
        assert!((depth.position[0] - 0.06).abs() < 1e-15);
        let scalar = force("/number").convert(&bag, &messages[0]).unwrap();
        assert!((scalar.wrench.force.z + 0.3924).abs() < 1e-12 && scalar.header.frame_id == "sample");
        let named = PositionSource { joint: "z".to_owned(), ..position("/joints") };
        let depth = named.convert(&bag, &messages[1]).unwrap();
        assert_eq!(depth.header.stamp, STAMP);
        assert!((depth.position[0] - 0.05).abs() < 1e-15 && (depth.velocity[0] + 2e-3).abs() < 1e-15);
        assert!(position("/joints").convert(&bag, &messages[1]).unwrap_err().contains("position_joint"));
        let wrench = force("/cell").convert(&bag, &messages[2]).unwrap();
        assert!((wrench.wrench.force.z - 0.981).abs() < 1e-12 && wrench.header.stamp == STAMP);
    }

    #[test]
    fn what_holds_no_position_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let bag = bag(folder.path());
        let message = position("/nothing").check(&bag).unwrap_err().to_string();
        assert!(message.contains("/nothing") && message.contains("/joints"), "{message}");
        let message = position("/cell").check(&bag).unwrap_err().to_string();
        assert!(message.contains("WrenchStamped") && message.contains("Range"), "{message}");
        assert!(force("/joints").check(&bag).is_err() && force("/number").check(&bag).is_ok());
    }
}
