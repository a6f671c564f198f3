//! ROS 2 parameter files, and the types of values after `-p name:=`.
//!
//! ```yaml
//! /**:                      # every node; also /or1/twin, /*/twin, twin
//!   ros__parameters:
//!     scene: needle_insertion
//!     material:             # nested names are joined by dots
//!       shear_modulus_pa: 1678.0
//! ```

use std::fmt;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use ros2_client::ParameterValue;
use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_saphyr::Spanned;

/// Size limit of parameter files, bytes.
const MAX_BYTES: u64 = 4 << 20;
/// Largest nesting depth of names.
const MAX_DEPTH: usize = 16;

/// Why a parameter file is not valid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum YamlError {
    /// It can't be read.
    #[error("parameter file {}: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// It is not a parameter file.
    #[error("{}:{line}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What is wrong.
        reason: String,
    },
}

/// One parameter set on the command line (or in a file named on it).
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterOverride {
    /// Fully qualified node name pattern: `/**` is every node, `*` is one token of a name.
    pub node_pattern: String,
    /// Name, dotted.
    pub name: String,
    /// Value with its YAML type.
    pub value: ParameterValue,
    /// Source of the value: `-p` or `file:line`.
    pub origin: String,
}

/// A YAML node with the line of every value.
enum Yaml {
    Null,
    Scalar(ParameterValue),
    Sequence(Vec<Spanned<Yaml>>),
    Map(Vec<(String, Spanned<Yaml>)>),
}

impl<'de> Deserialize<'de> for Yaml {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(YamlVisitor)
    }
}

struct YamlVisitor;

impl<'de> Visitor<'de> for YamlVisitor {
    type Value = Yaml;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a parameter value, a list of them or a mapping")
    }
    fn visit_unit<E>(self) -> Result<Yaml, E> {
        Ok(Yaml::Null)
    }
    fn visit_bool<E>(self, v: bool) -> Result<Yaml, E> {
        Ok(Yaml::Scalar(ParameterValue::Boolean(v)))
    }
    fn visit_i64<E>(self, v: i64) -> Result<Yaml, E> {
        Ok(Yaml::Scalar(ParameterValue::Integer(v)))
    }
    fn visit_u64<E: serde::de::Error>(self, v: u64) -> Result<Yaml, E> {
        let v = i64::try_from(v).map_err(|_| E::custom(format!("{v} does not fit a 64-bit integer")))?;
        Ok(Yaml::Scalar(ParameterValue::Integer(v)))
    }
    fn visit_f64<E>(self, v: f64) -> Result<Yaml, E> {
        Ok(Yaml::Scalar(ParameterValue::Double(v)))
    }
    fn visit_str<E>(self, v: &str) -> Result<Yaml, E> {
        Ok(Yaml::Scalar(ParameterValue::String(v.to_owned())))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Yaml, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Yaml::Sequence(items))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Yaml, A::Error> {
        let mut entries: Vec<(String, Spanned<Yaml>)> = Vec::new();
        while let Some((key, value)) = map.next_entry::<String, _>()? {
            if entries.iter().any(|(k, _)| *k == key) {
                return Err(A::Error::custom(format!("`{key}` stands here twice")));
            }
            entries.push((key, value));
        }
        Ok(Yaml::Map(entries))
    }
}

fn parse(text: &str) -> Result<Spanned<Yaml>, (u64, String)> {
    let options = serde_saphyr::options! {
        with_snippet: false,
        non_finite_float_policy: serde_saphyr::NonFiniteFloatPolicy::PassThrough,
    };
    serde_saphyr::from_str_with_options(text, options)
        .map_err(|e| (e.location().map_or(0, |l| l.line()), e.to_string()))
}

/// The value of `-p name:=text`, with its YAML type.
///
/// # Errors
/// What is wrong with it, in words.
pub fn scalar(text: &str) -> Result<ParameterValue, String> {
    if text.trim().is_empty() {
        return Err("there is no value; an empty string is written ''".to_owned());
    }
    let node = parse(text).map_err(|(_, reason)| reason)?;
    value(&node.value)
}

/// Reads a parameter file; the entries come in the file's order.
///
/// # Errors
/// [`YamlError`] with the file and line.
pub(crate) fn read(path: &Path) -> Result<Vec<ParameterOverride>, YamlError> {
    let fail = |reason: String| YamlError::Read { path: path.to_owned(), reason };
    let file = std::fs::File::open(path).map_err(|e| fail(e.to_string()))?;
    let mut text = String::new();
    // Does not rely on the size reported by the system: a device has none, and no end.
    file.take(MAX_BYTES + 1).read_to_string(&mut text).map_err(|e| fail(e.to_string()))?;
    if text.len() as u64 > MAX_BYTES {
        return Err(fail(format!("a parameter file has at most {MAX_BYTES} bytes")));
    }
    from_text(&text, path)
}

/// Reads the text of a parameter file; `path` is for messages.
///
/// # Errors
/// [`YamlError`] with the file and line.
pub fn from_text(text: &str, path: &Path) -> Result<Vec<ParameterOverride>, YamlError> {
    let content = |line: u64, reason: String| YamlError::Content { path: path.to_owned(), line, reason };
    let root = parse(text).map_err(|(line, reason)| content(line, reason))?;
    let Yaml::Map(nodes) = root.value else {
        return Err(content(1, "expected `node_name:` and below it `ros__parameters:`".to_owned()));
    };
    let mut found = Vec::new();
    for (name, node) in &nodes {
        let pattern = if name.starts_with('/') { name.clone() } else { format!("/{name}") };
        walk_node(&pattern, node, 0, &mut found).map_err(|(line, reason)| content(line, reason))?;
    }
    for parameter in &mut found {
        parameter.origin = format!("{}:{}", path.display(), parameter.origin);
    }
    Ok(found)
}

type Located<T> = Result<T, (u64, String)>;

/// Namespaces may be nested (`or1:` and below it `twin:`) down to `ros__parameters`.
fn walk_node(pattern: &str, node: &Spanned<Yaml>, depth: usize, found: &mut Vec<ParameterOverride>) -> Located<()> {
    let line = node.referenced.line();
    let Yaml::Map(entries) = &node.value else {
        return Err((line, format!("expected `ros__parameters:` below `{pattern}`")));
    };
    if depth > MAX_DEPTH {
        return Err((line, "nested too deeply".to_owned()));
    }
    for (key, value) in entries {
        if key == "ros__parameters" {
            walk_parameters(pattern, "", value, 0, found)?;
        } else {
            walk_node(&format!("{pattern}/{key}"), value, depth + 1, found)?;
        }
    }
    Ok(())
}

fn walk_parameters(
    pattern: &str,
    prefix: &str,
    node: &Spanned<Yaml>,
    depth: usize,
    found: &mut Vec<ParameterOverride>,
) -> Located<()> {
    let line = node.referenced.line();
    match &node.value {
        Yaml::Map(_) if depth > MAX_DEPTH => Err((line, "nested too deeply".to_owned())),
        Yaml::Map(entries) => entries.iter().try_for_each(|(key, value)| {
            let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            walk_parameters(pattern, &name, value, depth + 1, found)
        }),
        Yaml::Null if prefix.is_empty() => Ok(()),
        _ if prefix.is_empty() => Err((line, "expected `name: value` below `ros__parameters:`".to_owned())),
        other => {
            let value = value(other).map_err(|reason| (line, format!("`{prefix}`: {reason}")))?;
            found.push(ParameterOverride {
                node_pattern: pattern.to_owned(),
                name: prefix.to_owned(),
                value,
                origin: line.to_string(),
            });
            Ok(())
        }
    }
}

fn value(node: &Yaml) -> Result<ParameterValue, String> {
    match node {
        Yaml::Scalar(value) => Ok(value.clone()),
        Yaml::Null => Err("there is no value; an empty string is written ''".to_owned()),
        Yaml::Map(_) => Err("a mapping is not a parameter value".to_owned()),
        Yaml::Sequence(items) => array(items),
    }
}

/// ROS arrays have one type; integers in an array of doubles are converted to doubles.
fn array(items: &[Spanned<Yaml>]) -> Result<ParameterValue, String> {
    let scalars: Vec<ParameterValue> = items
        .iter()
        .map(|item| match &item.value {
            Yaml::Scalar(value) => Ok(value.clone()),
            _ => Err("a list holds only numbers, booleans or strings".to_owned()),
        })
        .collect::<Result<_, _>>()?;
    fn all<T>(scalars: &[ParameterValue], pick: impl Fn(&ParameterValue) -> Option<T>) -> Option<Vec<T>> {
        scalars.iter().map(pick).collect()
    }
    use ParameterValue as P;
    let integers = all(&scalars, |v| if let P::Integer(v) = v { Some(*v) } else { None });
    let doubles = all(&scalars, |v| match v {
        P::Double(v) => Some(*v),
        #[allow(clippy::cast_precision_loss)] // parameters are small numbers
        P::Integer(v) => Some(*v as f64),
        _ => None,
    });
    let booleans = all(&scalars, |v| if let P::Boolean(v) = v { Some(*v) } else { None });
    let strings = all(&scalars, |v| if let P::String(v) = v { Some(v.clone()) } else { None });
    if scalars.is_empty() {
        return Ok(P::StringArray(Vec::new()));
    }
    integers
        .map(P::IntegerArray)
        .or_else(|| doubles.map(P::DoubleArray))
        .or_else(|| booleans.map(P::BooleanArray))
        .or_else(|| strings.map(P::StringArray))
        .ok_or_else(|| "a list has values of one type only".to_owned())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn read(text: &str) -> Result<Vec<ParameterOverride>, YamlError> {
        from_text(text, Path::new("p.yaml"))
    }

    #[test]
    fn nested_names_wildcards_and_order() {
        let found = read(
            "/**:\n  ros__parameters:\n    scene: needle\n    material:\n      nu: 0.49\nor1:\n  twin:\n    ros__parameters:\n      threads: 2\n",
        )
        .unwrap();
        let rows: Vec<_> =
            found.iter().map(|p| (p.node_pattern.as_str(), p.name.as_str(), p.origin.as_str())).collect();
        assert_eq!(
            rows,
            [("/**", "scene", "p.yaml:3"), ("/**", "material.nu", "p.yaml:5"), ("/or1/twin", "threads", "p.yaml:9")]
        );
        assert_eq!(found[1].value, ParameterValue::Double(0.49));
        assert_eq!(found[2].value, ParameterValue::Integer(2));
    }

    #[test]
    fn values() {
        for (text, value) in [
            ("yes", ParameterValue::Boolean(true)),
            ("'yes'", ParameterValue::String("yes".into())),
            ("1e-6", ParameterValue::Double(1e-6)),
            ("-3", ParameterValue::Integer(-3)),
            ("[1, 2.5]", ParameterValue::DoubleArray(vec![1.0, 2.5])),
            ("[a, b]", ParameterValue::StringArray(vec!["a".into(), "b".into()])),
            ("/a/b c", ParameterValue::String("/a/b c".into())),
        ] {
            assert_eq!(scalar(text).unwrap(), value, "{text}");
        }
        assert!(scalar("").is_err());
        assert!(scalar("{a: 1}").is_err());
        assert!(scalar("[1, a]").is_err());
    }

    #[test]
    fn what_is_wrong_has_a_line() {
        for (text, line) in [
            ("/**:\n  ros__parameters:\n    a: [1, {b: 2}]\n", ":3:"),
            ("/**:\n  a: 1\n", ":2:"),
            ("- 1\n", ":1:"),
            ("/**:\n  ros__parameters:\n    a: 1\n    a: 2\n", ":"),
            ("/**:\n  ros__parameters: 3\n", ":2:"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.starts_with("p.yaml") && message.contains(line), "{text}: {message}");
        }
    }
}
