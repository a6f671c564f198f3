//! Detects other twins with the same names: other publishers of `status`.
//!
//! Readers of `predicted_cf` could not distinguish the forces of two twins. So neither marks its own forces as valid
//! while the other one publishes. A twin that starts later, or that was suspended and continues, is detected too.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::shared::Shared;
use ros2_messages::needle_twin::TwinStatus;
use ros2_node::participant::{Input, Participant, ParticipantError};
use ros2_node::qos;

/// A twin that has been silent for this time is gone; longer than two periods of the slowest sensible
/// `status_rate_hz`.
const GONE: Duration = Duration::from_secs(3);

/// See the module.
pub(super) struct Rivals {
    status: Input<TwinStatus>,
    own: String,
    heard: BTreeMap<String, Instant>,
}

/// Identity of this process in `status`: `host:4711`.
pub(super) fn instance() -> String {
    let name = rustix::system::uname();
    format!("{}:{}", name.nodename().to_string_lossy(), std::process::id())
}

impl Rivals {
    /// Subscribes to `status`. Must be called before the recorder is set, since the recorder records `status` as
    /// output of this node.
    pub(crate) fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        let status = participant.subscription("status", qos::sensor(10))?;
        Ok(Self { status, own: instance(), heard: BTreeMap::new() })
    }

    /// Takes the messages, and logs changes in the set of other twins.
    pub(crate) fn poll(&mut self, shared: &Shared) {
        let now = Instant::now();
        let before = self.heard.len();
        while let Some(message) = self.status.take() {
            if message.instance != self.own && self.heard.insert(message.instance.clone(), now).is_none() {
                tracing::warn!(
                    "another twin ({}; this one is {}) speaks on `{}` and its sister topics: {}",
                    message.instance,
                    self.own,
                    self.status.topic(),
                    REMEDY
                );
            }
        }
        let spoke = self.heard.len();
        self.heard.retain(|who, last| {
            let here = now.saturating_duration_since(*last) < GONE;
            if !here {
                tracing::info!("the other twin ({who}) has gone");
            }
            here
        });
        if before != spoke || spoke != self.heard.len() {
            shared.lock().rivals = self.heard.keys().cloned().collect();
        }
    }
}

/// Meaning and remedy.
pub(super) const REMEDY: &str = "readers of predicted_cf get the forces of both, and neither twin vouches for its own. \
                                 Stop one of them, or give one a namespace (--ros-args -r __ns:=/name)";
