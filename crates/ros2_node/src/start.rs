//! Common start of the nodes: arguments, environment, names, log.

use std::ffi::OsString;

use ros2_client::ServiceMapping;

use super::arguments::{self, ArgumentError, ParameterOverride, RosArguments};
use super::environment::{Environment, EnvironmentError, Reach};
use super::logging::{self, Severity};
use super::names::{NameError, Names};
use super::parameter::{Parameter, Typed, parameters};
use super::parameters::{Declaration, ParameterError, Parameters};
use super::participant::{Participant, ParticipantError};
use super::rosout::Rosout;
use super::service::Mapping;
use ros2_client::ParameterValue;

/// Exit code of a success.
pub const SUCCESS: u8 = 0;
/// Exit code of a failure.
pub const FAILURE: u8 = 1;
/// Exit code of a wrong command line or environment.
pub const USAGE: u8 = 2;
/// Exit code of a run that completed, but lost data or diverged.
pub const LOSSES: u8 = 3;

/// Why a node can't start or continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// Invalid command line.
    #[error(transparent)]
    Argument(#[from] ArgumentError),
    /// Invalid environment.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// Invalid name.
    #[error(transparent)]
    Name(#[from] NameError),
    /// Invalid parameter.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// Error of the network.
    #[error(transparent)]
    Participant(#[from] ParticipantError),
    /// Error of the middleware process.
    #[error(transparent)]
    Guard(#[from] ros2_guarded::GuardError),
    /// No thread could be started.
    #[error(transparent)]
    Thread(#[from] named_threads::ThreadError),
    /// Error of the program itself.
    #[error(transparent)]
    Program(Box<dyn std::error::Error + Send + Sync>),
    /// Any other error; the text is complete.
    #[error("{0}")]
    Other(String),
    /// Usage error; the text is complete.
    #[error("{0}")]
    Usage(String),
}

impl NodeError {
    /// An error of the program itself.
    pub fn program(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Program(Box::new(error))
    }

    /// Exit code of the program.
    #[must_use]
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Argument(_) | Self::Environment(_) | Self::Name(_) | Self::Parameter(_) | Self::Usage(_) => USAGE,
            Self::Participant(ParticipantError::Name(_) | ParticipantError::Qos { .. }) => USAGE,
            Self::Participant(_) | Self::Guard(_) | Self::Thread(_) | Self::Program(_) | Self::Other(_) => FAILURE,
        }
    }
}

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
pub fn start(
    default_name: &str,
    program: &'static str,
    arguments: impl IntoIterator<Item = OsString>,
) -> Result<Start, NodeError> {
    let (own, ros) = arguments::split(arguments)?;
    let environment = Environment::read()?;
    let names = Names::new(default_name, &ros)?;
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
    pub fn participant(&mut self) -> Result<Participant, ParticipantError> {
        let mut participant = Participant::new(self.names.clone(), &self.environment, &self.ros)?;
        if self.ros.log.rosout.unwrap_or(true) {
            self.rosout.offer(&mut participant)?;
        }
        Ok(participant)
    }

    /// Logs once who can reach the node: everyone within its range can do everything that a peer can do.
    pub fn announce(&self, mapping: Mapping) {
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
#[must_use]
pub fn mapping(parameters: &Parameters, environment: &Environment) -> Mapping {
    match parameters.get(SERVICE_MAPPING).as_str() {
        _ if environment.zenoh.is_some() => Mapping::Zenoh,
        "enhanced" => Mapping::Fixed(ServiceMapping::Enhanced),
        "cyclone" => Mapping::Fixed(ServiceMapping::Cyclone),
        _ => Mapping::OfCaller(environment.mapping),
    }
}

/// Level up to which lines of the middleware are shown, from 1 (error) to 5 (trace).
pub(crate) fn verbosity(arguments: &RosArguments) -> u8 {
    match arguments.log.loggers.iter().map(|(_, level)| *level).min() {
        Some(Severity::Debug) => 4,
        Some(Severity::Info) => 3,
        Some(Severity::Warn) => 2,
        _ => 1,
    }
}

/// The last value of its type that the command line gives for a parameter of this node.
#[must_use]
pub fn last_override<T: Typed>(overrides: &[ParameterOverride], node: &str, parameter: Parameter<T>) -> Option<T> {
    let of_node =
        |o: &&ParameterOverride| o.name == parameter.name() && super::names::pattern_matches(&o.node_pattern, node);
    overrides.iter().rfind(of_node).and_then(|o| T::of(&o.value))
}
