//! `~/get_logger_levels` and `~/set_logger_levels`, as in rclcpp nodes with `enable_logger_service`.

use ros2_messages::logger_levels::{
    GetLoggerLevelsRequest, LoggerLevel, LoggerLevels, SetLoggerLevelsResponse, SetLoggerLevelsResult,
};

use super::logging::{self, Severity};
use super::parameters::Parameters;
use super::participant::{Participant, ParticipantError};
use super::service::Service;
use super::start::LOGGER_SERVICE;

/// The servers. Call [`LoggerServices::poll`] several times per second.
pub struct LoggerServices {
    get: Service<GetLoggerLevelsRequest, LoggerLevels>,
    set: Service<LoggerLevels, SetLoggerLevelsResponse>,
}

impl LoggerServices {
    /// Creates both servers for a node whose parameters enable them.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn offer(participant: &mut Participant, parameters: &Parameters) -> Result<Option<Self>, ParticipantError> {
        if !parameters.get(LOGGER_SERVICE) {
            return Ok(None);
        }
        Ok(Some(Self {
            get: participant.server("~/get_logger_levels", "rcl_interfaces", "GetLoggerLevels")?,
            set: participant.server("~/set_logger_levels", "rcl_interfaces", "SetLoggerLevels")?,
        }))
    }

    /// Answers the pending requests.
    pub fn poll(&self) {
        self.get.answer(|q| LoggerLevels { levels: q.names.into_iter().map(known).collect() });
        self.set.answer(|q| SetLoggerLevelsResponse { results: q.levels.iter().map(set).collect() });
    }
}

/// The level that was set, 0 if none was.
fn known(name: String) -> LoggerLevel {
    LoggerLevel { level: logging::level(&name).map_or(0, |level| level as u32), name }
}

fn set(wanted: &LoggerLevel) -> SetLoggerLevelsResult {
    let all = [Severity::Debug, Severity::Info, Severity::Warn, Severity::Error, Severity::Fatal];
    let Some(level) = all.into_iter().find(|level| *level as u32 == wanted.level) else {
        let reason = format!("level {} is none: 10 debug, 20 info, 30 warn, 40 error, 50 fatal", wanted.level);
        return SetLoggerLevelsResult { successful: false, reason };
    };
    logging::set_level(&wanted.name, level);
    SetLoggerLevelsResult { successful: true, reason: String::new() }
}
