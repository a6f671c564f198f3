//! Common start of the nodes: arguments, environment, names, log.

use std::ffi::OsString;
use std::sync::Arc;

use ros2_client::ServiceMapping;

use super::arguments::{self, ParameterOverride, RosArguments};
use super::environment::{Environment, Reach};
use super::error::ParticipantError;
pub use super::error::{FAILURE, LOSSES, NodeError, SUCCESS, USAGE};
use super::logging;
use super::names::Names;
use super::parameter::{Parameter, Typed, parameters};
use super::parameters::{Declaration, Parameters};
use super::participant::Participant;
use super::recorder::Recording;
use super::rosout::Rosout;
use super::service::Mapping;
use ros2_client::ParameterValue;
use ros2_guarded::signals::Signals;

/// State of a node before it joins the network.
pub struct Start {
    /// The program's own arguments.
    pub own: Vec<String>,
    /// The ROS arguments.
    pub ros: RosArguments,
    /// Domain, range and service mapping.
    pub environment: Environment,
    /// Name, namespace and remapping.
    pub names: Names,
    /// Lines for `/rosout`.
    pub rosout: Rosout,
}

/// Reads command line and environment, and starts the log.
///
/// # Errors
/// [`NodeError`] naming the cause.
fn start(
    default_name: &str,
    program: &'static str,
    arguments: impl IntoIterator<Item = OsString>,
) -> Result<Start, NodeError> {
    let (own, ros) = arguments::split(arguments)?;
    let environment = Environment::read()?;
    let names = Names::new(default_name, &ros.remaps)?;
    let node = names.fully_qualified();
    let rosout = Rosout::new(
        logging::install(&node, program, &ros.log, environment.log_folder.as_deref()),
        logging::logger_name(&node),
    );
    for warning in &environment.warnings {
        tracing::warn!("{warning}");
    }
    for ignored in &ros.ignored {
        tracing::warn!("`{ignored}` has no effect here: leave it out");
    }
    Ok(Start { own, ros, environment, names, rosout })
}

impl Start {
    /// The node itself, with its log on the network unless `--disable-rosout-logs` was given.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn participant(&mut self, parameters: &Parameters) -> Result<Participant, ParticipantError> {
        let mut participant = Participant::new(self.names.clone(), &self.environment, &self.ros)?;
        if self.ros.log.rosout.unwrap_or(true) {
            self.rosout.offer(&mut participant)?;
        }
        participant.set_mapping(mapping(parameters, &self.environment));
        Ok(participant)
    }

    /// Gives a parameter of every node a value that an argument of the program itself has.
    pub fn set(&mut self, parameter: Parameter<String>, value: String, origin: &str) {
        self.ros.parameters.push(ParameterOverride {
            node_pattern: "/**".to_owned(),
            name: parameter.name().to_owned(),
            value: ParameterValue::String(value),
            origin: origin.to_owned(),
        });
    }

    /// The parameters with the values that they were given; logs what is wrong with those and does not keep the node from starting.
    ///
    /// # Errors
    /// [`ParameterError`](super::parameters::ParameterError).
    pub fn declare(&self, declarations: Vec<Declaration>) -> Result<Arc<Parameters>, NodeError> {
        let node = self.names.fully_qualified();
        let (parameters, warnings) = Parameters::declare(declarations, &self.ros.parameters, &node)?;
        for warning in warnings {
            tracing::warn!("{warning}");
        }
        Ok(Arc::new(parameters))
    }

    /// Joins the network with the endpoints that were asked for, and begins to record if that is asked for.
    ///
    /// # Errors
    /// [`NodeError`] naming what can't be created, and why.
    pub fn join(
        &self,
        participant: &mut Participant,
        parameters: &Arc<Parameters>,
    ) -> Result<Option<Recording>, NodeError> {
        for unused in participant.unused_qos_overrides() {
            tracing::warn!("`{unused}` names no topic of this node: `ros2 node info` lists them");
        }
        participant.start(Some(parameters))?;
        self.announce(mapping(parameters, &self.environment));
        participant.start_recording()
    }

    /// Logs once who can reach the node: everyone within its range can do everything that a peer can do.
    fn announce(&self, mapping: Mapping) {
        let reach = match self.environment.reach {
            _ if self.environment.zenoh.is_some() => {
                "this machine over Zenoh, and by whoever its Zenoh router lets in: they can read, send poses, change parameters and stop the node"
            }
            Reach::Localhost => "this machine only (ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET opens the network)",
            Reach::Subnet => {
                "every network of this machine: whoever is on them can read, send poses, change parameters and stop the \
                 node, since DDS has no passwords here (ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST closes it)"
            }
        };
        tracing::info!(
            "{} on domain {}, heard by {reach}, services as {}",
            self.names.fully_qualified(),
            self.environment.domain,
            mapping.describe(),
        );
    }
}

/// Runs a node's program, says on stderr why it fails, and returns its exit code. Call it before any thread is started: threads inherit
/// the mask of its signals. `arguments` does not include the program's name.
pub fn run(
    program: &str,
    [node, target]: [&'static str; 2],
    arguments: impl IntoIterator<Item = OsString>,
    node_of: impl FnOnce(Start, &Signals) -> Result<u8, NodeError>,
) -> u8 {
    let signals = match Signals::block() {
        Ok(signals) => signals,
        Err(error) => {
            eprintln!("{program}: signals can't be blocked: {error}");
            return FAILURE;
        }
    };
    start(node, target, arguments).and_then(|start| node_of(start, &signals)).unwrap_or_else(|error| {
        eprintln!("{program}: {}", terminal::line(&error.to_string()));
        error.exit_code()
    })
}

parameters! {
    /// What every node declares, but for what belongs to the network.
    own_declarations:

    /// Which clock.
    USE_SIM_TIME: bool = Parameter::new("use_sim_time", false, "Take the time from /clock instead of the wall clock.");
    /// Whether levels of loggers can be read and set.
    LOGGER_SERVICE: bool = Parameter::new(
        "logger_service",
        false,
        "Offer ~/get_logger_levels and ~/set_logger_levels, as nodes of rclcpp with enable_logger_service do.",
    )
    .fixed();
    /// Which services.
    SERVICE_MAPPING: String = Parameter::new(
        "service_mapping",
        "auto",
        "How services are mapped to DDS: auto answers each caller in its own manner, enhanced is rmw_fastrtps_cpp's for all, \
         cyclone rmw_cyclonedds_cpp's.",
    )
    .checked("one of auto, enhanced, cyclone", |value| match value {
        ParameterValue::String(v) if ["auto", "enhanced", "cyclone"].contains(&v.as_str()) => Ok(()),
        _ => Err("is one of auto, enhanced, cyclone".to_owned()),
    })
    .fixed();
}

/// Parameters that every node has.
#[must_use]
pub fn common_declarations() -> Vec<Declaration> {
    let mut all = own_declarations();
    all.extend(super::participant::declarations());
    all
}

/// The mapping that the parameter requests.
fn mapping(parameters: &Parameters, environment: &Environment) -> Mapping {
    match parameters.get(SERVICE_MAPPING).as_str() {
        _ if environment.zenoh.is_some() => Mapping::Zenoh,
        "enhanced" => Mapping::Fixed(ServiceMapping::Enhanced),
        "cyclone" => Mapping::Fixed(ServiceMapping::Cyclone),
        _ => Mapping::OfCaller(environment.mapping),
    }
}

/// The last value of its type that the command line gives for a parameter of this node.
#[must_use]
pub fn last_override<T: Typed>(overrides: &[ParameterOverride], node: &str, parameter: Parameter<T>) -> Option<T> {
    let of_node =
        |o: &&ParameterOverride| o.name == parameter.name() && super::names::pattern_matches(&o.node_pattern, node);
    overrides.iter().rfind(of_node).and_then(|o| T::of(&o.value))
}
