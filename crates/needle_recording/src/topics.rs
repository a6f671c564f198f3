//! Finds the topics of position, force and tracked points in a bag.

use std::path::Path;

use super::error::RecordingError;
use super::foreign::{ForceSource, POSES, POSES_OF_BAGS, PositionSource, WRENCHES};
use super::selection::{Quantity, Selection};
use super::unit::Dimension;
use ros2_messages::RosMessage;
use ros2_messages::geometry_msgs::PoseStamped;
use ros2_messages::sensor_msgs::JointState;
use rosbag2_mcap::{BagError, BagReader, Topic};

/// The bag and its description.
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
         (std_msgs/Float64, sensor_msgs/Range, ...), units or signs: --position-topic TOPIC --position-unit mm"
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

/// A topic to be found.
pub(super) struct Sought<'a> {
    /// The name that the user gave.
    pub named: Option<&'a str>,
    /// The usual last part of its name.
    pub suffix: &'a str,
    /// Possible types, the usual one first.
    pub types: &'a [&'a str],
    /// Excluded last parts of names.
    pub never: &'a [&'a str],
    /// Whether a topic with a less usual type is accepted, if it is the only one.
    pub any_type: bool,
}

/// Finds the topic by the given name, else by the usual last part of the name, else as the only one of the usual
/// type, or of another type.
pub(super) fn find(bag: &BagReader, sought: &Sought) -> Result<Option<usize>, BagError> {
    if let Some(name) = sought.named {
        return named(bag, name, sought.types).map(Some);
    }
    let last = |t: &Topic| t.name.rsplit('/').next().unwrap_or_default().to_owned();
    let of = |types: &[&str]| -> Vec<usize> {
        let fits = |t: &Topic| types.contains(&t.type_name.as_str()) && !sought.never.contains(&last(t).as_str());
        (0..bag.topics().len()).filter(|&t| fits(&bag.topics()[t])).collect()
    };
    let (usual, others) = sought.types.split_at(sought.types.len().min(1));
    let suffixed: Vec<usize> =
        of(sought.types).into_iter().filter(|&t| last(&bag.topics()[t]) == sought.suffix).collect();
    let rest = if sought.any_type { of(others) } else { Vec::new() };
    let candidates = [suffixed, of(usual), rest].into_iter().find(|topics| !topics.is_empty());
    match candidates.as_deref() {
        None | Some([]) => Ok(None),
        Some([one]) => Ok(Some(*one)),
        Some(several) => {
            let names: Vec<&str> = several.iter().map(|&t| bag.topics()[t].name.as_str()).collect();
            Err(BagError::NoTopic {
                bag: bag.name().to_owned(),
                wanted: format!("{} that stands out", sought.suffix),
                available: format!("several of type {}: {}", bag.topics()[several[0]].type_name, names.join(", ")),
                remedy: format!("Name the one to take (--{})", sought.suffix.replace('_', "-")),
            })
        }
    }
}

fn named(bag: &BagReader, name: &str, types: &[&str]) -> Result<usize, BagError> {
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
    if types.contains(&topic.type_name.as_str()) {
        return Ok(found);
    }
    Err(topic_error(bag, topic, format!("{} is needed here", types.join(" or "))))
}

/// The displacement sensor.
pub(super) fn joint_state(bag: &BagReader, said: &Selection) -> Result<Option<usize>, BagError> {
    let named = said.names.joint_state.as_deref();
    let types = &[JointState::TYPE];
    find(bag, &Sought { named, suffix: "measured_js", types, never: &[], any_type: false })
}

/// The tip's pose. A less usual type is accepted only if no other topic gives the motion.
pub(super) fn pose(bag: &BagReader, said: &Selection, any_type: bool) -> Result<Option<usize>, BagError> {
    let of_position = said.position.place.as_deref().filter(|name| is_pose(bag, name));
    let named = said.names.pose.as_deref().or(of_position);
    let never = &["targets_with_covariance", "predicted_tip", "tf_static"];
    let types: &[&str] = if named.is_some() { &POSES_OF_BAGS } else { &POSES };
    let found = find(bag, &Sought { named, suffix: "measured_cp", types, never, any_type })?;
    // a tree of transforms only where nothing else tells the motion
    let of_tree = Sought { named: None, suffix: "tf", types: &POSES_OF_BAGS[POSES.len()..], never, any_type };
    if any_type && found.is_none() { find(bag, &of_tree) } else { Ok(found) }
}

/// Whether a topic contains poses.
pub(super) fn is_pose(bag: &BagReader, name: &str) -> bool {
    let bare = name.trim_start_matches('/');
    bag.topics().iter().any(|t| t.name.trim_start_matches('/') == bare && POSES_OF_BAGS.contains(&t.type_name.as_str()))
}

/// The load cell.
pub(super) fn wrench(bag: &BagReader, said: &Selection) -> Result<Option<usize>, BagError> {
    let named = said.names.wrench.as_deref();
    find(bag, &Sought { named, suffix: "measured_cf", types: &WRENCHES, never: &["predicted_cf"], any_type: true })
}

/// The displacement sensor as the user describes it; `None` if its numbers are used unchanged.
pub(super) fn position_source(bag: &BagReader, said: &Selection) -> Result<Option<PositionSource>, RecordingError> {
    let m_per_unit = said.position.scale(Dimension::Length, "--position-unit")?;
    if said.position.is_plain() {
        return Ok(None);
    }
    let own = joint_state(bag, said);
    let topic = match &said.position.place {
        Some(topic) => Some(topic.clone()),
        None => own?.map(|t| bag.topics()[t].name.clone()),
    };
    let source = |topic| PositionSource {
        topic,
        joint: String::new(),
        m_per_unit,
        offset_m: -m_per_unit * said.position.zero,
        joint_name: said.names.joint.clone(),
    };
    Ok(topic.map(source))
}

/// The load cell as the user describes it; `None` as in [`position_source`].
pub(super) fn force_source(bag: &BagReader, said: &Selection) -> Result<Option<ForceSource>, RecordingError> {
    let n_per_unit = said.force.scale(Dimension::Force, "--force-unit")?;
    // the zero is taken off where the measured axes are known
    if (Quantity { zero: 0.0, ..said.force.clone() }).is_plain() {
        return Ok(None);
    }
    let own = wrench(bag, said);
    let topic = match &said.force.place {
        Some(topic) => Some(topic.clone()),
        None => own?.map(|t| bag.topics()[t].name.clone()),
    };
    let (axis, frame_id) = ([0.0, 0.0, 1.0], said.names.frame_id.clone());
    Ok(topic.map(|topic| ForceSource { topic, n_per_unit, axis, frame_id }))
}
