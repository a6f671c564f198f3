//! One entry of the registry: what a key means and which values it takes.

use super::{Range, SceneError, Value};

/// Type and allowed values of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Free text.
    Text,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A number; an integer is taken for one.
    Real(Range),
    /// A whole number from the first to the second, both allowed.
    Integer(i64, i64),
    /// One of these whole numbers.
    OneOf(&'static [i64]),
    /// `true` or `false`.
    Boolean,
    /// Three numbers.
    Point,
    /// A list of numbers, each in the range, at most so many.
    List(Range, usize),
}

/// One key of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Dotted path: `material.poisson_ratio`.
    pub path: &'static str,
    /// Type and allowed values.
    pub kind: Kind,
    /// Default as it would be written, `None` where the key is required.
    pub default: Option<&'static str>,
    /// The key whose value it has where it isn't written, in place of the default.
    pub follows: Option<&'static str>,
    /// Unit; empty for pure numbers, words and text.
    pub unit: &'static str,
    /// What it means, one sentence.
    pub description: &'static str,
    /// The key and its words with which alone this key makes sense.
    pub only_with: Option<(&'static str, &'static [&'static str])>,
    /// Why the range is as it is, where that isn't plain.
    pub reason: &'static str,
    /// Whether it can change while the twin runs.
    pub live: bool,
    /// Whether `AUTO` is taken as well: the program chooses.
    pub auto: bool,
    /// What of it only a build with the feature `research` has.
    pub research: Research,
}

/// What of a key is for comparisons alone, and needs a build with the feature `research`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Research {
    /// Nothing.
    Nothing,
    /// The key; other builds know its default alone.
    Key,
    /// These of its words.
    Words(&'static [&'static str]),
}

/// Whether this build has the feature `research`.
const RESEARCH: bool = cfg!(feature = "research");

/// What a file says to leave a number to the program.
pub(crate) const AUTO: &str = "auto";

impl Key {
    const fn new(path: &'static str, kind: Kind, unit: &'static str) -> Self {
        Self {
            path,
            kind,
            default: None,
            follows: None,
            unit,
            description: "",
            only_with: None,
            reason: "",
            live: false,
            auto: false,
            research: Research::Nothing,
        }
    }

    pub(super) const fn text(path: &'static str) -> Self {
        Self::new(path, Kind::Text, "")
    }

    pub(super) const fn word(path: &'static str, words: &'static [&'static str]) -> Self {
        Self::new(path, Kind::Word(words), "")
    }

    pub(super) const fn real(path: &'static str, range: Range, unit: &'static str) -> Self {
        Self::new(path, Kind::Real(range), unit)
    }

    pub(super) const fn integer(path: &'static str, low: i64, high: i64) -> Self {
        Self::new(path, Kind::Integer(low, high), "")
    }

    pub(super) const fn one_of(path: &'static str, choices: &'static [i64]) -> Self {
        Self::new(path, Kind::OneOf(choices), "")
    }

    pub(super) const fn boolean(path: &'static str) -> Self {
        Self::new(path, Kind::Boolean, "")
    }

    pub(super) const fn point(path: &'static str, unit: &'static str) -> Self {
        Self::new(path, Kind::Point, unit)
    }

    /// A list of at most `most` numbers, each in the range.
    pub(super) const fn list(path: &'static str, range: Range, most: usize, unit: &'static str) -> Self {
        Self::new(path, Kind::List(range, most), unit)
    }

    /// Says what it means: the doc comment of its field, whose leading blank falls away.
    pub(super) const fn described(self, description: &'static str) -> Self {
        Self { description: description.trim_ascii_start(), ..self }
    }

    /// Gives the default.
    pub(super) const fn or(self, default: &'static str) -> Self {
        Self { default: Some(default), ..self }
    }

    /// Gives it the value of another key unless it has its own.
    pub(super) const fn or_as(self, other: &'static str) -> Self {
        Self { follows: Some(other), ..self }
    }

    /// Ties the key to words of the one that selects it.
    pub(super) const fn only(self, selector: &'static str, words: &'static [&'static str]) -> Self {
        Self { only_with: Some((selector, words)), ..self }
    }

    /// Says why the range is as it is.
    pub(super) const fn because(self, reason: &'static str) -> Self {
        Self { reason, ..self }
    }

    /// Marks the key as one that can change while the twin runs.
    pub(super) const fn live(self) -> Self {
        Self { live: true, ..self }
    }

    /// Leaves the number to the program unless one is given.
    pub(super) const fn or_auto(self) -> Self {
        Self { default: Some(AUTO), auto: true, ..self }
    }

    /// Leaves the key to builds for research.
    pub(super) const fn for_research(self) -> Self {
        Self { research: Research::Key, ..self }
    }

    /// Leaves all words after the first so many to builds for research.
    pub(super) const fn for_research_after(self, shipped: usize) -> Self {
        let Kind::Word(words) = self.kind else { return self };
        let (shipped, research) = words.split_at(shipped);
        let kind = if RESEARCH { self.kind } else { Kind::Word(shipped) };
        Self { kind, research: Research::Words(research), ..self }
    }

    /// Whether this build has the key.
    pub(super) fn is_built(&self) -> bool {
        RESEARCH || self.research != Research::Key
    }

    /// Section of the path; empty for the keys at the top of a file.
    #[must_use]
    pub fn section(&self) -> &'static str {
        self.path.split_once('.').map_or("", |(section, _)| section)
    }

    /// Last part of the path.
    #[must_use]
    pub fn field(&self) -> &'static str {
        self.path.split_once('.').map_or(self.path, |(_, field)| field)
    }

    /// The path as a user writes it after `--set`, with a place holder for a target's index or a name.
    #[must_use]
    pub fn shown_path(&self) -> String {
        match self.section() {
            "targets" => format!("targets.INDEX.{}", self.field()),
            section @ ("materials" | "regions") => format!("{section}.NAME.{}", self.field()),
            _ => self.path.to_owned(),
        }
    }

    /// The allowed values in words: `number in (-1, 0.5)`, `one of plate, indenter, needle`.
    #[must_use]
    pub fn allowed(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        match self.kind {
            Kind::Text => "text".to_owned(),
            Kind::Word(words) => format!("one of {}", words.join(", ")),
            Kind::Real(range) if self.auto => format!("number in {range}{unit}, or {AUTO}"),
            Kind::Real(range) => format!("number in {range}{unit}"),
            Kind::Integer(low, high) => format!("whole number in [{low}, {high}]"),
            Kind::OneOf(choices) => {
                format!("one of {}", choices.iter().map(i64::to_string).collect::<Vec<_>>().join(", "))
            }
            Kind::Boolean => "true or false".to_owned(),
            Kind::Point => format!("three finite numbers [x, y, z]{unit}"),
            Kind::List(range, most) => format!("list of at most {most} numbers, each in {range}{unit}"),
        }
    }

    /// Checks type and range, and gives the value in the key's own type (an integer becomes a double where the
    /// key is one). `path` is the full path, with a target's index; `place` says where it was written.
    ///
    /// # Errors
    /// [`SceneError::WrongType`], [`SceneError::OutOfRange`], [`SceneError::UnknownWord`] or [`SceneError::Research`].
    pub(crate) fn check(&self, value: &Value, path: &str, place: &str) -> Result<Value, SceneError> {
        let (fits, value) = match (self.kind, value) {
            (Kind::Text, Value::Text(_)) | (Kind::Boolean, Value::Boolean(_)) => (true, value.clone()),
            (Kind::Word(words), Value::Text(word)) => {
                return self.check_word(words, word, path, place);
            }
            (Kind::Real(_), Value::Text(word)) if self.auto && word == AUTO => (true, value.clone()),
            (Kind::Real(range), Value::Real(_) | Value::Integer(_)) => {
                let x = value.as_real().unwrap_or(f64::NAN);
                (range.contains(x), Value::Real(x))
            }
            (Kind::Integer(low, high), Value::Integer(i)) => ((low..=high).contains(i), value.clone()),
            (Kind::OneOf(choices), Value::Integer(i)) => (choices.contains(i), value.clone()),
            (Kind::Point, Value::Point(p)) => (p.iter().all(|x| x.is_finite()), value.clone()),
            (Kind::List(range, most), Value::List(_) | Value::Point(_) | Value::Real(_) | Value::Integer(_)) => {
                let list = value.as_list().unwrap_or_default();
                (list.len() <= most && list.iter().all(|x| range.contains(*x)), Value::List(list))
            }
            _ => {
                return Err(SceneError::WrongType {
                    place: place.to_owned(),
                    key: path.to_owned(),
                    value: value.to_string(),
                    found: value.type_name(),
                    allowed: self.allowed(),
                });
            }
        };
        if fits {
            return self.built(value, path, place);
        }
        Err(SceneError::OutOfRange {
            place: place.to_owned(),
            key: path.to_owned(),
            value: value.to_string(),
            allowed: match self.reason {
                "" => self.allowed(),
                reason => format!("{} ({reason})", self.allowed()),
            },
        })
    }

    /// The value, if this build has the key; a default is what a build without it has anyway.
    fn built(&self, value: Value, path: &str, place: &str) -> Result<Value, SceneError> {
        let is_default =
            || self.default.is_some_and(|text| number(text) == value || number(text).as_real() == value.as_real());
        if self.is_built() || is_default() { Ok(value) } else { Err(self.left_out(&value.to_string(), path, place)) }
    }

    fn left_out(&self, value: &str, path: &str, place: &str) -> SceneError {
        SceneError::Research {
            place: place.to_owned(),
            key: path.to_owned(),
            value: value.to_owned(),
            description: self.description.trim_end_matches('.').to_owned(),
        }
    }

    fn check_word(&self, words: &[&str], word: &str, path: &str, place: &str) -> Result<Value, SceneError> {
        if words.contains(&word) {
            return Ok(Value::Text(word.to_owned()));
        }
        if matches!(self.research, Research::Words(research) if research.contains(&word)) {
            return Err(self.left_out(&format!("\"{word}\""), path, place));
        }
        Err(SceneError::UnknownWord {
            place: place.to_owned(),
            key: path.to_owned(),
            value: word.to_owned(),
            allowed: match nearest_word(word, words) {
                Some(near) => format!("{}; did you mean {near}?", self.allowed()),
                None => self.allowed(),
            },
        })
    }

    /// Reads a value from the text after `--set key=`, by the key's own type: text and words need no quotes.
    ///
    /// # Errors
    /// [`SceneError`]: no value of this key.
    pub fn parse(&self, text: &str, place: &str) -> Result<Value, SceneError> {
        self.parse_at(text, self.path, place)
    }

    pub(super) fn parse_at(&self, text: &str, path: &str, place: &str) -> Result<Value, SceneError> {
        let trimmed = text.trim();
        let value = match self.kind {
            Kind::Text | Kind::Word(_) => Value::Text(unquoted(trimmed)),
            Kind::Boolean => trimmed.parse().map_or_else(|_| Value::from(trimmed), Value::Boolean),
            Kind::Integer(..) | Kind::OneOf(_) => number(trimmed),
            Kind::Real(_) => number(&unquoted(trimmed)),
            Kind::Point => match numbers(trimmed).map(Value::of_numbers) {
                Some(point @ Value::Point(_)) => point,
                _ => Value::from(trimmed),
            },
            Kind::List(..) => numbers(trimmed).map_or_else(|| Value::from(trimmed), Value::List),
        };
        self.check(&value, path, place)
    }
}

/// The word of a list that is most like an unknown one, unless none is like it at all.
#[must_use]
pub(crate) fn nearest_word<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    words
        .iter()
        .map(|known| (strsim::jaro_winkler(word, known), *known))
        .filter(|(score, _)| *score > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

/// A number as TOML or Rust writes it; anything else stays text, which the check then refuses by name.
fn number(text: &str) -> Value {
    let plain = text.replace('_', "");
    if let Ok(i) = plain.parse::<i64>() {
        return Value::Integer(i);
    }
    plain.parse::<f64>().map_or_else(|_| Value::from(text), Value::Real)
}

/// `[x, y, z]` or `x, y, z`, any number of them.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let inner = text.strip_prefix('[').map_or(Some(text), |rest| rest.strip_suffix(']'))?;
    if inner.trim().is_empty() {
        return text.starts_with('[').then(Vec::new);
    }
    inner.split(',').map(|x| number(x.trim()).as_real()).collect()
}

/// Text without the quotes that a shell user may have kept from TOML.
fn unquoted(text: &str) -> String {
    let quoted = text.len() >= 2 && ['"', '\''].iter().any(|q| text.starts_with(*q) && text.ends_with(*q));
    let parsed = quoted.then(|| format!("x = {text}").parse::<toml::Table>().ok()).flatten();
    match parsed.as_ref().and_then(|table| table.get("x")).and_then(toml::Value::as_str) {
        Some(inner) => inner.to_owned(),
        None => text.to_owned(),
    }
}
