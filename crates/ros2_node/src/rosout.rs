//! `/rosout`: the node's log on the network.

use crossbeam_channel::Receiver;
use ros2_client::builtin_interfaces::Time;
use ros2_client::log::Log;

use super::logging::Record;
use super::participant::{Output, Participant, ParticipantError};

/// The lines to be published, and the logger's name.
pub struct Rosout {
    lines: Receiver<Record>,
    logger: String,
    output: Option<Output<Log>>,
}

impl Rosout {
    /// `logger` is the node's name with dots, `or1.twin`.
    #[must_use]
    pub(crate) const fn new(lines: Receiver<Record>, logger: String) -> Self {
        Self { lines, logger, output: None }
    }

    /// Creates the publisher.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub(crate) fn offer(&mut self, participant: &mut Participant) -> Result<(), ParticipantError> {
        self.output = Some(participant.rosout()?);
        Ok(())
    }

    /// Publishes the queued lines.
    pub fn publish(&self) {
        let Some(output) = &self.output else { return };
        while let Ok(record) = self.lines.try_recv() {
            output.send(Log {
                stamp: Time::from_nanos(record.wall_nanos),
                level: record.severity as u8,
                name: self.logger.clone(),
                msg: record.message,
                file: record.file.to_owned(),
                function: String::new(),
                line: record.line,
            });
        }
    }
}
