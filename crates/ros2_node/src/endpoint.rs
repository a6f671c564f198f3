//! Publishers and subscriptions as the nodes use them: they never wait, count what fails, know who is on the other side,
//! and hand what passes to the node's own recording.

use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use byteorder::{BigEndian, LittleEndian};

use super::origin::Origin;
use super::recorder::Tap;
use ros2_guarded::{Delivery, Link, Mailbox, Unsent, cdr, publication, times_of};
use ros2_messages::RosMessage;

/// A publisher that knows how many subscriptions it has.
pub struct Output<M: serde::Serialize> {
    pub(super) link: Arc<Link>,
    pub(super) endpoint: u16,
    /// The last message goes to those who come later.
    pub(super) latched: bool,
    pub(super) matched: Arc<AtomicUsize>,
    pub(super) topic: String,
    pub(super) failed: Arc<AtomicU64>,
    pub(super) tap: Option<Tap>,
    pub(super) messages: PhantomData<fn(M)>,
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

    /// Publishes; never waits for a reader. False if the middleware did not take it.
    pub fn send(&self, message: M) -> bool {
        if let Some(tap) = &self.tap {
            tap.said(&message);
        }
        match self.link.send(publication(self.endpoint), self.latched, |bytes| cdr(bytes, &message)) {
            Ok(()) => return true,
            // Nobody listens while the middleware process is replaced, and that is counted elsewhere.
            Err(Unsent::Apart) => {}
            Err(Unsent::Behind) => drop(self.failed.fetch_add(1, Ordering::Relaxed)),
            Err(Unsent::Unwritable(reason)) => {
                if self.failed.fetch_add(1, Ordering::Relaxed) == 0 {
                    tracing::error!("`{}` could not be published: {reason}", self.topic);
                }
            }
        }
        false
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
    pub(super) mailbox: Mailbox,
    pub(super) matched: Arc<AtomicUsize>,
    pub(super) topic: String,
    pub(super) type_name: &'static str,
    pub(super) qos: String,
    pub(super) tap: Option<Tap>,
    pub(super) unreadable: Unreadable,
    pub(super) messages: PhantomData<fn() -> M>,
}

impl<M: RosMessage + 'static> Input<M> {
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
        std::iter::from_fn(|| self.mailbox.take()).find_map(|delivery| self.read(&delivery))
    }

    /// The message with its times; the recording gets it. One that can't be decoded is reported.
    fn read(&self, delivery: &Delivery) -> Option<(M, [i64; 2])> {
        let decoded = if delivery.big_endian {
            cdr_encoding::from_bytes::<M, BigEndian>(&delivery.body)
        } else {
            cdr_encoding::from_bytes::<M, LittleEndian>(&delivery.body)
        };
        match decoded {
            Ok((message, _)) => {
                let times = times_of(&delivery.stamp);
                if let Some(tap) = &self.tap {
                    tap.heard(&message, times);
                }
                Some((message, times))
            }
            Err(error) => {
                self.unreadable.note(&self.topic, &error);
                None
            }
        }
    }

    /// How many publish.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Waits for the next message. One that can't be decoded is reported and skipped.
    pub async fn next(&self) -> M {
        self.next_from().await.0
    }

    /// As [`Input::next`], with where it comes from.
    pub async fn next_from(&self) -> (M, Origin) {
        loop {
            let delivery = self.mailbox.next().await;
            if let Some((message, _)) = self.read(&delivery) {
                return (message, Origin::of(&delivery));
            }
        }
    }

    /// As [`Input::take`], with where it comes from.
    pub fn take_from(&self) -> Option<(M, Origin)> {
        std::iter::from_fn(|| self.mailbox.take())
            .find_map(|delivery| Some((self.read(&delivery)?.0, Origin::of(&delivery))))
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
