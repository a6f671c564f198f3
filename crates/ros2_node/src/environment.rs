//! Environment variables of a ROS 2 program. The crate reads environment variables only here.
//!
//! By default the programs are for this machine only, since DDS has no authentication.
//! `ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET` opens the network.

use std::path::PathBuf;

use ros2_client::ServiceMapping;
use ros2_guarded::ZenohSession;

/// Name of ROS 2's middleware for Zenoh.
const ZENOH: &str = "rmw_zenoh_cpp";

const OWN_DDS: &str = "the programs bring their own DDS";

/// Variables of other ROS 2 programs that have no effect here, with the reason.
const WITHOUT_EFFECT: [(&str, &str); 6] = [
    ("ROS_STATIC_PEERS", "peers are found by multicast, and on this machine"),
    ("ROS_DISCOVERY_SERVER", OWN_DDS),
    ("CYCLONEDDS_URI", OWN_DDS),
    ("FASTRTPS_DEFAULT_PROFILES_FILE", OWN_DDS),
    ("FASTDDS_DEFAULT_PROFILES_FILE", OWN_DDS),
    ("RCUTILS_LOGGING_BUFFERED_STREAM", "every line of the log is written at once"),
];

/// Why the environment is not valid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{variable}={value}: {reason}")]
pub struct EnvironmentError {
    /// Name of the variable.
    pub variable: &'static str,
    /// Its value.
    pub value: String,
    /// What is wrong, and what would be valid.
    pub reason: &'static str,
}

/// Range of communication.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// This machine only.
    Localhost,
    /// All networks of the machine.
    Subnet,
}

/// Settings from the environment.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// `ROS_LOCALHOST_ONLY`, `ROS_AUTOMATIC_DISCOVERY_RANGE`.
    pub reach: Reach,
    /// Mapping of services to DDS, from `RMW_IMPLEMENTATION` (the middleware of the peers).
    pub mapping: ServiceMapping,
    /// For `RMW_IMPLEMENTATION=rmw_zenoh_cpp`: settings for Zenoh instead of DDS, with `ZENOH_SESSION_CONFIG_URI`,
    /// `ZENOH_CONFIG_OVERRIDE` and `ZENOH_ROUTER_CHECK_ATTEMPTS`.
    pub zenoh: Option<ZenohSession>,
    /// `ROS_LOG_DIR`: folder of the log file.
    pub log_folder: Option<PathBuf>,
    /// Warnings about settings that are not supported or doubtful; to be printed once.
    pub warnings: Vec<String>,
}

impl Environment {
    /// Reads the process's environment.
    ///
    /// # Errors
    /// [`EnvironmentError`] naming the variable whose value is not valid.
    pub fn read() -> Result<Self, EnvironmentError> {
        Self::from_lookup(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
    }

    /// Reads any set of variables.
    ///
    /// # Errors
    /// [`EnvironmentError`] naming the variable whose value is not valid.
    pub fn from_lookup(lookup: impl Fn(&'static str) -> Option<String>) -> Result<Self, EnvironmentError> {
        let mut warnings = Vec::new();
        let domain = domain(&lookup, &mut warnings)?;
        let reach = reach(&lookup, &mut warnings);
        let mapping = mapping(&lookup, &mut warnings);
        let zenoh = zenoh(&lookup)?;
        if lookup("ROS_SECURITY_ENABLE").is_some_and(|v| v == "true") {
            return Err(EnvironmentError {
                variable: "ROS_SECURITY_ENABLE",
                value: "true".to_owned(),
                reason: "DDS security is not built into these programs; unset it, or keep the traffic on a trusted network",
            });
        }
        for (variable, why) in WITHOUT_EFFECT {
            if lookup(variable).is_some() {
                warnings.push(format!("{variable} has no effect here: {why}"));
            }
        }
        for variable in ["RCUTILS_COLORIZED_OUTPUT", "RCUTILS_LOGGING_USE_STDOUT"] {
            if let Some(value) = lookup(variable).filter(|v| v != "0" && v != "1") {
                warnings.push(format!("{variable}={value} is neither 0 nor 1: taken as not set"));
            }
        }
        let log_folder = lookup("ROS_LOG_DIR").map(PathBuf::from);
        Ok(Self { domain, reach, mapping, zenoh, log_folder, warnings })
    }
}

/// A domain without a participant on this machine at present.
#[must_use]
pub fn free_domain() -> Option<u16> {
    let nanos = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |t| t.subsec_nanos());
    let start = (nanos ^ std::process::id()).wrapping_mul(2_654_435_761) >> 16;
    (0..100_u32)
        .map(|i| 1 + ((start + i) % 100) as u16)
        // The first participant of a domain listens on this port (RTPS: 7400 + 250 domain + 10).
        .find(|domain| std::net::UdpSocket::bind(("0.0.0.0", 7410 + 250 * domain)).is_ok())
}

fn domain(
    lookup: &impl Fn(&'static str) -> Option<String>,
    warnings: &mut Vec<String>,
) -> Result<u16, EnvironmentError> {
    let Some(text) = lookup("ROS_DOMAIN_ID") else { return Ok(0) };
    let domain = text.trim().parse::<u16>().ok().filter(|d| *d <= 232).ok_or(EnvironmentError {
        variable: "ROS_DOMAIN_ID",
        value: text,
        reason: "a domain is a whole number from 0 to 232 (0 to 101 is safe everywhere)",
    })?;
    if domain > 101 && !(215..=232).contains(&domain) {
        warnings.push(format!(
            "ROS_DOMAIN_ID={domain}: above 101 the ports overlap those that Linux hands out to other programs"
        ));
    }
    Ok(domain)
}

fn reach(lookup: &impl Fn(&'static str) -> Option<String>, warnings: &mut Vec<String>) -> Reach {
    if let Some(text) = lookup("ROS_LOCALHOST_ONLY") {
        // Deprecated since Iron, but it takes precedence if it is 1.
        if text == "1" {
            return Reach::Localhost;
        }
        if text != "0" {
            warnings.push(format!("ROS_LOCALHOST_ONLY={text} is neither 0 nor 1: taken as not set"));
        }
    }
    match lookup("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
        None | Some("LOCALHOST") => Reach::Localhost,
        Some("SUBNET" | "SYSTEM_DEFAULT") => Reach::Subnet,
        Some("OFF") => {
            warnings.push(
                "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF can't be honoured (there are no static peers here): taken as LOCALHOST"
                    .to_owned(),
            );
            Reach::Localhost
        }
        Some(other) => {
            warnings.push(format!(
                "ROS_AUTOMATIC_DISCOVERY_RANGE={other} is unknown (SUBNET, LOCALHOST, OFF, SYSTEM_DEFAULT): taken as LOCALHOST"
            ));
            Reach::Localhost
        }
    }
}

fn mapping(lookup: &impl Fn(&'static str) -> Option<String>, warnings: &mut Vec<String>) -> ServiceMapping {
    match lookup("RMW_IMPLEMENTATION").as_deref() {
        Some("rmw_cyclonedds_cpp") => ServiceMapping::Cyclone,
        None | Some("rmw_fastrtps_cpp" | "rmw_fastrtps_dynamic_cpp") => ServiceMapping::Enhanced,
        Some(ZENOH) => {
            if !cfg!(feature = "zenoh") {
                warnings.push(format!(
                    "RMW_IMPLEMENTATION={ZENOH}: Zenoh is not in this build, so topics and services are offered over DDS, where peers on {ZENOH} \
                     do not hear them; build it with `cargo install --path . --features zenoh`"
                ));
            }
            ServiceMapping::Enhanced
        }
        Some(other) => {
            warnings.push(format!(
                "RMW_IMPLEMENTATION={other}: topics and services are offered over DDS as for rmw_fastrtps_cpp; peers on another middleware won't hear them"
            ));
            ServiceMapping::Enhanced
        }
    }
}

/// Settings for Zenoh, if it is requested and compiled in.
fn zenoh(lookup: &impl Fn(&'static str) -> Option<String>) -> Result<Option<ZenohSession>, EnvironmentError> {
    const CHECKS: &str = "ZENOH_ROUTER_CHECK_ATTEMPTS";
    if !cfg!(feature = "zenoh") || lookup("RMW_IMPLEMENTATION").as_deref() != Some(ZENOH) {
        return Ok(None);
    }
    let router_checks = lookup(CHECKS).map_or(Ok(0), |text| {
        let reason = "is a whole number of seconds to look for a router: 0 for ever, negative not at all";
        text.trim().parse().map_err(|_| EnvironmentError { variable: CHECKS, value: text, reason })
    })?;
    let config_file = lookup("ZENOH_SESSION_CONFIG_URI").map(PathBuf::from);
    let overrides = lookup("ZENOH_CONFIG_OVERRIDE").unwrap_or_default();
    Ok(Some(ZenohSession { config_file, overrides, router_checks }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn with(pairs: &'static [(&'static str, &'static str)]) -> Result<Environment, EnvironmentError> {
        Environment::from_lookup(|name| pairs.iter().find(|(k, _)| *k == name).map(|(_, v)| (*v).to_owned()))
    }

    #[test]
    fn localhost_unless_told_otherwise() {
        assert_eq!(with(&[]).unwrap().reach, Reach::Localhost);
        assert_eq!(with(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]).unwrap().reach, Reach::Subnet);
        let both = with(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"), ("ROS_LOCALHOST_ONLY", "1")]).unwrap();
        assert_eq!(both.reach, Reach::Localhost);
        let odd = with(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "PLANET")]).unwrap();
        assert_eq!(odd.reach, Reach::Localhost);
        assert_eq!(odd.warnings.len(), 1);
    }

    #[test]
    fn domains() {
        assert_eq!(with(&[("ROS_DOMAIN_ID", "42")]).unwrap().domain, 42);
        for bad in [&[("ROS_DOMAIN_ID", "233")], &[("ROS_DOMAIN_ID", "-1")], &[("ROS_DOMAIN_ID", "x")]] {
            assert_eq!(with(bad).unwrap_err().variable, "ROS_DOMAIN_ID");
        }
    }

    #[test]
    fn mapping_follows_the_peers_middleware() {
        assert_eq!(with(&[]).unwrap().mapping, ServiceMapping::Enhanced);
        assert_eq!(with(&[("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")]).unwrap().mapping, ServiceMapping::Cyclone);
        assert_eq!(with(&[("RMW_IMPLEMENTATION", "rmw_other")]).unwrap().warnings.len(), 1);
    }

    #[test]
    fn zenoh_is_taken_or_it_is_said_how_to_build_it() {
        const ASKED: (&str, &str) = ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp");
        let found = with(&[ASKED, ("ZENOH_CONFIG_OVERRIDE", "mode=\"client\""), ("ZENOH_ROUTER_CHECK_ATTEMPTS", "-1")])
            .unwrap();
        if cfg!(feature = "zenoh") {
            let session = found.zenoh.unwrap();
            assert_eq!((session.router_checks, &*session.overrides), (-1, "mode=\"client\""));
            let wrong = with(&[ASKED, ("ZENOH_ROUTER_CHECK_ATTEMPTS", "often")]).unwrap_err();
            assert_eq!(wrong.variable, "ZENOH_ROUTER_CHECK_ATTEMPTS");
        } else {
            assert!(found.zenoh.is_none() && found.warnings[0].contains("--features zenoh"), "{:?}", found.warnings);
        }
        assert_eq!(with(&[]).unwrap().zenoh, None);
    }

    #[test]
    fn what_has_no_effect_is_said_by_name() {
        for variable in WITHOUT_EFFECT.map(|(name, _)| name) {
            let environment = Environment::from_lookup(|name| (name == variable).then(|| "x".to_owned())).unwrap();
            assert!(environment.warnings.len() == 1 && environment.warnings[0].contains(variable));
        }
        assert_eq!(with(&[("RCUTILS_COLORIZED_OUTPUT", "yes")]).unwrap().warnings.len(), 1);
        assert_eq!(with(&[("RCUTILS_COLORIZED_OUTPUT", "1")]).unwrap().warnings.len(), 0);
    }

    #[test]
    fn security_is_refused_not_ignored() {
        assert!(with(&[("ROS_SECURITY_ENABLE", "true")]).is_err());
    }
}
