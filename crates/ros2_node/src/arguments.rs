//! `--ros-args`: the command line arguments of all ROS 2 executables.
//!
//! The rules are those of rcl. ROS arguments are between `--ros-args` and `--` (or the end), and there may be several
//! such blocks. All other arguments belong to the program. Arguments that are not supported here are listed in
//! [`RosArguments::ignored`], so that a warning can name them.

use std::ffi::OsString;
use std::path::PathBuf;

pub use super::logging::LogArguments;
use super::logging::Severity;
use super::names::{self, NameError};
pub use super::names::{Remap, RemapKind};
pub use super::parameter_file::ParameterOverride;
use super::parameter_file::{self, YamlError};

/// Why the ROS part of a command line is not valid. All of these are usage errors (exit code 2).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArgumentError {
    /// An argument is not UTF-8.
    #[error("argument {index} is not valid UTF-8: {text}")]
    NotUtf8 {
        /// Position on the command line.
        index: usize,
        /// The argument with the bad bytes replaced.
        text: String,
    },
    /// A flag without a value.
    #[error("`{flag}` needs a value behind it, such as `{flag} {example}`")]
    MissingValue {
        /// The flag.
        flag: String,
        /// An example of a valid value.
        example: &'static str,
    },
    /// Not a ROS argument.
    #[error(
        "`{argument}` is not a ROS argument; the program's own arguments go before `--ros-args` or behind `--`{hint}"
    )]
    Unknown {
        /// The argument.
        argument: String,
        /// Suggestion of the nearest known argument, as `; did you mean ...?`, or empty.
        hint: String,
    },
    /// A remap rule can't be read.
    #[error(
        "remap rule `{rule}`: {reason} (expected `from:=to`, `node:from:=to`, `__ns:=/namespace` or `__node:=name`)"
    )]
    Remap {
        /// The rule.
        rule: String,
        /// What is wrong.
        reason: String,
    },
    /// A name in a remap rule is not a ROS name.
    #[error("remap rule `{rule}`: {source}")]
    RemapName {
        /// The rule.
        rule: String,
        /// What is wrong with the name.
        source: NameError,
    },
    /// A parameter can't be read.
    #[error("parameter `{assignment}`: {reason} (expected `name:=value` or `node:name:=value`)")]
    Parameter {
        /// The assignment.
        assignment: String,
        /// What is wrong.
        reason: String,
    },
    /// A parameter file can't be used.
    #[error(transparent)]
    File(#[from] YamlError),
    /// A log level is unknown.
    #[error("log level `{level}` is unknown; use debug, info, warn, error or fatal, or `logger:=level`")]
    LogLevel {
        /// The text.
        level: String,
    },
}

/// The ROS part of a command line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RosArguments {
    /// Rules in order; the first match applies.
    pub remaps: Vec<Remap>,
    /// Parameters in the order of the command line; the last one applies.
    pub parameters: Vec<ParameterOverride>,
    /// Logging.
    pub log: LogArguments,
    /// Arguments that rcl knows and that have no effect here.
    pub ignored: Vec<String>,
}

const FLAGS: &[&str] = &[
    "--ros-args",
    "-r",
    "--remap",
    "-p",
    "--param",
    "--params-file",
    "--log-level",
    "--log-config-file",
    "--log-file-name",
    "-e",
    "--enclave",
    "--enable-rosout-logs",
    "--disable-rosout-logs",
    "--enable-stdout-logs",
    "--disable-stdout-logs",
    "--enable-external-lib-logs",
    "--disable-external-lib-logs",
];

/// Splits a command line into the program's own arguments and the ROS arguments. `arguments` does not include the
/// program name. Parameter files are read here.
///
/// # Errors
/// [`ArgumentError`], which names the argument (and for a file its line).
pub fn split(arguments: impl IntoIterator<Item = OsString>) -> Result<(Vec<String>, RosArguments), ArgumentError> {
    let mut own = Vec::new();
    let mut ros = RosArguments::default();
    let mut in_block = false;
    let mut rest = arguments.into_iter().enumerate().map(|(index, argument)| {
        argument
            .into_string()
            .map_err(|bad| ArgumentError::NotUtf8 { index: index + 1, text: bad.to_string_lossy().into_owned() })
    });
    while let Some(argument) = rest.next() {
        let argument = argument?;
        match (in_block, argument.as_str()) {
            (_, "--ros-args") => in_block = true,
            (true, "--") => in_block = false,
            (false, _) => own.push(argument),
            (true, _) => ros.take(&argument, &mut rest)?,
        }
    }
    Ok((own, ros))
}

impl RosArguments {
    fn take(
        &mut self,
        flag: &str,
        rest: &mut impl Iterator<Item = Result<String, ArgumentError>>,
    ) -> Result<(), ArgumentError> {
        let mut value = |example: &'static str| {
            rest.next().unwrap_or_else(|| Err(ArgumentError::MissingValue { flag: flag.to_owned(), example }))
        };
        match flag {
            "-r" | "--remap" => self.remaps.push(remap(&value("measured_js:=/rig/measured_js")?)?),
            "-p" | "--param" => self.parameters.push(parameter(&value("tissue_rate_hz:=20.0")?)?),
            "--params-file" => {
                let path = PathBuf::from(value("params.yaml")?);
                self.parameters.extend(parameter_file::read(&path)?);
            }
            "--log-level" => self.log_level(&value("debug")?)?,
            "--enable-rosout-logs" => self.log.rosout = Some(true),
            "--disable-rosout-logs" => self.log.rosout = Some(false),
            "--enable-stdout-logs" => self.log.stdout = Some(true),
            "--disable-stdout-logs" => self.log.stdout = Some(false),
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => self.ignored.push(flag.to_owned()),
            "--log-config-file" | "--log-file-name" | "-e" | "--enclave" => {
                let given = value("name")?;
                self.ignored.push(format!("{flag} {given}"));
            }
            _ => return Err(unknown(flag)),
        }
        Ok(())
    }

    fn log_level(&mut self, text: &str) -> Result<(), ArgumentError> {
        let (logger, level) = match text.split_once(":=") {
            Some((logger, level)) => (Some(logger), level),
            None => (None, text),
        };
        let severity = Severity::parse(level).ok_or_else(|| ArgumentError::LogLevel { level: text.to_owned() })?;
        match logger {
            Some("") => return Err(ArgumentError::LogLevel { level: text.to_owned() }),
            Some(logger) => self.log.loggers.push((logger.to_owned(), severity)),
            None => self.log.level = Some(severity),
        }
        Ok(())
    }
}

fn unknown(argument: &str) -> ArgumentError {
    let nearest = FLAGS
        .iter()
        .map(|flag| (strsim::damerau_levenshtein(flag, argument), flag))
        .min()
        .filter(|(distance, flag)| *distance <= flag.len() / 3);
    let hint = nearest.map_or_else(String::new, |(_, flag)| format!("; did you mean `{flag}`?"));
    ArgumentError::Unknown { argument: argument.to_owned(), hint }
}

fn remap(rule: &str) -> Result<Remap, ArgumentError> {
    let fail = |reason: &str| ArgumentError::Remap { rule: rule.to_owned(), reason: reason.to_owned() };
    let name_error = |source| ArgumentError::RemapName { rule: rule.to_owned(), source };
    let (left, to) = rule.split_once(":=").ok_or_else(|| fail("there is no `:=`"))?;
    if to.is_empty() {
        return Err(fail("nothing stands behind `:=`"));
    }
    let (node, from) = split_node_prefix(left);
    if let Some(node) = node {
        names::check_token(node).map_err(name_error)?;
    }
    let kind = match from {
        "" => return Err(fail("nothing stands in front of `:=`")),
        "__node" | "__name" => {
            names::check_token(to).map_err(name_error)?;
            RemapKind::NodeName
        }
        "__ns" => {
            names::check_namespace(to).map_err(name_error)?;
            RemapKind::Namespace
        }
        _ => topic_rule(from),
    };
    if let RemapKind::Topic(from) | RemapKind::Service(from) | RemapKind::TopicOrService(from) = &kind {
        names::check_name(from).map_err(name_error)?;
        names::check_name(to).map_err(name_error)?;
    }
    Ok(Remap { node: node.map(str::to_owned), kind, to: to.to_owned() })
}

fn topic_rule(from: &str) -> RemapKind {
    if let Some(topic) = from.strip_prefix("rostopic://") {
        RemapKind::Topic(topic.to_owned())
    } else if let Some(service) = from.strip_prefix("rosservice://") {
        RemapKind::Service(service.to_owned())
    } else {
        RemapKind::TopicOrService(from.to_owned())
    }
}

/// `node:rest` → (`node`, `rest`); the colon of `rostopic://` is not a prefix.
fn split_node_prefix(text: &str) -> (Option<&str>, &str) {
    match text.split_once(':') {
        Some((scheme, rest)) if rest.starts_with("//") && (scheme == "rostopic" || scheme == "rosservice") => {
            (None, text)
        }
        Some((node, rest)) => (Some(node), rest),
        None => (None, text),
    }
}

fn parameter(assignment: &str) -> Result<ParameterOverride, ArgumentError> {
    let fail = |reason: String| ArgumentError::Parameter { assignment: assignment.to_owned(), reason };
    let (left, text) = assignment.split_once(":=").ok_or_else(|| fail("there is no `:=`".to_owned()))?;
    let (node, name) = match left.rsplit_once(':') {
        Some((node, name)) => (Some(node), name),
        None => (None, left),
    };
    if name.is_empty() {
        return Err(fail("the name is empty".to_owned()));
    }
    let node_pattern = match node {
        None => "/**".to_owned(),
        Some("") => return Err(fail("the node's name is empty".to_owned())),
        Some(node) if node.starts_with('/') => node.to_owned(),
        // rcl: a bare node name matches that node in every namespace.
        Some(node) => format!("/**/{node}"),
    };
    let value = parameter_file::scalar(text).map_err(fail)?;
    Ok(ParameterOverride { node_pattern, name: name.to_owned(), value, origin: format!("-p {assignment}") })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ros2_client::ParameterValue;

    fn parse(line: &str) -> Result<(Vec<String>, RosArguments), ArgumentError> {
        split(line.split_whitespace().map(OsString::from))
    }

    #[test]
    fn blocks_as_launch_writes_them() {
        let (own, ros) = parse(
            "--scene s --ros-args --log-level debug --ros-args -r __node:=sim -r __ns:=/or1 -r /wrench:=/tool/wrench -- bag",
        )
        .unwrap();
        assert_eq!(own, ["--scene", "s", "bag"]);
        assert_eq!(ros.log.level, Some(Severity::Debug));
        assert_eq!(ros.remaps.len(), 3);
        assert_eq!(ros.remaps[1], Remap { node: None, kind: RemapKind::Namespace, to: "/or1".into() });
    }

    #[test]
    fn node_prefix_and_schemes() {
        let (_, ros) = parse("--ros-args -r twin:a:=b -r rostopic://c:=d -r twin:rosservice://e:=~/f").unwrap();
        assert_eq!(ros.remaps[0].node.as_deref(), Some("twin"));
        assert_eq!(ros.remaps[1].kind, RemapKind::Topic("c".into()));
        assert_eq!(ros.remaps[2].kind, RemapKind::Service("e".into()));
        assert_eq!(ros.remaps[2].node.as_deref(), Some("twin"));
    }

    #[test]
    fn parameters_are_typed_as_yaml() {
        let (_, ros) = parse("--ros-args -p a.b:=3 -p c:=3.0 -p twin:d:=[1,2] -p /x/y:e:=hello -p f:=true").unwrap();
        let values: Vec<_> = ros.parameters.iter().map(|p| p.value.clone()).collect();
        assert_eq!(values[0], ParameterValue::Integer(3));
        assert_eq!(values[1], ParameterValue::Double(3.0));
        assert_eq!(values[2], ParameterValue::IntegerArray(vec![1, 2]));
        assert_eq!(values[3], ParameterValue::String("hello".into()));
        assert_eq!(values[4], ParameterValue::Boolean(true));
        assert_eq!(ros.parameters[2].node_pattern, "/**/twin");
        assert_eq!(ros.parameters[3].node_pattern, "/x/y");
    }

    #[test]
    fn wrong_usage_names_the_culprit() {
        for (line, word) in [
            ("--ros-args -r a", "`a`"),
            ("--ros-args -r a:=", "`a:=`"),
            ("--ros-args -r __ns:=bad", "bad"),
            ("--ros-args -r 2a:=b", "2a"),
            ("--ros-args -p a", "`a`"),
            ("--ros-args --log-level loud", "loud"),
            ("--ros-args --remp a:=b", "--remap"),
            ("--ros-args -r", "-r"),
        ] {
            let message = parse(line).unwrap_err().to_string();
            assert!(message.contains(word), "{line}: {message}");
        }
    }

    #[test]
    fn arguments_outside_a_block_are_left_alone() {
        let (own, ros) = parse("-r a:=b -- x").unwrap();
        assert_eq!(own, ["-r", "a:=b", "--", "x"]);
        assert_eq!(ros, RosArguments::default());
    }
}
