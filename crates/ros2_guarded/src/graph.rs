//! Who is matched with whom, and why somebody is not: a QoS or a type that doesn't fit is said loudly, with the remedy.

use std::collections::BTreeSet;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ros2_client::QosProfile;
use ros2_client::dds::rustdds::dds::statusevents::{
    DomainParticipantStatusEvent as Status, EndpointDescription, StatusEvented,
};
use ros2_client::dds::rustdds::{DomainParticipant, GUID, RTPSEntity};
use ros2_client::qos::{Durability, Reliability};
use smol::stream::StreamExt;

use super::prompt::Prompt;
use super::services::ReplyReaders;
use super::uplink::Uplink;
use super::wire::{Head, Kind, UNSTAMPED};
use crate::qos::{self, Side};

/// RTPS's number for Fast DDS, with which the GUIDs of its participants begin.
const VENDOR_FAST_DDS: [u8; 2] = [0x01, 0x0f];
/// Topics that every node publishes.
pub(super) const SHARED: [&str; 3] = ["/diagnostics", "/rosout", "/parameter_events"];

/// One own endpoint.
pub(super) struct EndpointRecord {
    number: u16,
    side: Side,
    guid: GUID,
    topic: String,
    dds_topic: String,
    dds_type: String,
    profile: QosProfile,
    remotes: BTreeSet<GUID>,
    /// Whether a reader on Fast DDS has been matched.
    fast_dds: Arc<AtomicBool>,
}

impl EndpointRecord {
    pub(crate) fn new(number: u16, side: Side, guid: GUID, topic: &str, dds_type: &str, profile: QosProfile) -> Self {
        Self {
            number,
            side,
            guid,
            topic: topic.to_owned(),
            dds_topic: format!("rt{topic}"),
            dds_type: dds_type.to_owned(),
            profile,
            remotes: BTreeSet::new(),
            fast_dds: Arc::default(),
        }
    }

    /// Tells whether a reader on Fast DDS has been matched.
    pub(crate) fn fast_dds(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.fast_dds)
    }

    fn update(&mut self, uplink: &Uplink, change: impl FnOnce(&mut BTreeSet<GUID>)) {
        let before = self.remotes.len();
        change(&mut self.remotes);
        if self.remotes.len() != before {
            let count = u32::try_from(self.remotes.len()).unwrap_or(u32::MAX);
            uplink.send(Head::of(Kind::Matched, self.number, UNSTAMPED), &count.to_ne_bytes());
        }
    }
}

/// Watches discovery and tells the node who else is there: what only the node itself would hear needs no network.
pub(super) struct Graph {
    participant: DomainParticipant,
    records: Vec<EndpointRecord>,
    warned: BTreeSet<(GUID, GUID)>,
    uplink: Arc<Uplink>,
    readers: Rc<ReplyReaders>,
    /// Readers of calls.
    servers: BTreeSet<GUID>,
    prompt: Option<Prompt>,
}

impl Graph {
    /// Without a `prompt` some calls of Fast DDS take 3 s longer.
    pub(crate) fn new(
        participant: &DomainParticipant,
        uplink: Arc<Uplink>,
        readers: Rc<ReplyReaders>,
        prompt: Option<Prompt>,
    ) -> Self {
        let (records, warned, servers) = (Vec::new(), BTreeSet::new(), BTreeSet::new());
        Self { participant: participant.clone(), records, warned, uplink, readers, servers, prompt }
    }

    pub(crate) fn serve(&mut self, reader: GUID) {
        self.servers.insert(reader);
    }

    pub(crate) fn add(&mut self, record: EndpointRecord) {
        self.records.push(record);
    }

    /// Takes what discovery has to say, for ever: the counts of every endpoint, and what can't match.
    pub(crate) async fn watch(mut self) {
        let listener = self.participant.status_listener();
        let mut events = listener.as_async_status_stream();
        while let Some(event) = events.next().await {
            self.take(event);
        }
    }

    fn take(&mut self, event: Status) {
        let uplink = &self.uplink;
        match event {
            Status::RemoteReaderMatched { local_writer: own, remote_reader: remote }
            | Status::RemoteWriterMatched { local_reader: own, remote_writer: remote }
                if remote.prefix != own.prefix =>
            {
                self.readers.matched(remote);
                if let Some(prompt) = &self.prompt
                    && self.servers.contains(&own)
                    && remote.prefix.as_ref().starts_with(&VENDOR_FAST_DDS)
                {
                    prompt.ask(own, remote);
                }
                if let Some(record) = self.records.iter_mut().find(|r| r.guid == own) {
                    if remote.prefix.as_ref().starts_with(&VENDOR_FAST_DDS) {
                        record.fast_dds.store(true, Ordering::Relaxed);
                    }
                    record.update(uplink, |remotes| {
                        remotes.insert(remote);
                    });
                }
            }
            Status::ReaderLost { guid, .. } | Status::WriterLost { guid, .. } => {
                self.readers.forget(|reader| reader == guid);
                for record in &mut self.records {
                    record.update(uplink, |remotes| {
                        remotes.remove(&guid);
                    });
                }
            }
            Status::ParticipantLost { id, .. } => {
                self.readers.forget(|reader| reader.prefix == id);
                for record in &mut self.records {
                    record.update(uplink, |remotes| remotes.retain(|guid| guid.prefix != id));
                }
            }
            Status::RemoteReaderQosIncompatible { local_writer: own, remote_reader: remote, requested_qos, .. } => {
                self.warn_qos(own, remote, &QosProfile::from(&*requested_qos));
            }
            Status::RemoteWriterQosIncompatible { local_reader: own, remote_writer: remote, offered_qos, .. } => {
                self.warn_qos(own, remote, &QosProfile::from(&*offered_qos));
            }
            Status::ReaderDetected { reader } => {
                self.readers.detected(reader.guid, &reader.topic_name);
                self.check_type(&reader, Side::Subscription);
            }
            Status::WriterDetected { writer } => self.check_type(&writer, Side::Publisher),
            _ => {}
        }
    }

    fn warn_qos(&mut self, own: GUID, remote: GUID, theirs: &QosProfile) {
        let Some(record) = self.records.iter().find(|r| r.guid == own) else { return };
        if self.warned.insert((own, remote)) {
            self.warn(&qos_remedy(record.side, &record.topic, &record.profile, theirs));
        }
    }

    /// RustDDS matches by topic name alone, so a foreign type would be decoded as ours.
    fn check_type(&mut self, remote: &EndpointDescription, side: Side) {
        if remote.guid.prefix == self.participant.guid().prefix {
            return;
        }
        for record in self.records.iter().filter(|r| r.dds_topic == remote.topic_name) {
            if record.dds_type != remote.type_name {
                // ros2-client nodes subscribe /clock under a second name.
                let known = record.topic == "/clock" && remote.type_name.contains("builtin_interfaces");
                if !known && self.warned.insert((record.guid, remote.guid)) {
                    self.warn(&other_type(&record.topic, side, &remote.type_name, &record.dds_type));
                }
            } else if side == Side::Publisher
                && record.side == Side::Publisher
                && !SHARED.contains(&record.topic.as_str())
                && self.warned.insert((record.guid, remote.guid))
            {
                self.warn(&second_publisher(&record.topic));
            }
        }
    }

    fn warn(&self, text: &str) {
        self.uplink.log(log::Level::Warn, text);
    }
}

/// A peer on the topic speaks another type.
pub(super) fn other_type(topic: &str, side: Side, theirs: &str, ours: &str) -> String {
    format!(
        "`{topic}`: a {} of type {} is on this topic; this node speaks {}. Remap one of them (-r {topic}:=/other), or name the type where \
         the node has a parameter for it (-p {}_type:=...)",
        side.word(),
        ros_type(theirs),
        ros_type(ours),
        topic.rsplit('/').next().unwrap_or_default(),
    )
}

/// A peer publishes what this node publishes.
pub(super) fn second_publisher(topic: &str) -> String {
    format!(
        "`{topic}` is published by somebody else too: readers get both. Give one of the nodes a namespace \
         (--ros-args -r __ns:=/name)"
    )
}

/// `std_msgs::msg::dds_::String_` as ROS calls it: `std_msgs/msg/String`; what is none of ROS stays.
pub(super) fn ros_type(dds_type: &str) -> String {
    let parts = dds_type.split_once("::dds_::").and_then(|(package, name)| Some((package, name.strip_suffix('_')?)));
    parts.map_or_else(|| dds_type.to_owned(), |(package, name)| format!("{}/{name}", package.replace("::", "/")))
}

fn qos_remedy(side: Side, topic: &str, ours: &QosProfile, theirs: &QosProfile) -> String {
    let (offered, requested) = if side == Side::Publisher { (ours, theirs) } else { (theirs, ours) };
    let reliability =
        offered.reliability == Reliability::BestEffort && matches!(requested.reliability, Reliability::Reliable { .. });
    let durability = offered.durability == Durability::Volatile && requested.durability == Durability::TransientLocal;
    let (policy, value) = match (side, reliability, durability) {
        (Side::Publisher, true, _) => ("reliability", "reliable"),
        (Side::Subscription, true, _) => ("reliability", "best_effort"),
        (Side::Publisher, _, true) => ("durability", "transient_local"),
        (Side::Subscription, _, true) => ("durability", "volatile"),
        _ => ("deadline", "0"),
    };
    let peer = if side == Side::Publisher { "subscription" } else { "publisher" };
    format!(
        "`{topic}`: the QoS of a {peer} ({}) does not fit this node's {} ({}): nothing will arrive. \
         Remedy: start this node with --ros-args -p qos_overrides.{topic}.{}.{policy}:={value}, or change the {peer}",
        qos::describe(theirs),
        side.word(),
        qos::describe(ours),
        side.word(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_called_as_ros_calls_them() {
        assert_eq!(ros_type("std_msgs::msg::dds_::String_"), "std_msgs/msg/String");
        assert_eq!(ros_type("Module::Type"), "Module::Type");
    }

    #[test]
    fn the_warning_holds_the_remedy() {
        let text = qos_remedy(Side::Subscription, "/measured_js", &qos::reliable(5), &qos::sensor(5));
        assert!(text.contains("-p qos_overrides./measured_js.subscription.reliability:=best_effort"), "{text}");
        let text = qos_remedy(Side::Publisher, "/tissue_model", &qos::reliable(1), &qos::latched());
        assert!(text.contains("-p qos_overrides./tissue_model.publisher.durability:=transient_local"), "{text}");
    }
}
