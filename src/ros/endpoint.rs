//! Publishers and subscriptions as the nodes use them: they never wait, count what fails, know who is on the other side,
//! and hand what passes to the node's own recording.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use ros2_client::{MessageInfo, Publisher, Subscription, WriteError};

use super::clock::wall_nanos;
use super::messages::RosMessage;
use super::recorder::Tap;

/// A publisher that knows how many subscriptions it has.
pub struct Output<M: serde::Serialize> {
    pub(super) publisher: Publisher<M>,
    pub(super) matched: Arc<AtomicUsize>,
    pub(super) topic: String,
    pub(super) failed: AtomicU64,
    pub(super) tap: Option<Tap>,
}

impl<M: serde::Serialize> Output<M> {
    /// Whether anyone listens; the node's own recording does.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        self.tap.is_some() || self.subscribers() > 0
    }

    /// How many listen.
    #[must_use]
    pub fn subscribers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Fully qualified name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Messages that the middleware did not take, because a reliable reader is behind.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.failed.load(Ordering::Relaxed)
    }

    /// Publishes; never waits for a reader. False if the middleware did not take it (counted).
    pub fn send(&self, message: M) -> bool {
        if let Some(tap) = &self.tap {
            tap.said(&message);
        }
        match self.publisher.publish(message) {
            Ok(()) => true,
            Err(error) => {
                let before = self.failed.fetch_add(1, Ordering::Relaxed);
                // WouldBlock is a slow reader, which the status counts; anything else is said the first time.
                if !matches!(error, WriteError::WouldBlock { .. }) && before == 0 {
                    tracing::error!("`{}` could not be published: {}", self.topic, kind(&error));
                }
                false
            }
        }
    }
}

fn kind<M>(error: &WriteError<M>) -> &'static str {
    match error {
        WriteError::Serialization { .. } => "it can't be written as CDR",
        WriteError::WouldBlock { .. } => "a reader is behind",
        WriteError::Io(_) => "the socket failed",
        _ => "the middleware failed",
    }
}

/// Messages that can't be read: the first is said, and one of a hundred thousand.
#[derive(Debug, Default)]
pub(super) struct Unreadable(AtomicU64);

impl Unreadable {
    fn note(&self, topic: &str, error: &impl std::fmt::Display) {
        let before = self.0.fetch_add(1, Ordering::Relaxed);
        if before.is_multiple_of(100_000) {
            tracing::warn!(
                "`{topic}`: a message can't be read ({error}): does its publisher speak another type? Further ones are \
                 skipped without a word, {before} were so far"
            );
        }
    }
}

/// A subscription that knows how many publishers it has.
pub struct Input<M> {
    pub(super) subscription: Subscription<M>,
    pub(super) matched: Arc<AtomicUsize>,
    pub(super) topic: String,
    pub(super) type_name: &'static str,
    pub(super) qos: String,
    pub(super) tap: Option<Tap>,
    pub(super) unreadable: Unreadable,
}

impl<M: RosMessage + 'static> Input<M> {
    /// The subscription.
    #[must_use]
    pub fn subscription(&self) -> &Subscription<M> {
        &self.subscription
    }

    /// What it listens to and what it has found, for people.
    #[must_use]
    pub fn wish(&self) -> Wish {
        Wish {
            topic: self.topic.clone(),
            type_name: self.type_name,
            qos: self.qos.clone(),
            matched: Arc::clone(&self.matched),
        }
    }

    /// Fully qualified name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Next message that has arrived. One that can't be decoded is reported and skipped.
    pub fn take(&self) -> Option<M> {
        self.take_timed().map(|(message, _)| message)
    }

    /// Next message that has arrived, with the wall times at which it was received and sent, ns since 1970.
    pub fn take_timed(&self) -> Option<(M, [i64; 2])> {
        loop {
            match self.subscription.take() {
                Ok(next) => {
                    return next.map(|(message, info)| {
                        let times = self.note(&message, &info);
                        (message, times)
                    });
                }
                Err(error) => self.unreadable.note(&self.topic, &error),
            }
        }
    }

    /// When a message was received and sent, ns since 1970; the recording gets it.
    fn note(&self, message: &M, info: &MessageInfo) -> [i64; 2] {
        let received = info.received_timestamp().map_or_else(wall_nanos, |t| t.to_nanos());
        let sent = info.source_timestamp().map_or(received, |t| t.to_nanos());
        if let Some(tap) = &self.tap {
            tap.heard(message, [received, sent]);
        }
        [received, sent]
    }

    /// How many publish.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Waits for the next message. One that can't be decoded is reported and skipped.
    pub async fn next(&self) -> M {
        loop {
            match self.subscription.async_take().await {
                Ok((message, info)) => {
                    self.note(&message, &info);
                    return message;
                }
                Err(error) => self.unreadable.note(&self.topic, &error),
            }
        }
    }
}

/// What an input listens to.
#[derive(Clone, Debug)]
pub struct Wish {
    /// Fully qualified name.
    pub topic: String,
    /// `sensor_msgs/msg/JointState`.
    pub type_name: &'static str,
    /// QoS in words.
    pub qos: String,
    matched: Arc<AtomicUsize>,
}

impl Wish {
    /// Publishers that are matched.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }
}
