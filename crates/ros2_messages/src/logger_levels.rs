//! Package `rcl_interfaces`: the services with which ROS 2 reads and sets the levels of a node's loggers.

use serde::{Deserialize, Serialize};

/// Level of one logger; `rcl_interfaces/msg/LoggerLevel`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoggerLevel {
    /// Name of the logger.
    pub name: String,
    /// 0 unset, 10 debug, 20 info, 30 warn, 40 error, 50 fatal.
    pub level: u32,
}

/// Request of `GetLoggerLevels`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetLoggerLevelsRequest {
    /// Names of loggers.
    pub names: Vec<String>,
}

/// Response of `GetLoggerLevels`, and request of `SetLoggerLevels`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoggerLevels {
    /// One per name.
    pub levels: Vec<LoggerLevel>,
}

/// Whether one level was set; `rcl_interfaces/msg/SetLoggerLevelsResult`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetLoggerLevelsResult {
    /// Whether it was.
    pub successful: bool,
    /// Why not.
    pub reason: String,
}

/// Response of `SetLoggerLevels`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetLoggerLevelsResponse {
    /// One per level.
    pub results: Vec<SetLoggerLevelsResult>,
}
