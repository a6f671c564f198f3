//! One participant, one node, and everything that it creates, before any thread starts.
//!
//! Endpoints are made here and nowhere else: RustDDS has deadlocked when endpoints were created while another thread
//! asked discovery. Names come in as the program calls them and leave expanded and remapped; QoS comes in as the
//! program wants it and leaves with the user's overrides.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::{
    Client, Context, Message, MessageInfo, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile,
    ServiceMapping, ServiceTypeName, Subscription, WriteError,
};

use super::arguments::ParameterOverride;
use super::environment::{Environment, Reach};
use super::graph::{EndpointRecord, Graph};
use super::messages::RosMessage;
use super::names::{self, Endpoint, NameError, Names};
use super::qos::{self, Side};
use super::recorder::{Recorder, Recording, Tap};
use super::service::{Mapping, Service};
use super::start::NodeError;
use crate::bag::{self, Schema};

/// Why a node can't be put on the network.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ParticipantError {
    /// The middleware refused.
    #[error("{what}: {reason}")]
    Middleware {
        /// What was to be made.
        what: String,
        /// What it said.
        reason: String,
    },
    /// A name is not one.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A QoS override can't be used.
    #[error("{origin}: parameter `{name}`: {reason}")]
    Qos {
        /// Where it was said.
        origin: String,
        /// Name of the override.
        name: String,
        /// What would be right.
        reason: String,
    },
}

fn middleware(what: impl Into<String>) -> impl FnOnce(String) -> ParticipantError {
    let what = what.into();
    move |reason| ParticipantError::Middleware { what, reason }
}

/// A node on the network.
pub struct Participant {
    // Declared in the order in which a clean leave drops them.
    node: Node,
    context: Context,
    names: Names,
    mapping: Mapping,
    overrides: Vec<(ParameterOverride, bool)>,
    records: Vec<EndpointRecord>,
    recorder: Option<Recorder>,
}

impl Participant {
    /// Joins the domain and announces the node. `overrides` are the command line's; only those of QoS are looked at.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn join(
        names: Names,
        environment: &Environment,
        overrides: &[ParameterOverride],
        rosout: bool,
    ) -> Result<Self, ParticipantError> {
        let mut builder = DomainParticipantBuilder::new(environment.domain);
        if environment.reach == Reach::Localhost {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let what = format!("joining domain {}", environment.domain);
        let participant = builder.build().map_err(|e| middleware(&*what)(e.to_string()))?;
        let context = Context::from_domain_participant(participant).map_err(|e| middleware(&*what)(e.to_string()))?;
        let node_name = NodeName::new(names.namespace(), names.node())
            .map_err(|e| middleware(names.fully_qualified())(e.to_string()))?;
        // Parameter services are our own: the crate's speak only one mapping and know no descriptors. Its spinner is
        // not used either: it would subscribe /clock under a wrong type, which makes `ros2 topic echo /clock` refuse.
        let options = NodeOptions::new().enable_rosout(rosout).start_parameter_services(false);
        let node =
            context.new_node(node_name, options).map_err(|e| middleware(names.fully_qualified())(e.to_string()))?;
        let fully_qualified = names.fully_qualified();
        let overrides = overrides
            .iter()
            .filter(|o| names::pattern_matches(&o.node_pattern, &fully_qualified))
            .filter(|o| qos::parse_override_name(&o.name).is_some())
            .map(|o| (o.clone(), false))
            .collect();
        Ok(Self { node, context, names, mapping: Mapping::OfCaller(environment.mapping), overrides, records: Vec::new(), recorder: None })
    }

    /// Records what the endpoints that are made from now on hear and say.
    pub(super) fn record(&mut self, recorder: Option<Recorder>) {
        self.recorder = recorder;
    }

    /// Starts the recording, if there is one; after all endpoints are made.
    ///
    /// # Errors
    /// [`NodeError`] if it can't be started.
    pub(super) fn start_recording(&mut self) -> Result<Option<Recording>, NodeError> {
        self.recorder.take().map(Recorder::start).transpose()
    }

    /// Names and remapping of the node.
    #[must_use]
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// The node's handle of the middleware.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// Changes how services are mapped to DDS; before the first service is made.
    pub fn set_mapping(&mut self, mapping: Mapping) {
        self.mapping = mapping;
    }

    /// Makes a publisher of `name` (as the program calls it).
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn publisher<M: RosMessage>(&mut self, name: &str, profile: QosProfile) -> Result<Output<M>, ParticipantError> {
        self.publisher_of(name, MessageTypeName::new(M::PACKAGE, M::NAME), bag::schema(M::TYPE).as_ref(), profile)
    }

    /// Makes a publisher with a type name that is known only at run time; without a schema it is not recorded.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn publisher_of<M: serde::Serialize>(
        &mut self,
        name: &str,
        type_name: MessageTypeName,
        schema: Option<&Schema>,
        profile: QosProfile,
    ) -> Result<Output<M>, ParticipantError> {
        let (topic, profile) = self.resolve(name, Side::Publisher, profile)?;
        let handle = self.topic(&topic, &type_name, &profile)?;
        let publisher =
            self.node.create_publisher::<M>(&handle, None).map_err(|e| middleware(&*topic)(e.to_string()))?;
        let matched = self.record(Side::Publisher, publisher.guid(), &topic, &type_name, &profile);
        let tap = self.tap(name, &topic, schema, &profile)?;
        Ok(Output { publisher, matched, topic, failed: AtomicU64::new(0), tap })
    }

    /// Makes a subscription to `name` (as the program calls it).
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn subscription<M: RosMessage + 'static>(
        &mut self,
        name: &str,
        profile: QosProfile,
    ) -> Result<Input<M>, ParticipantError> {
        let (topic, profile) = self.resolve(name, Side::Subscription, profile)?;
        let type_name = MessageTypeName::new(M::PACKAGE, M::NAME);
        let handle = self.topic(&topic, &type_name, &profile)?;
        let subscription =
            self.node.create_subscription::<M>(&handle, None).map_err(|e| middleware(&*topic)(e.to_string()))?;
        let matched = self.record(Side::Subscription, subscription.guid(), &topic, &type_name, &profile);
        let tap = self.tap(name, &topic, bag::schema(M::TYPE).as_ref(), &profile)?;
        Ok(Input { subscription, matched, topic, type_name: M::TYPE, qos: qos::describe(&profile), tap })
    }

    fn tap(
        &mut self,
        name: &str,
        topic: &str,
        schema: Option<&Schema>,
        profile: &QosProfile,
    ) -> Result<Option<Tap>, ParticipantError> {
        let Some(recorder) = &mut self.recorder else { return Ok(None) };
        recorder.tap(name, topic, schema, profile).map_err(|e| middleware(topic)(e.to_string()))
    }

    /// Makes a service server of `name` (as the program calls it).
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn server<Request, Response>(
        &mut self,
        name: &str,
        package: &str,
        type_name: &str,
    ) -> Result<Service<Request, Response>, ParticipantError>
    where
        Request: Message + serde::de::DeserializeOwned,
        Response: Message + serde::Serialize,
    {
        let service = self.names.resolve(name, Endpoint::Service)?;
        let dds_name = Name::parse(&service).map_err(|e| middleware(&*service)(e.to_string()))?;
        let type_name = ServiceTypeName::new(package, type_name);
        let server = self
            .node
            .create_server(ServiceMapping::Enhanced, &dds_name, &type_name, qos::service(), qos::service())
            .map_err(|e| middleware(&*service)(e.to_string()))?;
        Ok(Service::new(server, self.mapping, service))
    }

    /// Makes a service client of `name` (as the program calls it).
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn client<Request, Response>(
        &mut self,
        name: &str,
        package: &str,
        type_name: &str,
    ) -> Result<Client<Request, Response>, ParticipantError>
    where
        Request: Message + Clone + 'static,
        Response: Message + 'static,
    {
        let service = self.names.resolve(name, Endpoint::Service)?;
        let dds_name = Name::parse(&service).map_err(|e| middleware(&*service)(e.to_string()))?;
        let type_name = ServiceTypeName::new(package, type_name);
        let (Mapping::OfCaller(mapping) | Mapping::Fixed(mapping)) = self.mapping;
        self.node
            .create_client(mapping, &dds_name, &type_name, qos::service(), qos::service())
            .map_err(|e| middleware(service)(e.to_string()))
    }

    /// The publisher of `/parameter_events`.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub(super) fn parameter_events(
        &mut self,
    ) -> Result<Publisher<ros2_client::parameters::raw::ParameterEvent>, ParticipantError> {
        let topic = self.context.get_parameter_events_topic();
        self.node.create_publisher(&topic, None).map_err(|e| middleware("/parameter_events")(e.to_string()))
    }

    fn resolve(
        &mut self,
        name: &str,
        side: Side,
        mut profile: QosProfile,
    ) -> Result<(String, QosProfile), ParticipantError> {
        let topic = self.names.resolve(name, Endpoint::Topic)?;
        for (given, used) in &mut self.overrides {
            let Some((of_topic, of_side, policy)) = qos::parse_override_name(&given.name) else { continue };
            if of_topic == topic && of_side == side {
                *used = true;
                qos::apply(&mut profile, policy, &given.value).map_err(|reason| ParticipantError::Qos {
                    origin: given.origin.clone(),
                    name: given.name.clone(),
                    reason,
                })?;
            }
        }
        Ok((topic, profile))
    }

    fn topic(
        &self,
        topic: &str,
        type_name: &MessageTypeName,
        profile: &QosProfile,
    ) -> Result<ros2_client::dds::rustdds::Topic, ParticipantError> {
        let name = Name::parse(topic).map_err(|e| middleware(topic)(e.to_string()))?;
        self.node.create_topic(&name, type_name.clone(), profile).map_err(|e| middleware(topic)(e.to_string()))
    }

    fn record(
        &mut self,
        side: Side,
        guid: ros2_client::dds::rustdds::GUID,
        topic: &str,
        type_name: &MessageTypeName,
        profile: &QosProfile,
    ) -> Arc<AtomicUsize> {
        let matched = Arc::new(AtomicUsize::new(0));
        self.records.push(EndpointRecord::new(
            side,
            guid,
            topic,
            &type_name.dds_msg_type(),
            profile.clone(),
            Arc::clone(&matched),
        ));
        matched
    }

    /// Overrides of QoS that name no endpoint of this node.
    pub fn unused_qos_overrides(&self) -> impl Iterator<Item = &str> {
        self.overrides.iter().filter(|(_, used)| !used).map(|(o, _)| o.name.as_str())
    }

    /// Hands out the watcher of who is matched with whom; once, after all endpoints are made.
    #[must_use]
    pub fn graph(&mut self) -> Graph {
        Graph::new(&self.context.domain_participant(), std::mem::take(&mut self.records))
    }
}

/// A publisher that knows how many subscriptions it has.
pub struct Output<M: serde::Serialize> {
    publisher: Publisher<M>,
    matched: Arc<AtomicUsize>,
    topic: String,
    failed: AtomicU64,
    tap: Option<Tap>,
}

impl<M: serde::Serialize> Output<M> {
    /// Whether anyone listens; the node's own recording does.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        self.tap.is_some() || self.subscribers() > 0
    }

    /// How many listen.
    #[must_use]
    pub fn subscribers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Fully qualified name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Messages that the middleware did not take, because a reliable reader is behind.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.failed.load(Ordering::Relaxed)
    }

    /// Publishes; never waits for a reader. False if the middleware did not take it (counted).
    pub fn send(&self, message: M) -> bool {
        if let Some(tap) = &self.tap {
            tap.said(&message);
        }
        match self.publisher.publish(message) {
            Ok(()) => true,
            Err(error) => {
                let before = self.failed.fetch_add(1, Ordering::Relaxed);
                // WouldBlock is a slow reader, which the status counts; anything else is said the first time.
                if !matches!(error, WriteError::WouldBlock { .. }) && before == 0 {
                    tracing::error!("`{}` could not be published: {}", self.topic, kind(&error));
                }
                false
            }
        }
    }
}

fn kind<M>(error: &WriteError<M>) -> &'static str {
    match error {
        WriteError::Serialization { .. } => "it can't be written as CDR",
        WriteError::WouldBlock { .. } => "a reader is behind",
        WriteError::Io(_) => "the socket failed",
        _ => "the middleware failed",
    }
}

/// A subscription that knows how many publishers it has.
pub struct Input<M> {
    subscription: Subscription<M>,
    matched: Arc<AtomicUsize>,
    topic: String,
    type_name: &'static str,
    qos: String,
    tap: Option<Tap>,
}

impl<M: RosMessage + 'static> Input<M> {
    /// The subscription.
    #[must_use]
    pub fn subscription(&self) -> &Subscription<M> {
        &self.subscription
    }

    /// What it listens to and what it has found, for people.
    #[must_use]
    pub fn wish(&self) -> Wish {
        Wish {
            topic: self.topic.clone(),
            type_name: self.type_name,
            qos: self.qos.clone(),
            matched: Arc::clone(&self.matched),
        }
    }

    /// Fully qualified name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Next message that has arrived. One that can't be decoded is reported and skipped.
    pub fn take(&self) -> Option<M> {
        self.take_timed().map(|(message, _)| message)
    }

    /// Next message that has arrived, with the wall times at which it was received and sent, ns since 1970.
    pub fn take_timed(&self) -> Option<(M, [i64; 2])> {
        loop {
            match self.subscription.take() {
                Ok(next) => {
                    return next.map(|(message, info)| {
                        let times = self.note(&message, &info);
                        (message, times)
                    });
                }
                Err(error) => tracing::warn!("`{}`: a message can't be read: {error}", self.topic),
            }
        }
    }

    /// When a message was received and sent, ns since 1970; the recording gets it.
    fn note(&self, message: &M, info: &MessageInfo) -> [i64; 2] {
        let received = info.received_timestamp().map_or_else(super::clock::wall_nanos, |t| t.to_nanos());
        let sent = info.source_timestamp().map_or(received, |t| t.to_nanos());
        if let Some(tap) = &self.tap {
            tap.heard(message, [received, sent]);
        }
        [received, sent]
    }

    /// How many publish.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Waits for the next message. One that can't be decoded is reported and skipped.
    pub async fn next(&self) -> M {
        loop {
            match self.subscription.async_take().await {
                Ok((message, info)) => {
                    self.note(&message, &info);
                    return message;
                }
                Err(error) => tracing::warn!("`{}`: a message can't be read: {error}", self.topic),
            }
        }
    }
}

/// What an input listens to.
#[derive(Clone, Debug)]
pub struct Wish {
    /// Fully qualified name.
    pub topic: String,
    /// `sensor_msgs/msg/JointState`.
    pub type_name: &'static str,
    /// QoS in words.
    pub qos: String,
    matched: Arc<AtomicUsize>,
}

impl Wish {
    /// Publishers that are matched.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }
}
