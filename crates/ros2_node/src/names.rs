//! Names of nodes, topics and services: relative, private, absolute, in a namespace, remapped.
//!
//! Every name in the program is expanded here to a fully qualified one (`/or1/twin/reset`). The middleware supports
//! neither `~` nor remapping.

/// Why a name is not a ROS 2 name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` is not a ROS 2 name: {reason}")]
pub struct NameError {
    /// The name.
    pub name: String,
    /// What is wrong with it.
    pub reason: &'static str,
}

fn error(name: &str, reason: &'static str) -> NameError {
    NameError { name: name.to_owned(), reason }
}

/// Checks one token of a name, such as a node's name.
///
/// # Errors
/// [`NameError`] if it is empty, starts with a digit or has a character other than letters, digits and `_`.
pub fn check_token(token: &str) -> Result<(), NameError> {
    match token.chars().next() {
        None => return Err(error(token, "a part of it is empty")),
        Some(c) if c.is_ascii_digit() => return Err(error(token, "a part of it starts with a digit")),
        Some(_) => {}
    }
    if !token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(error(token, "only letters, digits, `_` and `/` may stand in it"));
    }
    if token.contains("__") {
        return Err(error(token, "`__` may not stand in it"));
    }
    Ok(())
}

/// Checks a namespace: absolute, no slash at the end.
///
/// # Errors
/// [`NameError`] saying what is wrong.
pub fn check_namespace(namespace: &str) -> Result<(), NameError> {
    let Some(rest) = namespace.strip_prefix('/') else {
        return Err(error(namespace, "a namespace starts with `/`"));
    };
    if rest.is_empty() {
        return Ok(());
    }
    rest.split('/').try_for_each(|token| check_token(token).map_err(|e| error(namespace, e.reason)))
}

/// Checks a name of a topic or service in any of the forms `/a/b`, `a/b`, `~`, `~/a`.
///
/// # Errors
/// [`NameError`] saying what is wrong.
pub fn check_name(name: &str) -> Result<(), NameError> {
    if name == "~" {
        return Ok(());
    }
    let body = name.strip_prefix("~/").or_else(|| name.strip_prefix('/')).unwrap_or(name);
    if body.is_empty() {
        return Err(error(name, "it is empty"));
    }
    body.split('/').try_for_each(|token| check_token(token).map_err(|e| error(name, e.reason)))
}

/// Kind of an endpoint, for remap rules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// A topic.
    Topic,
    /// A service.
    Service,
}

/// Kind of a remap rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RemapKind {
    /// `__node:=name` (or `__name:=name`).
    NodeName,
    /// `__ns:=/namespace`.
    Namespace,
    /// `from:=to`: topics and services.
    TopicOrService(String),
    /// `rostopic://from:=to`.
    Topic(String),
    /// `rosservice://from:=to`.
    Service(String),
}

/// One `-r` rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remap {
    /// Node that the rule is for; `None`: every node.
    pub node: Option<String>,
    /// The names that are replaced.
    pub kind: RemapKind,
    /// The new name.
    pub to: String,
}

/// The node's own name, and the remap rules for the names that it uses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names {
    namespace: String,
    node: String,
    remaps: Vec<Remap>,
}

impl Names {
    /// Applies `__node` and `__ns` to a node's default name in the root namespace.
    ///
    /// # Errors
    /// [`NameError`] if the default name is not one.
    pub fn new(default_node: &str, remaps: &[Remap]) -> Result<Self, NameError> {
        check_token(default_node)?;
        let first = |kind: &RemapKind, node: &str| {
            let applies = |rule: &&Remap| rule.kind == *kind && rule.node.as_deref().is_none_or(|n| n == node);
            remaps.iter().find(applies).map(|rule| rule.to.clone())
        };
        let node = first(&RemapKind::NodeName, default_node).unwrap_or_else(|| default_node.to_owned());
        let namespace = first(&RemapKind::Namespace, &node).unwrap_or_else(|| "/".to_owned());
        Ok(Self { namespace, node, remaps: remaps.to_vec() })
    }

    /// Namespace, starting with `/`.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The node's name without its namespace.
    #[must_use]
    pub fn node(&self) -> &str {
        &self.node
    }

    /// `/namespace/node`.
    #[must_use]
    pub fn fully_qualified(&self) -> String {
        join(&self.namespace, &self.node)
    }

    /// The fully qualified name of a topic or service with the program's `name`, after remapping.
    ///
    /// # Errors
    /// [`NameError`] if `name`, or its replacement, is not a valid name.
    pub fn resolve(&self, name: &str, endpoint: Endpoint) -> Result<String, NameError> {
        let expanded = self.expand(name)?;
        for rule in &self.remaps {
            let from = match (&rule.kind, endpoint) {
                (RemapKind::TopicOrService(from), _)
                | (RemapKind::Topic(from), Endpoint::Topic)
                | (RemapKind::Service(from), Endpoint::Service) => from,
                _ => continue,
            };
            if rule.node.as_deref().is_none_or(|node| node == self.node) && self.expand(from)? == expanded {
                return self.expand(&rule.to);
            }
        }
        Ok(expanded)
    }

    fn expand(&self, name: &str) -> Result<String, NameError> {
        check_name(name)?;
        Ok(if name.starts_with('/') {
            name.to_owned()
        } else if name == "~" {
            self.fully_qualified()
        } else if let Some(private) = name.strip_prefix("~/") {
            join(&self.fully_qualified(), private)
        } else {
            join(&self.namespace, name)
        })
    }
}

fn join(namespace: &str, name: &str) -> String {
    if namespace == "/" { format!("/{name}") } else { format!("{namespace}/{name}") }
}

/// Whether a parameter file's node pattern (`/**`, `/*/twin`, `/or1/twin`) matches this node.
#[must_use]
pub fn pattern_matches(pattern: &str, fully_qualified: &str) -> bool {
    fn tokens(text: &str) -> Vec<&str> {
        text.split('/').filter(|t| !t.is_empty()).collect()
    }
    fn walk(pattern: &[&str], name: &[&str]) -> bool {
        match pattern.split_first() {
            None => name.is_empty(),
            Some((&"**", rest)) => (0..=name.len()).any(|skip| walk(rest, &name[skip..])),
            Some((token, rest)) => {
                name.split_first().is_some_and(|(n, tail)| (*token == "*" || token == n) && walk(rest, tail))
            }
        }
    }
    walk(&tokens(pattern), &tokens(fully_qualified))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::arguments;

    fn names(line: &str) -> Names {
        let (_, ros) = arguments::split(line.split_whitespace().map(Into::into)).unwrap();
        Names::new("twin", &ros.remaps).unwrap()
    }

    #[test]
    fn expansion() {
        let n = names("--ros-args -r __ns:=/or1 -r __node:=sim");
        assert_eq!(n.fully_qualified(), "/or1/sim");
        assert_eq!(n.resolve("measured_js", Endpoint::Topic).unwrap(), "/or1/measured_js");
        assert_eq!(n.resolve("~/reset", Endpoint::Service).unwrap(), "/or1/sim/reset");
        assert_eq!(n.resolve("/clock", Endpoint::Topic).unwrap(), "/clock");
    }

    #[test]
    fn the_first_matching_rule_wins() {
        let n = names("--ros-args -r other:measured_js:=/no -r measured_js:=/rig/js -r measured_js:=/late");
        assert_eq!(n.resolve("measured_js", Endpoint::Topic).unwrap(), "/rig/js");
        let n = names("--ros-args -r twin:measured_js:=js -r __ns:=/a");
        assert_eq!(n.resolve("measured_js", Endpoint::Topic).unwrap(), "/a/js");
        let n = names("--ros-args -r /measured_js:=/x -r rosservice://a:=b -r ~/reset:=/r");
        assert_eq!(n.resolve("measured_js", Endpoint::Topic).unwrap(), "/x");
        assert_eq!(n.resolve("a", Endpoint::Topic).unwrap(), "/a");
        assert_eq!(n.resolve("a", Endpoint::Service).unwrap(), "/b");
        assert_eq!(n.resolve("~/reset", Endpoint::Service).unwrap(), "/r");
    }

    #[test]
    fn bad_names() {
        for bad in ["", "/", "a//b", "a/", "2a", "a b", "~a", "a__b", "~/", "/a/2b"] {
            assert!(check_name(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn patterns() {
        for (pattern, name, matches) in [
            ("/**", "/or1/twin", true),
            ("/*", "/twin", true),
            ("/*", "/or1/twin", false),
            ("/**/twin", "/a/b/twin", true),
            ("/**/twin", "/twin", true),
            ("/or1/*", "/or1/twin", true),
            ("/or1/twin", "/or1/twin", true),
            ("twin", "/twin", true),
            ("/or2/**", "/or1/twin", false),
        ] {
            assert_eq!(pattern_matches(pattern, name), matches, "{pattern} {name}");
        }
    }
}
