//! The raw layer: checked values by dotted path, each with the place where it was written.
//!
//! A file, `--set` and parameters all end here; the sections' fields turn it into a [`super::Scene`] and back.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use mtled::material::Own;

use super::key::Key;
use super::keys::{self, KEYS, SECTIONS};
use super::{SceneError, Uncertain, Value, uncertainty};

/// Values of a scene by dotted path. Only known keys, each of its own type and in its own range.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Values {
    entries: BTreeMap<String, Entry>,
    /// Sections that are named, even if nothing is in them.
    sections: BTreeSet<String>,
    /// Sections and names of the materials and regions, in their order.
    names: Vec<(String, String)>,
    /// Priors of keys, in their order.
    priors: Vec<Uncertain>,
    /// Laws of the caller's own, by the path of the model in whose place they are.
    own_laws: BTreeMap<String, Own>,
    /// File, preset or scene that is to blame where a key is absent.
    origin: String,
}

#[derive(Clone, Debug, PartialEq)]
struct Entry {
    value: Value,
    place: String,
}

/// What a value selects: a word, or a truth by its name.
fn selected(value: &Value) -> Option<String> {
    match value {
        Value::Boolean(yes) => Some(yes.to_string()),
        other => other.as_text().map(str::to_owned),
    }
}

impl Values {
    /// No value at all.
    pub(super) fn new(origin: &str) -> Self {
        let (entries, sections) = (BTreeMap::new(), BTreeSet::new());
        Self {
            entries,
            sections,
            names: Vec::new(),
            priors: Vec::new(),
            own_laws: BTreeMap::new(),
            origin: origin.to_owned(),
        }
    }

    /// The law in place of the model at a path.
    pub(super) fn own_law(&self, model: &str) -> Option<Own> {
        self.own_laws.get(model).copied()
    }

    pub(super) fn put_own_law(&mut self, model: String, law: Own) {
        self.own_laws.insert(model, law);
    }

    /// Whether a law of the caller's own has made a key meaningless.
    pub(super) fn is_of_replaced_model(&self, path: &str) -> bool {
        let of_model =
            |key: &Key| key.path == "material.model" || key.only_with.is_some_and(|w| w.0 == "material.model");
        let section = path.rsplit_once('.').map_or("", |(section, _)| section);
        self.own_laws.contains_key(&format!("{section}.model")) && keys::find(path).is_some_and(of_model)
    }

    /// Where the whole of it comes from.
    pub(super) fn origin(&self) -> &str {
        &self.origin
    }

    /// Stores a value that is known to be of its key's type and range.
    pub(super) fn put(&mut self, path: &str, value: impl Into<Value>) {
        let place = self.origin.clone();
        self.insert(path, value.into(), place);
    }

    /// Stores a checked value with its place.
    pub(super) fn insert(&mut self, path: &str, value: Value, place: String) {
        if let Some((section, _)) = path.split_once('.') {
            self.sections.insert(section.to_owned());
        }
        if let Some((section @ ("materials" | "regions"), name, _)) = keys::split(path) {
            self.name_element(section, name);
        }
        self.entries.insert(path.to_owned(), Entry { value, place });
    }

    /// Notes that a section is named.
    pub(super) fn name_section(&mut self, section: &str) {
        self.sections.insert(section.to_owned());
    }

    /// Notes that a material or region is named.
    pub(super) fn name_element(&mut self, section: &str, name: &str) {
        if !self.names(section).any(|known| known == name) {
            self.names.push((section.to_owned(), name.to_owned()));
        }
    }

    /// Names of the materials or regions, in their order.
    pub(super) fn names(&self, section: &str) -> impl Iterator<Item = &str> {
        self.names.iter().filter(move |(of, _)| of == section).map(|(_, name)| name.as_str())
    }

    /// Priors of keys, in their order.
    pub(super) fn priors(&self) -> &[Uncertain] {
        &self.priors
    }

    /// Stores the prior of a key, in the place of an earlier one.
    pub(super) fn put_prior(&mut self, prior: Uncertain) {
        match self.priors.iter_mut().find(|known| known.key == prior.key) {
            Some(known) => *known = prior,
            None => self.priors.push(prior),
        }
    }

    /// Whether a section is named: what is not is not modelled.
    pub(super) fn has_section(&self, section: &str) -> bool {
        self.sections.contains(section)
    }

    /// Whether a key was written.
    pub(super) fn has(&self, path: &str) -> bool {
        self.entries.contains_key(path)
    }

    /// The value that was written.
    pub(super) fn get(&self, path: &str) -> Option<&Value> {
        self.entries.get(path).map(|entry| &entry.value)
    }

    /// Where a key was written; where it should have been, if it wasn't.
    pub(super) fn place(&self, path: &str) -> String {
        self.entries.get(path).map_or_else(|| self.origin.clone(), |entry| entry.place.clone())
    }

    /// The written value or the key's default.
    pub(super) fn value(&self, path: &str) -> Result<Value, SceneError> {
        if let Some(value) = self.get(path) {
            return Ok(value.clone());
        }
        let key = keys::require(path, "none", &self.origin)?;
        if let Some(other) = key.follows {
            return self.value(other);
        }
        match key.default {
            Some(text) => key.parse_at(text, path, &self.origin),
            None => match self.inherited(path) {
                Some(value) => Ok(value.clone()),
                None => Err(self.missing(path, key)),
            },
        }
    }

    /// What a material takes over from `[material]`: its compressibility and density, and all if it is rigid, where no
    /// constant matters.
    fn inherited(&self, path: &str) -> Option<&Value> {
        let ("materials", name, field) = keys::split(path)? else { return None };
        let rigid = self.get(&format!("materials.{name}.rigid")) == Some(&Value::Boolean(true));
        let shared = ["poisson_ratio", "density_kg_per_m3"].contains(&field);
        if shared || rigid { self.get(&format!("material.{field}")) } else { None }
    }

    /// The word of a key that selects others; `None` where it is missing.
    pub(super) fn word(&self, selector: &str) -> Option<String> {
        selected(&self.value(selector).ok()?)
    }

    fn missing(&self, path: &str, key: &Key) -> SceneError {
        let because = match key.only_with {
            Some((selector, _)) => {
                let selector = keys::beside(path, selector);
                let word = self.word(&selector).unwrap_or_default();
                format!(" (required where {selector} is \"{word}\")")
            }
            None if key.section().is_empty() => String::new(),
            None => format!(" (required in [{}])", key.section()),
        };
        SceneError::Missing { place: self.origin.clone(), key: path.to_owned(), allowed: key.allowed(), because }
    }

    /// Number of targets: the length of the unbroken run of indices from 0.
    pub(super) fn targets(&self) -> usize {
        (0..).take_while(|&i| self.has_target(i)).count()
    }

    fn has_target(&self, i: usize) -> bool {
        let prefix = format!("targets.{i}.");
        self.entries.range(prefix.clone()..).next().is_some_and(|(path, _)| path.starts_with(&prefix))
    }

    /// Refuses keys that don't go with the word of the key that selects them.
    pub(super) fn check_applicability(&self) -> Result<(), SceneError> {
        for (path, entry) in &self.entries {
            if let Some((selector, word, words)) = self.misfit(path)? {
                let words: Vec<_> = words.iter().map(|w| format!("\"{w}\"")).collect();
                return Err(SceneError::DoesNotApply {
                    place: entry.place.clone(),
                    key: path.clone(),
                    value: entry.value.to_string(),
                    reason: format!("{selector} is \"{word}\", and the key belongs to {}", words.join(" and ")),
                });
            }
        }
        Ok(())
    }

    /// Drops the keys that don't go with the words that now select, except those in `keep`.
    pub(super) fn drop_misfits(&mut self, keep: &BTreeSet<String>) -> Result<(), SceneError> {
        let paths: Vec<String> = self.entries.keys().filter(|path| !keep.contains(*path)).cloned().collect();
        for path in paths {
            if self.misfit(&path)?.is_some() {
                self.entries.remove(&path);
            }
        }
        let mut priors = std::mem::take(&mut self.priors);
        let mut fallen = BTreeSet::new();
        priors.retain(|prior| {
            let stays = keep.contains(&prior.key) || matches!(self.misfit(&prior.key), Ok(None));
            stays || !fallen.insert(prior.key.clone())
        });
        priors.iter_mut().for_each(|prior| prior.correlation.retain(|key, _| !fallen.contains(key)));
        self.priors = priors;
        Ok(())
    }

    /// Selector, its present word and the words wanted, if a key doesn't go with it.
    fn misfit(&self, path: &str) -> Result<Option<Misfit>, SceneError> {
        let Some((selector, words)) = keys::find(path).and_then(|key| key.only_with) else { return Ok(None) };
        let selector = keys::beside(path, selector);
        let word = selected(&self.value(&selector)?).unwrap_or_default();
        Ok((!words.contains(&word.as_str())).then_some((selector, word, words)))
    }

    /// The scene as a TOML file: every key that was put in, in the order of the registry.
    pub(super) fn to_toml(&self) -> String {
        let mut out = String::new();
        for (model, law) in &self.own_laws {
            let _ = writeln!(out, "# instead of {model}, which stands here, the scene had {law:?}"); // writing to a String can't fail
        }
        for key in KEYS.iter().filter(|key| key.section().is_empty()) {
            self.write_line(&mut out, key.path, key);
        }
        for section in SECTIONS.iter().filter(|section| self.has_section(section)) {
            if ["materials", "regions"].contains(section) {
                for name in self.names(section) {
                    let title =
                        if *section == "regions" { "[regions]".to_owned() } else { format!("{section}.{name}") };
                    let _ = writeln!(out, "\n[{title}]"); // writing to a String can't fail
                    self.write_section(&mut out, section, |key| format!("{section}.{name}.{}", key.field()));
                }
            } else if *section == "targets" {
                for i in 0..self.targets() {
                    out.push_str("\n[[targets]]\n");
                    self.write_section(&mut out, section, |key| format!("targets.{i}.{}", key.field()));
                }
            } else {
                let _ = writeln!(out, "\n[{section}]"); // writing to a String can't fail
                self.write_section(&mut out, section, |key| key.path.to_owned());
            }
        }
        if !self.priors.is_empty() {
            let _ = writeln!(out, "\n[{}]", uncertainty::SECTION); // writing to a String can't fail
        }
        for one in &self.priors {
            let _ = writeln!(out, "\"{}\" = {one}", one.key);
        }
        out
    }

    fn write_section(&self, out: &mut String, section: &str, path: impl Fn(&Key) -> String) {
        for key in KEYS.iter().filter(|key| key.section() == section) {
            self.write_line(out, &path(key), key);
        }
    }

    fn write_line(&self, out: &mut String, path: &str, key: &Key) {
        if let Some(value) = self.get(path) {
            let _ = writeln!(out, "{} = {value}", key.field()); // writing to a String can't fail
        }
    }

    /// `path = value` of every key that was put in and counts, a line each, by path.
    pub(super) fn lines(&self, counts: impl Fn(&str, &Value) -> bool) -> String {
        let counting = self.entries.iter().filter(|(path, entry)| counts(path, &entry.value));
        counting.map(|(path, entry)| format!("{path} = {}\n", entry.value)).collect()
    }

    /// Refuses an index of `targets` that would leave a hole, and a material or region that the scene doesn't have.
    pub(super) fn check_element(&self, path: &str, place: &str) -> Result<(), SceneError> {
        let refuse = |value: String, reason: String| {
            Err(SceneError::Inconsistent { place: place.to_owned(), key: path.to_owned(), value, reason })
        };
        match keys::split(path) {
            Some(("targets", index, _)) => {
                let (index, count) = (index.parse::<usize>().unwrap_or(0), self.targets());
                if index == 0 || self.has_target(index - 1) {
                    return Ok(());
                }
                refuse(
                    format!("index {index}"),
                    format!("the scene has {count} targets, counted from 0; the next one is targets.{count}"),
                )
            }
            Some((section, name, _)) if !self.names(section).any(|known| known == name) => {
                refuse(format!("\"{name}\""), format!("the scene has {}", listed(section, self.names(section))))
            }
            _ => Ok(()),
        }
    }
}

/// `the materials fat, skin`, `no regions`.
pub(super) fn listed<'a>(section: &str, names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.collect();
    if names.is_empty() { format!("no {section}") } else { format!("the {section} {}", names.join(", ")) }
}

type Misfit = (String, String, &'static [&'static str]);
