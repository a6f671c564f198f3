//! The publishers of the player: a bag's topics under their own names or as the user configures them, and `/clock`.

use std::collections::BTreeMap;
use std::time::Duration;

use ros2_client::qos::{Durability, History};
use ros2_client::{MessageTypeName, QosProfile};

use needle_recording::{ForceSource, PositionSource};
use needle_rig::Player;
use ros2_guarded::RawCdr;
use ros2_messages::geometry_msgs::WrenchStamped;
use ros2_messages::rosgraph_msgs::Clock;
use ros2_messages::schema::Schema;
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::tf2_msgs::TFMessage;
use ros2_messages::{RosMessage as _, from_cdr};
use ros2_node::names::Endpoint;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;
use ros2_node::start::NodeError;
use rosbag2_mcap::{BagReader, Message, Topic};

/// Topics that exist once per system; a namespace does not apply to them.
const OF_THE_SYSTEM: [&str; 6] = ["/clock", "/tf", "/tf_static", "/diagnostics", "/rosout", "/parameter_events"];

/// Topics of transforms.
const FRAMES: [&str; 2] = ["/tf", "/tf_static"];
/// The frame that a twin publishes from the poses that are played.
const TIP: &str = "needle_tip";

/// The parameters of the outputs.
pub(super) struct Wishes {
    pub clock_hz: f64,
    pub relative_names: bool,
    /// Topics that the user asks for by name.
    pub topics: Vec<String>,
    pub position: Option<PositionSource>,
    pub force: Option<ForceSource>,
}

/// What happens to the messages of a topic.
enum Sink {
    AsRecorded(Output<RawCdr>),
    Position(Output<JointState>, PositionSource),
    Force(Output<WrenchStamped>, ForceSource),
    /// Recorded transforms without that of the tip.
    Frames(Output<TFMessage>),
}

/// See the module.
pub(super) struct Outputs {
    /// Several sinks per topic: an array may contain the displacement and the force.
    by_topic: BTreeMap<usize, Vec<Sink>>,
    pub clock: Option<(Output<Clock>, Duration)>,
}

impl Outputs {
    /// One publisher per played topic, with the recorded QoS.
    pub(crate) fn new(participant: &mut Participant, player: &Player, wishes: Wishes) -> Result<Self, NodeError> {
        let Wishes { clock_hz, relative_names, topics, position, force } = wishes;
        let mut by_topic: BTreeMap<usize, Vec<Sink>> = BTreeMap::new();
        let bag = player.bag();
        if let Some(source) = position
            && let Ok(index) = source.check(bag)
        {
            let output = participant.publisher("measured_js", qos::reliable(10))?;
            by_topic.entry(index).or_default().push(Sink::Position(output, source));
        }
        if let Some(source) = force
            && let Ok(index) = source.check(bag)
        {
            let output = participant.publisher("measured_cf", qos::reliable(10))?;
            by_topic.entry(index).or_default().push(Sink::Force(output, source));
        }
        for (index, topic) in bag.topics().iter().enumerate().filter(|(i, _)| player.plays(*i)) {
            let name = played_name(&topic.name, relative_names);
            if by_topic.contains_key(&index) || is_made_here(participant, topic, name, clock_hz, &by_topic)? {
                continue;
            }
            let asked = topics.contains(&topic.name);
            if FRAMES.contains(&name) && topic.type_name == TFMessage::TYPE && topic.encoding == "cdr" && !asked {
                if let Some(output) = as_recorded(participant, topic, name)? {
                    by_topic.insert(index, vec![Sink::Frames(output)]);
                }
            } else if let Some(output) = as_recorded(participant, topic, name)? {
                by_topic.insert(index, vec![Sink::AsRecorded(output)]);
            }
        }
        let clock = if clock_hz > 0.0 {
            // As in rosbag2's player: best effort, so that no reader of the time delays the player.
            Some((participant.publisher("/clock", qos::sensor(1))?, Duration::from_secs_f64(1.0 / clock_hz)))
        } else {
            None
        };
        Ok(Self { by_topic, clock })
    }

    /// Whether a topic (index into the bag's) is played.
    pub(crate) fn plays(&self, topic: usize) -> bool {
        self.by_topic.contains_key(&topic)
    }

    /// Publishes a message of the bag.
    ///
    /// # Errors
    /// Why it can't be published.
    pub(crate) fn send(&self, bag: &BagReader, message: Message) -> Result<(), String> {
        for sink in self.by_topic.get(&message.topic).into_iter().flatten() {
            match sink {
                Sink::AsRecorded(output) => {
                    let raw = RawCdr::from_bag(message.data.clone())
                        .map_err(|start| format!("it starts with {start}, which is not little-endian CDR"))?;
                    output.send(raw);
                }
                Sink::Frames(output) => {
                    let mut frames: TFMessage = from_cdr(&message.data).map_err(|error| error.to_string())?;
                    let is_tip = |frame: &str| frame.rsplit('/').next() == Some(TIP);
                    frames.transforms.retain(|transform| !is_tip(&transform.child_frame_id));
                    if !frames.transforms.is_empty() {
                        output.send(frames);
                    }
                }
                Sink::Position(output, source) => {
                    output.send(source.convert(bag, &message)?);
                }
                Sink::Force(output, source) => {
                    output.send(source.convert(bag, &message)?);
                }
            }
        }
        Ok(())
    }
}

/// The program's name of the topic.
fn played_name(recorded: &str, relative: bool) -> &str {
    if relative && !OF_THE_SYSTEM.contains(&recorded) { recorded.trim_start_matches('/') } else { recorded }
}

/// Whether this node itself publishes under a recorded name.
fn is_made_here(
    participant: &Participant,
    topic: &Topic,
    name: &str,
    clock_hz: f64,
    by_topic: &BTreeMap<usize, Vec<Sink>>,
) -> Result<bool, NodeError> {
    if topic.name == "/clock" && clock_hz > 0.0 {
        tracing::info!("the bag's own /clock is not played: this node publishes it (clock_hz:=0 to change that)");
        return Ok(true);
    }
    let full = participant.names().resolve(name, Endpoint::Topic)?;
    let taken = by_topic.values().flatten().any(|sink| match sink {
        Sink::AsRecorded(_) | Sink::Frames(_) => false,
        Sink::Position(output, _) => output.topic() == full,
        Sink::Force(output, _) => output.topic() == full,
    });
    if taken {
        tracing::info!("the bag's own {} is not played: position_topic or force_topic takes its name", topic.name);
    }
    Ok(taken)
}

/// A publisher for a recorded topic; `None` if it can't be played.
fn as_recorded<M: serde::Serialize>(
    participant: &mut Participant,
    topic: &Topic,
    name: &str,
) -> Result<Option<Output<M>>, ParticipantError> {
    let Some((package, type_name)) = topic.type_name.split_once("/msg/").filter(|_| topic.encoding == "cdr") else {
        tracing::warn!(
            "{} can't be played: type `{}`, encoding `{}` (expected package/msg/Type and cdr)",
            topic.name,
            topic.type_name,
            topic.encoding
        );
        return Ok(None);
    };
    let schema =
        Schema { type_name: topic.type_name.clone(), text: topic.schema.to_string(), hash: topic.hash.clone() };
    let schema = Some(&schema).filter(|s| topic.schema_encoding == "ros2msg" && !s.text.is_empty());
    participant.publisher_of(name, &MessageTypeName::new(package, type_name), schema, recorded(topic)).map(Some)
}

/// The recorded QoS; reliable if the bag has none.
fn recorded(topic: &Topic) -> QosProfile {
    let Some(first) = topic.qos.first() else { return qos::reliable(10) };
    let depth = usize::try_from(first.depth).unwrap_or(0).clamp(10, 1000);
    let mut profile = if first.is_reliable() { qos::reliable(depth) } else { qos::sensor(depth) };
    if topic.qos.iter().any(rosbag2_mcap::Qos::is_transient_local) {
        profile = profile.durability(Durability::TransientLocal).history(History::KeepLast { depth: 1 });
    }
    profile
}
