//! Quality of service of a recorded publisher, as rosbag2 writes it.
//!
//! The same text must stand in the MCAP channel and in metadata.yaml: readers that find the two different open the
//! bag and yield nothing. So both come from [`Qos::to_yaml`].

use serde::Deserialize;

/// "For ever" in rosbag2's files: 2^63 - 1 ns.
const INFINITE: QosTime = QosTime { sec: 9_223_372_036, nsec: 854_775_807 };

/// Quality of service that a recorded publisher offered.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Qos {
    /// `keep_last` or `keep_all`.
    pub history: Word,
    /// Messages kept with `keep_last`.
    pub depth: i64,
    /// `reliable` or `best_effort`.
    pub reliability: Word,
    /// `volatile` or `transient_local`.
    pub durability: Word,
    /// Longest time between messages.
    pub deadline: QosTime,
    /// How long a message is worth sending.
    pub lifespan: QosTime,
    /// `automatic` or `manual_by_topic`.
    pub liveliness: Word,
    /// Within which a publisher must show that it lives.
    pub liveliness_lease_duration: QosTime,
    /// True: the topic's name on the wire is the topic's name.
    #[serde(default)]
    pub avoid_ros_namespace_conventions: bool,
}

/// A span of time in a [`Qos`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct QosTime {
    /// Seconds.
    pub sec: u64,
    /// Nanoseconds on top.
    pub nsec: u64,
}

/// A policy: by name (metadata version 9) or by number (before).
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum Word {
    /// rmw's number.
    Number(i64),
    /// The name.
    Name(String),
}

impl Word {
    fn name(name: &str) -> Self {
        Self::Name(name.to_owned())
    }

    /// The policy's name, given the names of numbers 0, 1, 2, ...
    fn resolve<'a>(&'a self, names: &[&'a str]) -> &'a str {
        match self {
            Self::Name(name) => name,
            Self::Number(n) => usize::try_from(*n).ok().and_then(|n| names.get(n)).copied().unwrap_or("unknown"),
        }
    }
}

impl Qos {
    /// Reliable, volatile, keep last `depth`.
    #[must_use]
    pub fn reliable(depth: u32) -> Self {
        Self {
            history: Word::name("keep_last"),
            depth: i64::from(depth),
            reliability: Word::name("reliable"),
            durability: Word::name("volatile"),
            deadline: INFINITE,
            lifespan: INFINITE,
            liveliness: Word::name("automatic"),
            liveliness_lease_duration: INFINITE,
            avoid_ros_namespace_conventions: false,
        }
    }

    /// Best effort, volatile, keep last `depth`.
    #[must_use]
    pub fn best_effort(depth: u32) -> Self {
        Self { reliability: Word::name("best_effort"), ..Self::reliable(depth) }
    }

    /// Reliable, transient local ("latched"), keep last `depth`.
    #[must_use]
    pub fn transient_local(depth: u32) -> Self {
        Self { durability: Word::name("transient_local"), ..Self::reliable(depth) }
    }

    /// True unless the publisher was best effort.
    #[must_use]
    pub fn is_reliable(&self) -> bool {
        self.reliability.resolve(&["system_default", "reliable", "best_effort"]) != "best_effort"
    }

    /// True if late joiners get the last messages.
    #[must_use]
    pub fn is_transient_local(&self) -> bool {
        self.durability.resolve(&["system_default", "transient_local", "volatile"]) == "transient_local"
    }

    /// True if every policy is written by name, as metadata version 9 wants it.
    #[must_use]
    pub(crate) fn is_named(&self) -> bool {
        [&self.history, &self.reliability, &self.durability, &self.liveliness]
            .iter()
            .all(|word| matches!(word, Word::Name(_)))
    }

    /// One entry of rosbag2's list of offered profiles.
    #[must_use]
    pub(crate) fn to_yaml(&self) -> String {
        let word = |word: &Word| match word {
            Word::Name(name) => name.clone(),
            Word::Number(n) => n.to_string(),
        };
        let time = |t: QosTime| format!("    sec: {}\n    nsec: {}\n", t.sec, t.nsec);
        format!(
            "- history: {}\n  depth: {}\n  reliability: {}\n  durability: {}\n  deadline:\n{}  lifespan:\n{}  \
             liveliness: {}\n  liveliness_lease_duration:\n{}  avoid_ros_namespace_conventions: {}\n",
            word(&self.history),
            self.depth,
            word(&self.reliability),
            word(&self.durability),
            time(self.deadline),
            time(self.lifespan),
            word(&self.liveliness),
            time(self.liveliness_lease_duration),
            self.avoid_ros_namespace_conventions
        )
    }

    /// The profiles in a YAML list; empty text is an empty list.
    ///
    /// # Errors
    /// What the YAML reader says, if the text is anything else.
    pub(crate) fn parse_list(yaml: &str) -> Result<Vec<Self>, String> {
        if yaml.trim().is_empty() {
            return Ok(Vec::new());
        }
        serde_saphyr::from_str(yaml).map_err(|e| e.to_string())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn text_and_back() {
        for qos in [Qos::reliable(10), Qos::best_effort(1), Qos::transient_local(1)] {
            let back = Qos::parse_list(&qos.to_yaml()).unwrap();
            assert_eq!(back, std::slice::from_ref(&qos));
            assert!(qos.is_named());
        }
        assert!(Qos::parse_list("").unwrap().is_empty());
        assert!(Qos::parse_list("- history: 3").is_err());
    }

    #[test]
    fn numbers_of_older_versions_are_understood() {
        let text = Qos::best_effort(5).to_yaml().replace("best_effort", "2").replace("volatile", "1");
        let qos = &Qos::parse_list(&text).unwrap()[0];
        assert!(!qos.is_reliable() && qos.is_transient_local() && !qos.is_named());
    }
}
