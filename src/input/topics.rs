//! Which topics of a bag are the position, the force and the tracked points.

use std::path::Path;

use super::foreign::{ForceSource, PositionSource};
use super::recording::RecordingError;
use super::selection::Selection;
use super::unit::Dimension;
use ros2_messages::RosMessage;
use ros2_messages::geometry_msgs::{PoseStamped, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagError, BagReader, Topic};

/// The bag and what it says of itself.
pub(super) fn describe(bag: &BagReader) -> String {
    let name = Path::new(bag.name()).file_name().map_or(bag.name().into(), |n| n.to_string_lossy());
    match bag.custom_data("description") {
        Some(description) => format!("bag {name} ({description})"),
        None => format!("bag {name}"),
    }
}

pub(super) fn topic_error(bag: &BagReader, topic: &Topic, reason: String) -> BagError {
    BagError::Topic {
        bag: bag.name().to_owned(),
        topic: topic.name.clone(),
        type_name: topic.type_name.clone(),
        reason,
    }
}

pub(super) fn no_motion(bag: &BagReader) -> BagError {
    let lost: Vec<String> = bag.losses().iter().map(ToString::to_string).collect();
    let remedy = if lost.is_empty() {
        "Name the topics with the depth or the pose (--measured-js, --measured-cp), or remap them when recording. Of other types \
         (std_msgs/Float64, sensor_msgs/Range, ...), units or signs the rig makes these: `rig_node BAG --ros-args -p \
         position_topic:=TOPIC -p position_m_per_unit:=0.001`, recorded by `-p record:=FOLDER`"
            .to_owned()
    } else {
        format!("The bag is damaged: {}", lost.join("; "))
    };
    BagError::NoTopic {
        bag: bag.name().to_owned(),
        wanted: format!(
            "the depth (measured_js, {}) or the tip's pose (measured_cp, {})",
            JointState::TYPE,
            PoseStamped::TYPE
        ),
        available: bag.describe_topics(),
        remedy,
    }
}

/// The topic of type `T`: the named one, or the one whose name ends in `suffix`, or the only one of the type that is
/// not in `never`.
pub(super) fn find<T: RosMessage>(
    bag: &BagReader,
    named: Option<&str>,
    suffix: &str,
    never: &[&str],
) -> Result<Option<usize>, BagError> {
    if let Some(name) = named {
        let found = bag.topics().iter().position(|t| t.name.trim_start_matches('/') == name.trim_start_matches('/'));
        let Some(found) = found else {
            return Err(BagError::NoTopic {
                bag: bag.name().to_owned(),
                wanted: name.to_owned(),
                available: bag.describe_topics(),
                remedy: "Name one of these".to_owned(),
            });
        };
        let topic = &bag.topics()[found];
        if topic.type_name != T::TYPE {
            return Err(topic_error(bag, topic, format!("{} is needed here", T::TYPE)));
        }
        return Ok(Some(found));
    }
    let last = |t: &Topic| t.name.rsplit('/').next().unwrap_or_default().to_owned();
    let typed: Vec<usize> = (0..bag.topics().len())
        .filter(|&t| bag.topics()[t].type_name == T::TYPE && !never.contains(&last(&bag.topics()[t]).as_str()))
        .collect();
    let suffixed: Vec<usize> = typed.iter().copied().filter(|&t| last(&bag.topics()[t]) == suffix).collect();
    match (suffixed.as_slice(), typed.as_slice()) {
        ([one], _) | ([], [one]) => Ok(Some(*one)),
        ([], []) => Ok(None),
        ([], several) | (several, _) => {
            let names: Vec<&str> = several.iter().map(|&t| bag.topics()[t].name.as_str()).collect();
            Err(BagError::NoTopic {
                bag: bag.name().to_owned(),
                wanted: format!("{suffix} that stands out"),
                available: format!("several of type {}: {}", T::TYPE, names.join(", ")),
                remedy: "Name the one to take".to_owned(),
            })
        }
    }
}

/// The force of the tissue on the instrument, N, with its stamp and frame.
pub(super) fn force(m: WrenchStamped) -> (Result<[f64; 3], String>, Header) {
    let force: [f64; 3] = m.wrench.force.into();
    let finite = force.iter().all(|f| f.is_finite());
    let reason = || format!("its force {force:?} is not finite; check the load cell");
    (if finite { Ok(force) } else { Err(reason()) }, m.header)
}

/// The displacement sensor as the user describes it; `None` where its own numbers are taken as they are.
pub(super) fn position_source(bag: &BagReader, said: &Selection) -> Result<Option<PositionSource>, RecordingError> {
    let m_per_unit = said.position.scale(Dimension::Length, "--position-unit")?;
    if said.position.is_plain() {
        return Ok(None);
    }
    let own = find::<JointState>(bag, said.names.joint_state.as_deref(), "measured_js", &[]);
    let topic = match &said.position.place {
        Some(topic) => Some(topic.clone()),
        None => own?.map(|t| bag.topics()[t].name.clone()),
    };
    let source = |topic| PositionSource {
        topic,
        joint: String::new(),
        m_per_unit,
        offset_m: 0.0,
        joint_name: said.names.joint.clone(),
    };
    Ok(topic.map(source))
}

/// The load cell as the user describes it; as [`position_source`].
pub(super) fn force_source(bag: &BagReader, said: &Selection) -> Result<Option<ForceSource>, RecordingError> {
    let n_per_unit = said.force.scale(Dimension::Force, "--force-unit")?;
    if said.force.is_plain() {
        return Ok(None);
    }
    let own = find::<WrenchStamped>(bag, said.names.wrench.as_deref(), "measured_cf", &["predicted_cf"]);
    let topic = match &said.force.place {
        Some(topic) => Some(topic.clone()),
        None => own?.map(|t| bag.topics()[t].name.clone()),
    };
    let (axis, frame_id) = ([0.0, 0.0, 1.0], said.names.frame_id.clone());
    Ok(topic.map(|topic| ForceSource { topic, n_per_unit, axis, frame_id }))
}
