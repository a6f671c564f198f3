//! A node's endpoints. They are requested here one after the other, and then created together by the middleware
//! process.
//!
//! Names are those of the program; they are expanded and remapped here. QoS is that of the program; the user's
//! overrides are applied here.

use std::marker::PhantomData;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::thread::JoinHandle;

use ros2_client::log::Log;
use ros2_client::parameters::raw::ParameterEvent;
use ros2_client::qos::{Durability, History};
use ros2_client::{MessageTypeName, QosProfile, ServiceMapping};

use super::arguments::{ParameterOverride, RosArguments};
pub use super::endpoint::{Converted, Input, Output, Wish};
use super::environment::{Environment, Reach};
use super::error::NodeError;
pub use super::error::ParticipantError;
use super::names::{self, Endpoint, Names};
use super::parameter::{Parameter, parameters};
use super::parameters::{Declaration, Parameters};
use super::qos::{self, Side};
use super::recorder::{Recorder, Recording, Tap};
use super::service::{Client, Mapping, Service};
use ros2_guarded::Bell;
use ros2_guarded::{Health, Inlets, Link, Mailbox, Middleware, Plan, Quality, Role};
use ros2_messages::RosMessage;
use ros2_messages::schema::{Schema, schema};
use ros2_messages::type_hash;

/// Queue length for a QoS that keeps all messages.
const KEEP_ALL: usize = 4096;

fn refuse(what: impl Into<String>) -> impl FnOnce(String) -> ParticipantError {
    let what = what.into();
    move |reason| ParticipantError::Middleware { what, reason }
}

parameters! {
    /// What every node on the network declares.
    declarations:

    /// What the middleware process may take.
    MIDDLEWARE_MEMORY_MIB: i64 = Parameter::integer(
        "middleware_memory_mib",
        512,
        [64, 65_536],
        "Memory that the middleware process may take, MiB; one that needs more is replaced.",
    )
    .fixed();
}

/// A node on the network.
pub struct Participant {
    names: Names,
    mapping: Mapping,
    overrides: Vec<(ParameterOverride, bool)>,
    plan: Plan,
    declarations: Vec<Declaration>,
    recorder: Option<Recorder>,
    inlets: Inlets,
    link: Arc<Link>,
    woken: Option<UnixStream>,
    program: Option<PathBuf>,
    middleware: Option<Middleware>,
}

impl Participant {
    /// A node for the domain of the environment. [`Participant::start`] joins it after all endpoints are requested.
    ///
    /// # Errors
    /// [`ParticipantError`] if the system has no sockets left.
    pub fn new(names: Names, environment: &Environment, arguments: &RosArguments) -> Result<Self, ParticipantError> {
        let fully_qualified = names.fully_qualified();
        let overrides = arguments
            .parameters
            .iter()
            .filter(|o| names::pattern_matches(&o.node_pattern, &fully_qualified))
            .filter(|o| qos::parse_override_name(&o.name).is_some())
            .map(|o| (o.clone(), false))
            .collect();
        let plan = Plan {
            domain: environment.domain,
            localhost: environment.reach == Reach::Localhost,
            namespace: names.namespace().to_owned(),
            node: names.node().to_owned(),
            memory_bytes: mebibytes(MIDDLEWARE_MEMORY_MIB.default()),
            verbosity: arguments.log.verbosity(),
            hears: false,
            predecessor: None,
            zenoh: environment.zenoh.clone(),
            endpoints: Vec::new(),
        };
        let (link, woken) = Link::new().map_err(|e| refuse(fully_qualified)(e.to_string()))?;
        Ok(Self {
            names,
            mapping: Mapping::of_environment(environment),
            overrides,
            plan,
            declarations: Vec::new(),
            recorder: None,
            inlets: Inlets::default(),
            link: Arc::new(link),
            woken: Some(woken),
            program: None,
            middleware: None,
        })
    }

    /// Records the messages of the endpoints that are requested from now on.
    pub fn set_recorder(&mut self, recorder: Option<Recorder>) {
        self.recorder = recorder;
    }

    /// Starts the recording, if there is one; call it after all endpoints are made.
    ///
    /// # Errors
    /// [`NodeError`] if it can't be started.
    pub(crate) fn start_recording(&mut self) -> Result<Option<Recording>, NodeError> {
        self.recorder.take().map(Recorder::start).transpose()
    }

    /// Uses another program than the present one as the middleware process; for programs that do not call
    /// [`ros2_guarded::serve`]. It must have the same version.
    pub fn set_program(&mut self, program: impl Into<PathBuf>) {
        self.program = Some(program.into());
    }

    /// Joins the domain and creates every endpoint; to be called once. With `parameters`, the QoS of every endpoint
    /// is shown as read-only parameters, as in rclcpp.
    ///
    /// # Errors
    /// [`NodeError`] naming what can't be created, and why.
    pub fn start(&mut self, parameters: Option<&Parameters>) -> Result<(), NodeError> {
        let Some(woken) = self.woken.take() else { return Ok(()) };
        let declarations = std::mem::take(&mut self.declarations);
        if let Some(parameters) = parameters {
            parameters.declare_more(declarations);
            self.plan.memory_bytes = mebibytes(parameters.get(MIDDLEWARE_MEMORY_MIB));
        }
        let inlets = std::mem::take(&mut self.inlets);
        let program = self.program.take();
        self.middleware = Some(Middleware::start(self.plan.clone(), program, inlets, Arc::clone(&self.link), woken)?);
        Ok(())
    }

    /// Health of the middleware, after the start of the node.
    pub fn health(&self) -> Arc<Health> {
        self.middleware.as_ref().map(|m| Arc::clone(m.health())).unwrap_or_default()
    }

    /// The thread that handles all messages, after the start of the node.
    pub fn thread(&self) -> Option<&JoinHandle<()>> {
        self.middleware.as_ref().and_then(Middleware::thread)
    }

    /// Rings when a service is called, and when a called service answers.
    pub fn bell(&self) -> Bell {
        self.link.bell.clone()
    }

    /// Names and remapping of the node.
    #[must_use]
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// Changes the mapping of services to DDS; to be called before the first service is made.
    pub fn set_mapping(&mut self, mapping: Mapping) {
        self.mapping = mapping;
    }

    /// Creates a publisher; `name` is the program's name for the topic.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn publisher<M: RosMessage>(&mut self, name: &str, profile: QosProfile) -> Result<Output<M>, ParticipantError> {
        self.publisher_of(name, &MessageTypeName::new(M::PACKAGE, M::NAME), schema(M::TYPE).as_ref(), profile)
    }

    /// Creates a publisher with a type name that is known only at run time; without a schema it is not recorded.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn publisher_of<M: serde::Serialize>(
        &mut self,
        name: &str,
        type_name: &MessageTypeName,
        schema: Option<&Schema>,
        profile: QosProfile,
    ) -> Result<Output<M>, ParticipantError> {
        let (topic, profile) = self.resolve(name, Side::Publisher, profile)?;
        let tap = self.tap(name, &topic, schema, &profile)?;
        self.declarations.extend(qos::declarations(&topic, Side::Publisher, &profile));
        let output = self.output(topic, type_name, &profile)?;
        // a bag may have its own types
        if let (Some(schema), Some(endpoint)) = (schema.filter(|s| !s.hash.is_empty()), self.plan.endpoints.last_mut())
        {
            endpoint.type_hash = Some(schema.hash.clone());
        }
        Ok(Output { tap, ..output })
    }

    fn output<M: serde::Serialize>(
        &mut self,
        topic: String,
        type_name: &MessageTypeName,
        profile: &QosProfile,
    ) -> Result<Output<M>, ParticipantError> {
        let (matched, failed, link) = (Arc::default(), Arc::default(), Arc::clone(&self.link));
        let endpoint = self.wish(Role::Publisher, &topic, type_name.package_name(), type_name.type_name(), profile)?;
        self.inlets.mute(&matched, &failed);
        let latched = profile.durability == Durability::TransientLocal;
        Ok(Output { link, endpoint, latched, matched, topic, failed, tap: None, messages: PhantomData })
    }

    /// Creates a subscription; `name` is the program's name for the topic.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn subscription<M: RosMessage + 'static>(
        &mut self,
        name: &str,
        profile: QosProfile,
    ) -> Result<Input<M>, ParticipantError> {
        let (topic, profile) = self.resolve(name, Side::Subscription, profile)?;
        let tap = self.tap(name, &topic, schema(M::TYPE).as_ref(), &profile)?;
        self.declarations.extend(qos::declarations(&topic, Side::Subscription, &profile));
        self.wish(Role::Subscription, &topic, M::PACKAGE, M::NAME, &profile)?;
        let (mailbox, matched) = self.mailbox(&profile);
        let (qos, unreadable) = (qos::describe(&profile), Default::default());
        Ok(Input { mailbox, matched, topic, type_name: M::TYPE, qos, tap, unreadable, messages: PhantomData })
    }

    fn mailbox(&mut self, profile: &QosProfile) -> (Mailbox, Arc<AtomicUsize>) {
        let matched = Arc::default();
        let depth = match profile.history {
            History::KeepLast { depth } => depth,
            History::KeepAll => KEEP_ALL,
        };
        (self.inlets.mailbox(depth, &matched), matched)
    }

    fn tap(
        &mut self,
        name: &str,
        topic: &str,
        schema: Option<&Schema>,
        profile: &QosProfile,
    ) -> Result<Option<Tap>, ParticipantError> {
        let Some(recorder) = &mut self.recorder else { return Ok(None) };
        recorder.tap(name, topic, schema, profile).map_err(|e| refuse(topic)(e.to_string()))
    }

    /// Creates a service server; `name` is the program's name for the service.
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
        Request: serde::de::DeserializeOwned,
        Response: serde::Serialize,
    {
        let service = self.names.resolve(name, Endpoint::Service)?;
        let endpoint = self.wish(Role::Server, &service, package, type_name, &qos::service())?;
        let (mailbox, _) = self.mailbox(&qos::service());
        Ok(Service::new(mailbox, Arc::clone(&self.link), endpoint, self.mapping, service, !self.plan.localhost))
    }

    /// Creates a service client; `name` is the program's name for the service.
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
        Request: serde::Serialize,
        Response: serde::de::DeserializeOwned,
    {
        let service = self.names.resolve(name, Endpoint::Service)?;
        let role = Role::Client { cyclone: self.mapping.own() == ServiceMapping::Cyclone };
        let endpoint = self.wish(role, &service, package, type_name, &qos::service())?;
        let (mailbox, _) = self.mailbox(&qos::service());
        Ok(Client::new(mailbox, Arc::clone(&self.link), endpoint))
    }

    /// The publisher of `/parameter_events`.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub(super) fn parameter_events(&mut self) -> Result<Output<ParameterEvent>, ParticipantError> {
        // Volatile as in rclcpp: RustDDS would send all old events to a late subscriber.
        let kind = MessageTypeName::new("rcl_interfaces", "ParameterEvent");
        self.output("/parameter_events".to_owned(), &kind, &qos::reliable(1000))
    }

    /// The publisher of `/rosout`.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub(super) fn rosout(&mut self) -> Result<Output<Log>, ParticipantError> {
        self.output("/rosout".to_owned(), &MessageTypeName::new("rcl_interfaces", "Log"), &qos::latched())
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

    /// Adds an endpoint to the list of requests; its number is that of its inlet.
    fn wish(
        &mut self,
        role: Role,
        name: &str,
        package: &str,
        type_name: &str,
        profile: &QosProfile,
    ) -> Result<u16, ParticipantError> {
        let kind = if matches!(role, Role::Publisher | Role::Subscription) { "msg" } else { "srv" };
        let number = u16::try_from(self.plan.endpoints.len())
            .map_err(|_| refuse(name)("a node has no more than 65536 endpoints".to_owned()))?;
        self.plan.endpoints.push(ros2_guarded::Endpoint {
            role,
            name: name.to_owned(),
            package: package.to_owned(),
            type_name: type_name.to_owned(),
            type_hash: type_hash(&format!("{package}/{kind}/{type_name}")),
            quality: Quality::from(profile),
        });
        Ok(number)
    }

    /// QoS overrides that name no endpoint of this node.
    pub(crate) fn unused_qos_overrides(&self) -> impl Iterator<Item = &str> {
        self.overrides.iter().filter(|(_, used)| !used).map(|(o, _)| o.name.as_str())
    }
}

fn mebibytes(count: i64) -> u64 {
    u64::try_from(count).unwrap_or(0) << 20
}
