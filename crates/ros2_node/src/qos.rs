//! Quality of service: the profile of each topic, and the overrides defined by rclcpp
//! (`qos_overrides./measured_js.subscription.reliability`).

use std::time::Duration;

use ros2_client::ParameterValue;
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};

use super::declaration::{Declaration, Range};
pub use ros2_guarded::qos::{Side, describe, durability, latched, latest, reliability, reliable, sensor, service};

/// Splits `qos_overrides./topic.publisher.depth` into topic, side and policy.
#[must_use]
pub fn parse_override_name(name: &str) -> Option<(&str, Side, &str)> {
    let rest = name.strip_prefix("qos_overrides.")?;
    let (rest, policy) = rest.rsplit_once('.')?;
    let (topic, side) = rest.rsplit_once('.')?;
    let side = match side.split('_').next()? {
        "publisher" => Side::Publisher,
        "subscription" => Side::Subscription,
        _ => return None,
    };
    topic.starts_with('/').then_some((topic, side, policy))
}

/// Applies one override.
///
/// # Errors
/// What would be valid, in words.
pub fn apply(profile: &mut QosProfile, policy: &str, value: &ParameterValue) -> Result<(), String> {
    use ParameterValue as P;
    match (policy, value) {
        ("reliability", P::String(v)) => {
            profile.reliability = match v.as_str() {
                "reliable" => Reliability::Reliable { when_full: WhenFull::Fail },
                "best_effort" => Reliability::BestEffort,
                "system_default" => profile.reliability,
                _ => return Err("reliability is reliable, best_effort or system_default".to_owned()),
            };
        }
        ("durability", P::String(v)) => {
            profile.durability = match v.as_str() {
                "volatile" => Durability::Volatile,
                "transient_local" => Durability::TransientLocal,
                "system_default" => profile.durability,
                _ => return Err("durability is volatile, transient_local or system_default".to_owned()),
            };
        }
        ("history", P::String(v)) => {
            profile.history = match (v.as_str(), profile.history) {
                ("keep_all", _) => History::KeepAll,
                ("keep_last" | "system_default", History::KeepAll) => History::KeepLast { depth: 10 },
                ("keep_last" | "system_default", kept) => kept,
                _ => return Err("history is keep_last, keep_all or system_default".to_owned()),
            };
        }
        ("depth", P::Integer(v)) => {
            let depth = usize::try_from(*v).ok().filter(|d| (1..=100_000).contains(d));
            profile.history = History::KeepLast { depth: depth.ok_or_else(|| "depth is 1 to 100000".to_owned())? };
        }
        ("deadline", P::Integer(v)) => profile.deadline = nanoseconds(*v)?,
        ("lifespan", P::Integer(v)) => profile.lifespan = nanoseconds(*v)?,
        ("liveliness_lease_duration", P::Integer(v)) => profile.liveliness_lease = nanoseconds(*v)?,
        ("liveliness", P::String(v)) if v == "automatic" || v == "system_default" => {}
        ("reliability" | "durability" | "history" | "liveliness", _) => return Err(format!("{policy} is a word")),
        ("depth" | "deadline" | "lifespan" | "liveliness_lease_duration", _) => {
            return Err(format!("{policy} is a whole number"));
        }
        _ => {
            return Err("the policy is reliability, durability, history, depth, deadline, lifespan, liveliness or \
                        liveliness_lease_duration"
                .to_owned());
        }
    }
    Ok(())
}

/// The declarations of rclcpp for an endpoint: its QoS as read-only parameters with the names of the overrides.
#[must_use]
pub(crate) fn declarations(topic: &str, side: Side, profile: &QosProfile) -> Vec<Declaration> {
    let word = |text: &str| ParameterValue::String(text.to_owned());
    let (history, depth) = match profile.history {
        History::KeepLast { depth } => ("keep_last", i64::try_from(depth).unwrap_or(i64::MAX)),
        History::KeepAll => ("keep_all", 0),
    };
    let policies = [
        ("reliability", word(reliability(profile))),
        ("durability", word(durability(profile))),
        ("history", word(history)),
        ("depth", ParameterValue::Integer(depth)),
    ];
    policies
        .into_iter()
        .map(|(policy, value)| {
            let name = format!("qos_overrides.{topic}.{}.{policy}", side.word());
            let text = format!("{policy} of the {} of {topic}, settable at start.", side.word());
            Declaration::new(&name, value, Range::Any, &text).fixed()
        })
        .collect()
}

fn nanoseconds(value: i64) -> Result<Option<Duration>, String> {
    match u64::try_from(value) {
        Ok(0) => Ok(None),
        Ok(nanos) => Ok(Some(Duration::from_nanos(nanos))),
        Err(_) => Err("a duration is a number of nanoseconds, 0 for none".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn overrides() {
        let (topic, side, policy) = parse_override_name("qos_overrides./or1/measured_js.subscription.depth").unwrap();
        assert_eq!((topic, side, policy), ("/or1/measured_js", Side::Subscription, "depth"));
        assert!(parse_override_name("qos_overrides.measured_js.subscription.depth").is_none());
        let mut profile = sensor(5);
        apply(&mut profile, "depth", &ParameterValue::Integer(7)).unwrap();
        apply(&mut profile, "reliability", &ParameterValue::String("reliable".into())).unwrap();
        apply(&mut profile, "durability", &ParameterValue::String("transient_local".into())).unwrap();
        assert_eq!(describe(&profile), "reliable, transient_local, depth 7");
        for (policy, value) in [
            ("depth", ParameterValue::Integer(0)),
            ("depth", ParameterValue::String("x".into())),
            ("reliability", ParameterValue::String("x".into())),
            ("speed", ParameterValue::Integer(1)),
        ] {
            assert!(apply(&mut profile, policy, &value).is_err());
        }
    }
}
