//! `/rosout`: the node's log on the network.

use crossbeam_channel::Receiver;
use ros2_client::rosout::RosoutRaw;
use ros2_client::{NodeLoggingHandle, builtin_interfaces::Time, ros2::LogLevel};

use super::logging::{Record, Severity};

/// Publishes the lines that have come.
pub fn publish(logger: &NodeLoggingHandle, lines: &Receiver<Record>) {
    while let Ok(record) = lines.try_recv() {
        let level = match record.severity {
            Severity::Debug => LogLevel::Debug,
            Severity::Info => LogLevel::Info,
            Severity::Warn => LogLevel::Warn,
            Severity::Error => LogLevel::Error,
            Severity::Fatal => LogLevel::Fatal,
        };
        let stamp = Time::from_nanos(record.wall_nanos);
        logger.rosout_raw(stamp, level, logger.base_name(), &record.message, record.file, "", record.line);
    }
}
