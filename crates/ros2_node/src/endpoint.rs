//! Publishers and subscriptions of the nodes. They never block, count failures and matched peers, and pass their
//! messages to the node's own recording.

use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use byteorder::{BigEndian, LittleEndian};

use super::origin::Origin;
use super::recorder::Tap;
use ros2_guarded::{Delivery, Link, Mailbox, Unsent, cdr, publication, times_of};
use ros2_messages::RosMessage;

/// A publisher that counts its subscriptions.
pub struct Output<M: serde::Serialize> {
    pub(super) link: Arc<Link>,
    pub(super) endpoint: u16,
    /// Whether late subscribers receive the last message.
    pub(super) latched: bool,
    pub(super) matched: Arc<AtomicUsize>,
    pub(super) topic: String,
    pub(super) failed: Arc<AtomicU64>,
    pub(super) tap: Option<Tap>,
    pub(super) messages: PhantomData<fn(M)>,
}

impl<M: serde::Serialize> Output<M> {
    /// Whether there is a subscriber; the node's own recording counts as one.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        self.tap.is_some() || self.subscribers() > 0
    }

    /// Number of subscribers.
    #[must_use]
    pub fn subscribers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Fully qualified name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Number of messages that the middleware rejected because a reliable reader is behind.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.failed.load(Ordering::Relaxed)
    }

    /// Publishes without waiting for readers. Returns false if the middleware rejected the message.
    pub fn send(&self, message: M) -> bool {
        if let Some(tap) = &self.tap {
            tap.said(&message);
        }
        match self.link.send(publication(self.endpoint), self.latched, |bytes| cdr(bytes, &message)) {
            Ok(()) => return true,
            // There are no subscribers while the middleware process is replaced; that is counted elsewhere.
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

/// Counts messages that can't be decoded. The first is reported, then one of a hundred thousand.
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

/// A subscription that counts its publishers.
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
    /// Its topic and matched publishers, for messages.
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

    /// Next message that has arrived. A message that can't be decoded is reported and skipped.
    pub fn take(&self) -> Option<M> {
        self.take_timed().map(|(message, _)| message)
    }

    /// Next message that has arrived, with the wall times at which it was received and sent, ns since 1970.
    pub fn take_timed(&self) -> Option<(M, [i64; 2])> {
        std::iter::from_fn(|| self.mailbox.take()).find_map(|delivery| self.read(&delivery))
    }

    /// Decodes a message with its times and passes it to the recording. A message that can't be decoded is reported.
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

    /// Number of publishers.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    /// Waits for the next message. A message that can't be decoded is reported and skipped.
    pub async fn next(&self) -> M {
        self.next_from().await.0
    }

    /// As [`Input::next`], with the message's origin.
    pub async fn next_from(&self) -> (M, Origin) {
        loop {
            let delivery = self.mailbox.next().await;
            if let Some((message, _)) = self.read(&delivery) {
                return (message, Origin::of(&delivery));
            }
        }
    }

    /// As [`Input::take`], with the message's origin.
    pub fn take_from(&self) -> Option<(M, Origin)> {
        std::iter::from_fn(|| self.mailbox.take())
            .find_map(|delivery| Some((self.read(&delivery)?.0, Origin::of(&delivery))))
    }
}

type Read<T> = dyn Fn(&Delivery) -> Option<T> + Send;

/// A subscription to one of several types, whose messages are converted to `T` as they come.
pub struct Converted<T> {
    mailbox: Mailbox,
    wish: Wish,
    read: Box<Read<T>>,
}

impl<M: RosMessage + 'static> Input<M> {
    /// The same with all messages converted. The node's own recording has them as they came.
    pub fn converted<T>(self, convert: impl Fn(M) -> T + Send + 'static) -> Converted<T> {
        let (mailbox, wish) = (self.mailbox.clone(), self.wish());
        Converted { mailbox, wish, read: Box::new(move |delivery| self.read(delivery).map(|(m, _)| convert(m))) }
    }
}

impl<T> Converted<T> {
    /// As [`Input::wish`].
    #[must_use]
    pub fn wish(&self) -> Wish {
        self.wish.clone()
    }

    /// As [`Input::next_from`].
    pub async fn next_from(&self) -> (T, Origin) {
        loop {
            let delivery = self.mailbox.next().await;
            if let Some(message) = (self.read)(&delivery) {
                return (message, Origin::of(&delivery));
            }
        }
    }
}

/// The subscription of an input.
#[derive(Clone, Debug)]
pub struct Wish {
    /// Fully qualified name.
    pub topic: String,
    /// `sensor_msgs/msg/JointState`.
    pub type_name: &'static str,
    /// Description of the QoS.
    pub qos: String,
    matched: Arc<AtomicUsize>,
}

impl Wish {
    /// Number of matched publishers.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }
}
