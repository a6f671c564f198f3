//! Making, changing and writing a [`Scene`].

use std::collections::BTreeSet;

use super::key::Key;
use super::presets::Preset;
use super::section::{Scope, Section as _};
use super::{Scene, SceneError, Value, check, keys, parse, uncertainty, values::Values};

/// A change to one key of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Override {
    /// Dotted path.
    pub path: String,
    /// The new value.
    pub value: NewValue,
    /// Where it was asked for (`--set`, `--depth-m`, `parameter`): the start of every message about it.
    pub place: String,
}

/// The new value of an [`Override`].
#[derive(Clone, Debug, PartialEq)]
pub enum NewValue {
    /// Text that is read by the key's own type.
    Unparsed(String),
    /// A value that has a type already.
    Typed(Value),
}

impl Override {
    /// Reads `key=value`.
    ///
    /// # Errors
    /// [`SceneError::NotAnAssignment`] without `=`; the key itself is looked up by [`Scene::with`].
    pub fn parse(text: &str, place: &str) -> Result<Self, SceneError> {
        match text.split_once('=') {
            Some((path, value)) if !path.trim().is_empty() => Ok(Self::text(path.trim(), value, place)),
            _ => Err(SceneError::NotAnAssignment { place: place.to_owned(), text: text.to_owned() }),
        }
    }

    /// A change whose value is text, to be read by the key's type.
    #[must_use]
    pub fn text(path: &str, value: &str, place: &str) -> Self {
        Self { path: path.to_owned(), value: NewValue::Unparsed(value.to_owned()), place: place.to_owned() }
    }

    /// A change whose value has a type already.
    #[must_use]
    pub fn typed(path: &str, value: impl Into<Value>, place: &str) -> Self {
        Self { path: path.to_owned(), value: NewValue::Typed(value.into()), place: place.to_owned() }
    }

    /// The key whose prior it is, where it is one.
    fn uncertain(&self) -> Option<&str> {
        self.path.strip_prefix(uncertainty::SECTION)?.strip_prefix('.')
    }

    fn shown(&self) -> String {
        match &self.value {
            NewValue::Unparsed(text) => text.clone(),
            NewValue::Typed(value) => value.to_string(),
        }
    }

    /// The list with one of its numbers changed.
    fn checked_in(&self, list: Option<&Value>, path: &str, place: usize) -> Result<Value, SceneError> {
        let key: &Key = keys::require(&self.path, &self.shown(), &self.place)?;
        let number = match &self.value {
            NewValue::Unparsed(text) => text.trim().parse().ok(),
            NewValue::Typed(value) => value.as_real(),
        };
        let Some(number) = number else { return key.check(&Value::Text(self.shown()), path, &self.place) };
        let mut numbers = list.and_then(Value::as_list).unwrap_or_default();
        let count = numbers.len();
        let Some(changed) = numbers.get_mut(place) else {
            return Err(SceneError::DoesNotApply {
                place: self.place.clone(),
                key: self.path.clone(),
                value: self.shown(),
                reason: format!("{path} has {count} numbers, counted from 0"),
            });
        };
        *changed = number;
        key.check(&Value::List(numbers), path, &self.place)
    }

    fn checked(&self) -> Result<Value, SceneError> {
        let key: &Key = keys::require(&self.path, &self.shown(), &self.place)?;
        match &self.value {
            NewValue::Unparsed(text) => key.parse_at(text, &self.path, &self.place),
            NewValue::Typed(value) => key.check(value, &self.path, &self.place),
        }
    }
}

impl Scene {
    /// Reads and checks a scene file's text. `origin` is what messages call it: its path, or a preset's name.
    ///
    /// # Errors
    /// [`SceneError`] with file and line of the first thing that is wrong.
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, SceneError> {
        Self::from_values(&parse::parse(text, origin)?)
    }

    /// A scene that is compiled in.
    ///
    /// # Errors
    /// [`SceneError::UnknownPreset`], with the names that exist.
    pub fn preset(name: &str) -> Result<Self, SceneError> {
        Preset::find(name)?.scene()
    }

    fn from_values(values: &Values) -> Result<Self, SceneError> {
        values.check_applicability()?;
        let mut scene = Self::read(values, Scope::Once)?;
        if !values.has("name") {
            stem(values.origin()).clone_into(&mut scene.name);
        }
        check::check(&scene, values)?;
        Ok(scene)
    }

    /// Every key that applies, defaults included.
    fn to_values(&self) -> Values {
        let mut values = Values::new(&format!("scene {}", self.name));
        self.write(&mut values, Scope::Once);
        values
    }

    /// The scene as a file, every key that applies written out; [`Scene::from_toml`] gives the same scene back.
    #[must_use]
    pub fn to_toml(&self) -> String {
        self.to_values().to_toml()
    }

    /// The scene with some keys changed, all at once, so that the order doesn't matter. Where `instrument.kind` or
    /// `sample.shape` changes, keys of the old kind fall away unless they are among the changes.
    ///
    /// # Errors
    /// [`SceneError`] for a key that is not known, a wrong type, a value out of range, or parts that don't fit.
    pub fn with(&self, changes: &[Override]) -> Result<Self, SceneError> {
        let mut values = self.to_values();
        let mut changed = BTreeSet::new();
        for change in changes {
            if let Some(key) = change.uncertain() {
                let prior = uncertainty::parse(key, &change.shown(), &change.place)?;
                changed.insert(prior.key.clone());
                values.put_prior(prior);
                continue;
            }
            let (path, value) = match keys::element(&change.path) {
                Some((list, place)) => (list, change.checked_in(values.get(list), list, place)?),
                None => (change.path.as_str(), change.checked()?),
            };
            values.check_element(path, &change.place)?;
            if values.is_of_replaced_model(path) {
                return Err(SceneError::DoesNotApply {
                    place: change.place.clone(),
                    key: change.path.clone(),
                    value: change.shown(),
                    reason: "the material has a law of the caller's own".to_owned(),
                });
            }
            values.insert(path, value, change.place.clone());
            changed.insert(path.to_owned());
        }
        // of two keys that are equal and go together one alone was changed
        for key in keys::KEYS.iter().filter(|key| !changed.contains(key.path)) {
            let followed =
                key.follows.filter(|other| changed.contains(*other) && self.tied_to(other) == Some(key.path));
            if let Some(value) = followed.and_then(|other| values.get(other).cloned()) {
                values.put(key.path, value);
            }
        }
        values.drop_misfits(&changed)?;
        Self::from_values(&values)
    }

    /// Changes one key, its value written as after `--set`.
    ///
    /// # Errors
    /// As [`Scene::with`]; the scene is then as it was.
    pub fn set(&mut self, path: &str, value: &str) -> Result<(), SceneError> {
        *self = self.with(&[Override::text(path, value, "set")])?;
        Ok(())
    }

    /// The value of a key, its default included; `None` where the key doesn't apply to this scene or isn't known.
    #[must_use]
    pub fn get(&self, path: &str) -> Option<Value> {
        let values = self.to_values();
        match keys::element(path) {
            Some((list, place)) => values.get(list)?.as_list()?.get(place).copied().map(Value::Real),
            None => values.get(path).cloned(),
        }
    }

    /// Every key that applies to this scene with its value, as [`Scene::paths`] and [`Scene::get`] give them one by one.
    #[must_use]
    pub fn entries(&self) -> Vec<(String, Value)> {
        let values = self.to_values();
        self.paths().into_iter().filter_map(|path| values.get(&path).cloned().map(|value| (path, value))).collect()
    }

    /// Paths of every key that applies to this scene, targets by their index, materials and regions by their names, in the order of the registry.
    #[must_use]
    pub fn paths(&self) -> Vec<String> {
        let values = self.to_values();
        let of = |section: &'static str, element: String| {
            let keys = keys::KEYS.iter().filter(move |key| key.section() == section);
            keys.map(move |key| format!("{section}.{element}.{}", key.field()))
        };
        let targets = (0..self.targets.len()).flat_map(|i| of("targets", i.to_string()));
        let materials = self.materials.iter().flat_map(|m| of("materials", m.name.clone()));
        let regions = self.regions.iter().flat_map(|r| of("regions", r.name.clone()));
        let plain = keys::KEYS.iter().filter(|key| keys::find(key.path).is_some()).map(|key| key.path.to_owned());
        plain.chain(materials).chain(regions).chain(targets).filter(|path| values.has(path)).collect()
    }
}

/// A file's name without folders and `.toml`: what a scene is called where it doesn't say.
fn stem(origin: &str) -> &str {
    let file = origin.rsplit(['/', '\\']).next().unwrap_or(origin);
    file.strip_suffix(".toml").unwrap_or(file)
}
