//! Other twins on the same names: whoever publishes `status` here beside this node.
//!
//! Readers of `predicted_cf` would get the forces of both without a way to tell them apart, so neither marks its
//! own as valid while the other one publishes. A twin that starts later, or that was frozen and comes back, is heard as well.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::shared::Shared;
use ros2_messages::needle_twin::TwinStatus;
use ros2_node::participant::{Input, Participant, ParticipantError};
use ros2_node::qos;

/// A twin that has been silent for so long has gone; longer than two periods of the slowest sensible `status_rate_hz`.
const GONE: Duration = Duration::from_secs(3);

/// See the module.
pub(super) struct Rivals {
    status: Input<TwinStatus>,
    own: String,
    heard: BTreeMap<String, Instant>,
}

/// What this process calls itself in `status`: `host:4711`.
pub(super) fn instance() -> String {
    let name = rustix::system::uname();
    format!("{}:{}", name.nodename().to_string_lossy(), std::process::id())
}

impl Rivals {
    /// Subscribes `status`; before the recorder is set, which records it as what this node says.
    pub fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        let status = participant.subscription("status", qos::sensor(10))?;
        Ok(Self { status, own: instance(), heard: BTreeMap::new() })
    }

    /// Takes what was said, and tells the others when that changes who is there.
    pub fn poll(&mut self, shared: &Shared) {
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

/// What it means and what to do.
pub(super) const REMEDY: &str = "readers of predicted_cf get the forces of both, and neither twin vouches for its own. \
                                 Stop one of them, or give one a namespace (--ros-args -r __ns:=/name)";
