//! One participant, one node, and everything that it creates, before any thread starts.
//!
//! Endpoints are made here and nowhere else: RustDDS has deadlocked when endpoints were created while another thread
//! asked discovery. Names come in as the program calls them and leave expanded and remapped; QoS comes in as the
//! program wants it and leaves with the user's overrides.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize};

use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::{
    Client, Context, Message, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile,
    ServiceMapping, ServiceTypeName,
};

use super::arguments::ParameterOverride;
pub use super::endpoint::{Input, Output, Wish};
use super::environment::{Environment, Reach};
use super::graph::{EndpointRecord, Graph};
use super::messages::RosMessage;
use super::names::{self, Endpoint, NameError, Names};
use super::parameters::Parameters;
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
        Ok(Self {
            node,
            context,
            names,
            mapping: Mapping::OfCaller(environment.mapping),
            overrides,
            records: Vec::new(),
            recorder: None,
        })
    }

    /// Records what the endpoints that are made from now on hear and say.
    pub(super) fn set_recorder(&mut self, recorder: Option<Recorder>) {
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
        Ok(Input {
            subscription,
            matched,
            topic,
            type_name: M::TYPE,
            qos: qos::describe(&profile),
            tap,
            unreadable: Default::default(),
        })
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
        // Volatile as rclcpp's, unlike the crate's own: RustDDS would send a late joiner all old events.
        self.node
            .create_publisher(&topic, Some(qos::reliable(1000)))
            .map_err(|e| middleware("/parameter_events")(e.to_string()))
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

    /// As [`Participant::graph`]; the QoS of every endpoint shows as read-only parameters, as rclcpp has it.
    pub(super) fn declared_graph(&mut self, parameters: &Parameters) -> Graph {
        parameters.declare_more(self.records.iter().flat_map(EndpointRecord::declarations).collect());
        self.graph()
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
