//! Parameters of a node. They are declared with type, range, description and read-only flag. They are set at the
//! start by the command line and parameter files, and at run time by the parameter services.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard};

use ros2_client::ParameterValue;
use ros2_client::parameters::ParameterDescriptor;

use super::arguments::ParameterOverride;
use super::names;
use super::parameter::{Parameter, Typed};

pub use super::declaration::{Declaration, Range, show};

/// Why the parameters given at the start are not valid. Always fatal: a misspelt parameter is a wrong experiment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{origin}: parameter `{name}`: {reason}")]
pub struct ParameterError {
    /// Source of the value.
    pub origin: String,
    /// Its name.
    pub name: String,
    /// What is wrong, and what would be valid.
    pub reason: String,
}

/// The values of a node's parameters, shared by its threads.
#[derive(Debug)]
pub struct Parameters {
    declarations: RwLock<BTreeMap<String, Declaration>>,
    values: Mutex<BTreeMap<String, ParameterValue>>,
}

impl Parameters {
    /// Declares parameters and sets the values that the command line gives for this node. Values without a declared
    /// parameter are returned as warnings (a parameter file with wildcards may be meant for several nodes).
    ///
    /// # Errors
    /// [`ParameterError`] for an unknown name, a wrong type or a value out of range.
    pub fn declare(
        declarations: Vec<Declaration>,
        overrides: &[ParameterOverride],
        node: &str,
    ) -> Result<(Self, Vec<String>), ParameterError> {
        let declarations: BTreeMap<_, _> = declarations.into_iter().map(|d| (d.name.clone(), d)).collect();
        let mut values: BTreeMap<_, _> =
            declarations.iter().map(|(name, d)| (name.clone(), d.default.clone())).collect();
        let mut warnings = Vec::new();
        for given in overrides.iter().filter(|o| names::pattern_matches(&o.node_pattern, node)) {
            let fail = |reason| ParameterError { origin: given.origin.clone(), name: given.name.clone(), reason };
            if let Some(declaration) = declarations.get(&given.name) {
                values.insert(given.name.clone(), declaration.accept(&given.value).map_err(fail)?);
            } else if super::qos::parse_override_name(&given.name).is_some() {
                // Used by the endpoint that it names; the participant reports the unused ones.
            } else if given.origin.starts_with("-p ") || !given.node_pattern.contains('*') {
                return Err(fail(unknown(&given.name, declarations.keys())));
            } else {
                warnings.push(format!(
                    "{}: `{}`: {}",
                    given.origin,
                    given.name,
                    unknown(&given.name, declarations.keys())
                ));
            }
        }
        Ok((Self { declarations: RwLock::new(declarations), values: Mutex::new(values) }, warnings))
    }

    /// Declares parameters that are known only after the endpoints are made; the values are the defaults.
    pub(super) fn declare_more(&self, more: Vec<Declaration>) {
        self.lock().extend(more.iter().map(|d| (d.name.clone(), d.default.clone())));
        let mut declarations = self.declarations.write().unwrap_or_else(PoisonError::into_inner);
        declarations.extend(more.into_iter().map(|d| (d.name.clone(), d)));
    }

    fn declared(&self) -> RwLockReadGuard<'_, BTreeMap<String, Declaration>> {
        self.declarations.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, ParameterValue>> {
        // A panic elsewhere can't leave a map of values in an inconsistent state.
        self.values.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value of a parameter; its default if the node does not declare it.
    #[must_use]
    pub fn get<T: Typed>(&self, parameter: Parameter<T>) -> T {
        self.lock().get(parameter.name()).and_then(T::of).unwrap_or_else(|| parameter.default())
    }

    /// The value of a parameter by its name, as peers request it.
    #[must_use]
    pub fn by_name(&self, name: &str) -> Option<ParameterValue> {
        self.lock().get(name).cloned()
    }

    /// All names, sorted.
    #[must_use]
    pub(crate) fn names(&self) -> Vec<String> {
        self.declared().keys().cloned().collect()
    }

    /// The descriptor of a parameter.
    #[must_use]
    pub(crate) fn describe(&self, name: &str) -> Option<ParameterDescriptor> {
        self.declared().get(name).map(Declaration::descriptor)
    }

    /// Sets several parameters at run time, all or none; returns their new values.
    ///
    /// # Errors
    /// The name of the rejected parameter and the reason.
    pub fn set(&self, changes: &[(String, ParameterValue)]) -> Result<Vec<(String, ParameterValue)>, (String, String)> {
        let declared = self.declared();
        let accepted: Vec<_> = changes
            .iter()
            .map(|(name, value)| {
                let fail = |reason| (name.clone(), reason);
                let declaration = declared.get(name).ok_or_else(|| fail(unknown(name, declared.keys())))?;
                if declaration.read_only {
                    return Err(fail("is fixed while the node runs; set it at start (-p or --params-file)".to_owned()));
                }
                Ok((name.clone(), declaration.accept(value).map_err(fail)?))
            })
            .collect::<Result<_, _>>()?;
        self.lock().extend(accepted.iter().cloned());
        Ok(accepted)
    }
}

/// Longest name that is compared with the known names and repeated in a message, in characters.
const LONGEST_NAME: usize = 200;

/// A name as shown in messages, truncated: a caller's name may be arbitrarily long.
pub(super) fn shown(name: &str) -> String {
    match name.char_indices().nth(LONGEST_NAME) {
        None => name.to_owned(),
        Some((end, _)) => format!("{}...", &name[..end]),
    }
}

fn unknown<'a>(name: &str, known: impl Iterator<Item = &'a String>) -> String {
    if name.chars().nth(LONGEST_NAME).is_some() {
        return format!("is not declared; no name has more than {LONGEST_NAME} characters");
    }
    let nearest = known.min_by_key(|k| strsim::damerau_levenshtein(k, name));
    nearest.map_or_else(|| "is not declared".to_owned(), |n| format!("is not declared; the nearest name is `{n}`"))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::arguments;

    const RATE_HZ: Parameter<f64> = Parameter::real("rate_hz", 10.0, [0.0, 1000.0], "Rate, Hz.");
    const THREADS: Parameter<i64> = Parameter::integer("threads", 0, [0, 64], "Threads.").fixed();
    const SCENE: Parameter<String> = Parameter::new("scene", "a", "Scene.").fixed();
    const ENTRY_M: Parameter<[f64; 3]> = Parameter::new("entry_m", [0.0, 0.0, 1.0], "Entry, m.");

    fn declared() -> Vec<Declaration> {
        vec![RATE_HZ.declaration(), THREADS.declaration(), SCENE.declaration(), ENTRY_M.declaration()]
    }

    fn declare(line: &str) -> Result<(Parameters, Vec<String>), ParameterError> {
        let (_, ros) = arguments::split(line.split_whitespace().map(Into::into)).unwrap();
        Parameters::declare(declared(), &ros.parameters, "/or1/twin")
    }

    #[test]
    fn integers_are_taken_for_doubles_and_later_wins() {
        let (p, _) = declare("--ros-args -p rate_hz:=5 -p rate_hz:=6 -p other:rate_hz:=7 -p twin:threads:=2").unwrap();
        assert_eq!(p.get(RATE_HZ), 6.0);
        assert_eq!(p.get(THREADS), 2);
        assert_eq!((p.get(SCENE), p.get(ENTRY_M)), ("a".to_owned(), [0.0, 0.0, 1.0]));
    }

    #[test]
    fn wrong_names_types_and_ranges_are_fatal_at_start() {
        for (line, word) in [
            ("--ros-args -p rate_h:=1.0", "rate_hz"),
            ("--ros-args -p rate_hz:=fast", "double"),
            ("--ros-args -p rate_hz:=-1", "[0, 1000]"),
            ("--ros-args -p rate_hz:=.nan", "NaN"),
            ("--ros-args -p threads:=2.5", "integer"),
            ("--ros-args -p threads:=65", "[0, 64]"),
            ("--ros-args -p entry_m:=[1.0,2.0]", "three"),
        ] {
            let message = declare(line).unwrap_err().to_string();
            assert!(message.contains(word), "{line}: {message}");
        }
    }

    /// A comparison of a name of a megabyte with every known name would take minutes and hundreds of megabytes.
    #[test]
    fn a_name_of_any_length_is_refused_in_a_line() {
        let (p, _) = declare("").unwrap();
        let (name, reason) = p.set(&[("x".repeat(4 << 20), ParameterValue::NotSet)]).unwrap_err();
        assert!(shown(&name).len() < 300 && reason.len() < 300, "{reason}");
    }

    #[test]
    fn set_while_running_is_all_or_none() {
        let (p, _) = declare("").unwrap();
        let double = |v| ParameterValue::Double(v);
        assert!(p.set(&[("rate_hz".into(), double(20.0)), ("threads".into(), ParameterValue::Integer(1))]).is_err());
        assert_eq!(p.get(RATE_HZ), 10.0);
        p.set(&[("rate_hz".into(), ParameterValue::Integer(30))]).unwrap();
        assert_eq!(p.get(RATE_HZ), 30.0);
        assert!(p.describe("threads").unwrap().read_only);
    }
}
