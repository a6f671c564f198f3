//! Why a node does not run, and the exit code that says it.

use super::arguments::ArgumentError;
use super::environment::EnvironmentError;
use super::names::NameError;
use super::parameters::ParameterError;

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

/// Why a node can't join the network.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ParticipantError {
    /// The middleware reported an error.
    #[error("{what}: {reason}")]
    Middleware {
        /// What was to be created.
        what: String,
        /// The error of the middleware.
        reason: String,
    },
    /// An invalid name.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A QoS override is not valid.
    #[error("{origin}: parameter `{name}`: {reason}")]
    Qos {
        /// Source of the override.
        origin: String,
        /// Name of the override.
        name: String,
        /// What would be valid.
        reason: String,
    },
}
