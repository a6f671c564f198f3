//! ROS 2: what the environment asks for, the network, and who else is on the domain.

use std::time::Duration;

use super::network;
use super::row::{Group, Row};
use crate::ros::twin_node;
use ros2_guarded::survey::{Heard, Survey, survey};
use ros2_node::environment::{Environment, Reach};

/// For how long others are listened for: DDS announces itself at once, and is asked again within a second or two.
const TIME: Duration = Duration::from_millis(2500);

/// Variables with a bearing on the nodes, of which the value may be shown: it names nobody.
const PLAIN: [&str; 8] = [
    "ROS_DOMAIN_ID",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "RMW_IMPLEMENTATION",
    "ROS_SECURITY_ENABLE",
    "RCUTILS_COLORIZED_OUTPUT",
    "RCUTILS_LOGGING_USE_STDOUT",
    "ZENOH_ROUTER_CHECK_ATTEMPTS",
];
/// The others: a value may name machines, people or addresses.
const NAMED_ONLY: [&str; 9] = [
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "ROS_LOG_DIR",
    "CYCLONEDDS_URI",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "RCUTILS_CONSOLE_OUTPUT_FORMAT",
    "ZENOH_SESSION_CONFIG_URI",
    "ZENOH_CONFIG_OVERRIDE",
];

/// Whether messages of other machines are read.
pub(super) fn reads_other_machines() -> bool {
    Environment::read().is_ok_and(|environment| environment.reach == Reach::Subnet || environment.zenoh.is_some())
}

pub(super) fn groups() -> Vec<Group> {
    let (variables, environment) = variables();
    let subnet = environment.as_ref().is_some_and(|e| e.reach == Reach::Subnet);
    let mut ports = network::served_ports();
    let mut others = Vec::new();
    if let Some(environment) = environment {
        let heard = if environment.zenoh.is_some() {
            others.push(Row::note("other nodes", "not looked for over Zenoh", "Ask the router with `ros2 node list`."));
            None
        } else {
            let heard = survey(environment.domain, environment.reach == Reach::Localhost, TIME);
            others.extend(domain(&heard, subnet));
            heard.ok().map(|heard| heard.participants)
        };
        ports.push(network::domain_ports(environment.domain, heard));
    }
    let mut groups = vec![
        Group { subject: "ROS environment", rows: variables },
        Group { subject: "network", rows: network::rows(subnet) },
    ];
    groups.push(Group { subject: "domain", rows: others });
    groups.push(Group { subject: "ports", rows: ports });
    groups.retain(|group| !group.rows.is_empty());
    groups
}

/// The variables that are set, and what they come to; no environment if one of them is wrong.
fn variables() -> (Vec<Row>, Option<Environment>) {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let plain = PLAIN.iter().filter_map(|name| Some(format!("{name}={}", set(name)?)));
    let named = NAMED_ONLY.iter().filter(|name| set(name).is_some()).map(|name| (*name).to_owned());
    let said = plain.chain(named).collect::<Vec<_>>().join(", ");
    let mut rows = vec![Row::ok("variables", if said.is_empty() { "none is set".to_owned() } else { said })];
    let environment = match Environment::read() {
        Ok(environment) => environment,
        Err(error) => {
            let advice = format!("Set {} to a valid value or unset it: {}.", error.variable, error.reason);
            rows.push(Row::problem(error.variable, error.value, advice));
            return (rows, None);
        }
    };
    let range = match environment.reach {
        _ if environment.zenoh.is_some() => "over Zenoh, as far as its router reaches",
        Reach::Localhost => "this machine only (ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET opens the network)",
        Reach::Subnet => "every network of this machine",
    };
    rows.push(Row::ok("range", format!("domain {}, {range}", environment.domain)));
    for warning in &environment.warnings {
        rows.push(warned(warning));
    }
    rows.extend(contradictions(&set));
    (rows, Some(environment))
}

/// A warning of the nodes as a row: it begins with the variable.
fn warned(warning: &str) -> Row {
    let variable = warning.split(['=', ' ']).next().unwrap_or_default().to_owned();
    // of a middleware that is not in this program: nothing is heard from one side to the other
    if variable == "RMW_IMPLEMENTATION" {
        Row::problem(variable, "not the wire of this program", format!("{warning}."))
    } else {
        Row::note(variable, "not taken as it is set", format!("{warning}."))
    }
}

/// Variables that gainsay each other.
fn contradictions(set: &impl Fn(&str) -> Option<String>) -> Vec<Row> {
    let is = |name: &str, value: &str| set(name).as_deref() == Some(value);
    let mut rows = Vec::new();
    if is("ROS_LOCALHOST_ONLY", "1") && is("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET") {
        rows.push(Row::note(
            "ROS_LOCALHOST_ONLY",
            "1, with ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET",
            "Unset one of the two: the first prevails here, and in ROS since Iron.",
        ));
    }
    let cyclone = is("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp");
    if set("CYCLONEDDS_URI").is_some() && !cyclone {
        rows.push(Row::note(
            "CYCLONEDDS_URI",
            "set, but RMW_IMPLEMENTATION is not rmw_cyclonedds_cpp",
            "Set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp for your other nodes, or unset CYCLONEDDS_URI.",
        ));
    }
    let profiles = ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"];
    if cyclone && let Some(name) = profiles.into_iter().find(|name| set(name).is_some()) {
        rows.push(Row::note(
            name,
            "set, but RMW_IMPLEMENTATION is rmw_cyclonedds_cpp",
            format!("Unset {name} or RMW_IMPLEMENTATION: your other nodes do not read it either."),
        ));
    }
    rows
}

/// Who was heard, and what of it the twin can read.
fn domain(heard: &Result<Survey, String>, subnet: bool) -> Vec<Row> {
    let heard = match heard {
        Ok(heard) => heard,
        Err(error) => {
            let advice =
                "Choose another ROS_DOMAIN_ID, or free sockets and memory: a node can't join this domain either.";
            return vec![Row::problem("other nodes", error.as_str(), advice)];
        }
    };
    let mut rows = vec![kept_to_this_machine(heard, subnet)];
    let value = if heard.participants == 0 {
        "no other program on this domain".to_owned()
    } else {
        let names: Vec<&str> = heard.nodes.iter().map(String::as_str).collect();
        let names = if names.is_empty() { "none has said its name".to_owned() } else { names.join(", ") };
        format!("{} programs; nodes: {names}", heard.participants)
    };
    rows.push(Row::ok("other nodes", value));
    rows.extend(inputs(heard));
    rows
}

/// Whether the socket filter can be attached (docs/lab/decisions/this_machine.md).
fn kept_to_this_machine(heard: &Survey, subnet: bool) -> Row {
    const NAME: &str = "sockets";
    match &heard.open {
        None if subnet => Row::ok(NAME, "open to every network, as the range says"),
        None => Row::ok(NAME, "can be kept to this machine"),
        Some(reason) => Row::note(
            NAME,
            format!("can't be kept to this machine ({reason})"),
            "Do that, or set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST for your other nodes too, which do not find the twin otherwise.",
        ),
    }
}

/// For each input of the twin the topics that have its type.
fn inputs(heard: &Survey) -> Vec<Row> {
    let mut rows = Vec::new();
    for (input, types) in twin_node::input_topics() {
        let type_name = types[0];
        let is_named_so = |topic: &str| topic.rsplit('/').next() == Some(input);
        let fitting: Vec<&Heard> = heard.published.iter().filter(|h| h.type_name == type_name).collect();
        let other = heard.published.iter().find(|h| is_named_so(&h.topic) && h.type_name != type_name);
        let name = format!("input {input}");
        if let Some(Heard { topic, type_name: theirs }) = other {
            rows.push(Row::problem(
                name,
                format!("{topic} has the type {theirs}"),
                match types.contains(&theirs.as_str()) {
                    true => format!("Start the twin with `-p {input}_type:={theirs}`: it hears {type_name} otherwise."),
                    false => format!("Publish {type_name} there, or remap the twin's input to another topic: the twin does not hear this one."),
                },
            ));
        } else if !fitting.is_empty() {
            let topics: Vec<&str> = fitting.iter().map(|h| h.topic.as_str()).collect();
            let remap = match &topics[..] {
                [only] if !is_named_so(only) => format!(" (`-r {input}:={only}`)"),
                _ => String::new(),
            };
            rows.push(Row::ok(name, format!("{}{remap}", topics.join(", "))));
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::cli::doctor::row::Verdict;

    fn publishing(topics: &[(&str, &str)]) -> Survey {
        let heard = |(topic, name): &(&str, &str)| Heard { topic: (*topic).to_owned(), type_name: (*name).to_owned() };
        Survey { participants: 1, published: topics.iter().map(heard).collect(), ..Survey::default() }
    }

    #[test]
    fn topics_that_fit_an_input_are_named_and_a_wrong_type_is_a_problem() {
        let fits = inputs(&publishing(&[("/arm/joint_states", "sensor_msgs/msg/JointState")]));
        assert!(fits.len() == 1 && fits[0].value.contains("-r measured_js:=/arm/joint_states"), "{fits:?}");
        let wrong = inputs(&publishing(&[("/arm/measured_cf", "geometry_msgs/msg/Wrench")]));
        assert_eq!(wrong[0].verdict, Verdict::Problem);
        assert!(wrong[0].advice.as_ref().unwrap().contains("-p measured_cf_type:=geometry_msgs/msg/Wrench`"));
        assert!(inputs(&publishing(&[("/chatter", "std_msgs/msg/String")])).is_empty());
    }

    #[test]
    fn variables_that_gainsay_each_other_are_said() {
        let with = |pairs: &'static [(&str, &str)]| {
            contradictions(&|name: &str| pairs.iter().find(|(k, _)| *k == name).map(|(_, v)| (*v).to_owned()))
        };
        assert_eq!(with(&[("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]).len(), 1);
        assert_eq!(with(&[("CYCLONEDDS_URI", "x")]).len(), 1);
        assert_eq!(with(&[("CYCLONEDDS_URI", "x"), ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")]).len(), 0);
        let fast = [("FASTDDS_DEFAULT_PROFILES_FILE", "x"), ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")];
        assert_eq!(
            contradictions(&|name: &str| fast.iter().find(|(k, _)| *k == name).map(|(_, v)| (*v).to_owned())).len(),
            1
        );
        assert_eq!(warned("RMW_IMPLEMENTATION=rmw_other: nobody hears").verdict, Verdict::Problem);
        assert_eq!(warned("CYCLONEDDS_URI has no effect here: so").name, "CYCLONEDDS_URI");
    }

    #[test]
    fn a_socket_that_hears_other_machines_is_said_with_what_to_do() {
        let open = Survey { open: Some("not permitted; it needs SYS_PTRACE".to_owned()), ..Survey::default() };
        let row = kept_to_this_machine(&open, false);
        assert!(row.verdict == Verdict::Note && row.value.contains("SYS_PTRACE"));
        assert!(row.advice.unwrap().contains("LOCALHOST"));
    }
}
