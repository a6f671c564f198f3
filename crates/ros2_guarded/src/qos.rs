//! Quality of service: the profiles that a node needs, and their words.

use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};

/// Sensor data: best effort (which hears reliable publishers too), a short queue.
#[must_use]
pub const fn sensor(depth: usize) -> QosProfile {
    QosProfile::subscription_default().history(History::KeepLast { depth })
}

/// Small outputs: reliable, and never waiting for a slow reader.
#[must_use]
pub const fn reliable(depth: usize) -> QosProfile {
    QosProfile::subscription_default().history(History::KeepLast { depth }).reliability_reliable(WhenFull::Fail)
}

/// What is published once and must reach those who come later.
#[must_use]
pub const fn latched() -> QosProfile {
    latest(1)
}

/// The last few messages, which reach those who come later too.
#[must_use]
pub const fn latest(depth: usize) -> QosProfile {
    reliable(depth).durability(Durability::TransientLocal)
}

/// Services: reliable both ways.
#[must_use]
pub const fn service() -> QosProfile {
    reliable(10)
}

/// Publisher or subscription, as the overrides' names tell them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Writes.
    Publisher,
    /// Reads.
    Subscription,
}

impl Side {
    /// `publisher` or `subscription`.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Publisher => "publisher",
            Self::Subscription => "subscription",
        }
    }
}

/// `best_effort` or `reliable`.
#[must_use]
pub const fn reliability(profile: &QosProfile) -> &'static str {
    match profile.reliability {
        Reliability::BestEffort => "best_effort",
        Reliability::Reliable { .. } => "reliable",
    }
}

/// `volatile` or `transient_local`.
#[must_use]
pub const fn durability(profile: &QosProfile) -> &'static str {
    match profile.durability {
        Durability::Volatile => "volatile",
        Durability::TransientLocal => "transient_local",
    }
}

/// One line for people: `best_effort, volatile, depth 5`.
#[must_use]
pub fn describe(profile: &QosProfile) -> String {
    let (reliability, durability) = (reliability(profile), durability(profile));
    match profile.history {
        History::KeepLast { depth } => format!("{reliability}, {durability}, depth {depth}"),
        History::KeepAll => format!("{reliability}, {durability}, keep_all"),
    }
}
