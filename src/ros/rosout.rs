//! `/rosout`: the node's log on the network.

use crossbeam_channel::Receiver;
use ros2_client::rosout::RosoutRaw;
use ros2_client::{NodeLoggingHandle, builtin_interfaces::Time, ros2::LogLevel};

use super::logging::{Record, Severity};

/// The lines that wait to be published, and the name of who says them.
#[derive(Debug)]
pub struct Rosout {
    lines: Receiver<Record>,
    logger: String,
}

impl Rosout {
    /// `logger` is the node's name with dots, `or1.twin`.
    #[must_use]
    pub const fn new(lines: Receiver<Record>, logger: String) -> Self {
        Self { lines, logger }
    }

    /// Publishes the lines that have come.
    pub fn publish(&self, handle: &NodeLoggingHandle) {
        while let Ok(record) = self.lines.try_recv() {
            let level = match record.severity {
                Severity::Debug => LogLevel::Debug,
                Severity::Info => LogLevel::Info,
                Severity::Warn => LogLevel::Warn,
                Severity::Error => LogLevel::Error,
                Severity::Fatal => LogLevel::Fatal,
            };
            let stamp = Time::from_nanos(record.wall_nanos);
            handle.rosout_raw(stamp, level, &self.logger, &record.message, record.file, "", record.line);
        }
    }
}
