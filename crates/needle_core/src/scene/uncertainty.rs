//! `[uncertainty]`: what is believed of scene keys before anything is measured, as prior distributions.
//!
//! ```text
//! "KEY" = { normal = [mean, standard deviation] }
//! "KEY" = { lognormal = [median, standard deviation of the natural logarithm] }
//! "KEY" = { uniform = [low, high] }
//! ```
//!
//! A key of a single number by its dotted path, or one of [`Recorded`], which say how a recording lies to the model. The keys
//! are independent of each other but for their [`correlation`](super::Dependence). A scene computes the same with the section and without: only ensembles draw from it.

use std::collections::BTreeMap;

use statrs::distribution::{ContinuousCDF as _, LogNormal, Normal, Uniform};
use toml::de::{DeTable, DeValue};

use super::section::{Scope, Section};
use super::values::Values;
use super::{Key, Kind, Range, SceneError, Value, keys};

/// Name of the section.
pub(super) const SECTION: &str = "uncertainty";
/// What a key's entry has to be.
const NEEDED: &str = "one distribution is needed: { normal = [mean, standard deviation] }, { lognormal = [median, standard deviation of the \
                      logarithm] } or { uniform = [low, high] }";

/// A prior distribution of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prior {
    /// Mean and standard deviation.
    Normal(f64, f64),
    /// Median, and standard deviation of the natural logarithm.
    Lognormal(f64, f64),
    /// Lower and upper end.
    Uniform(f64, f64),
}

impl Prior {
    /// Words of the distributions, as a file has them.
    pub(crate) const WORDS: [&'static str; 3] = ["normal", "lognormal", "uniform"];

    /// The distribution of a word and two numbers; what is wrong with them, if anything.
    fn new(word: &str, numbers: &[f64]) -> Result<Self, String> {
        let meaning = match word {
            "normal" => "[mean, standard deviation], the latter above 0",
            "lognormal" => "[median, standard deviation of the logarithm], both above 0",
            "uniform" => "[low, high], the first below the second",
            _ => return Err(format!("no distribution; there are {}", Self::WORDS.join(", "))),
        };
        let prior = match (word, numbers) {
            ("normal", &[mean, deviation]) if deviation > 0.0 => Some(Self::Normal(mean, deviation)),
            ("lognormal", &[median, deviation]) if median > 0.0 && deviation > 0.0 => {
                Some(Self::Lognormal(median, deviation))
            }
            ("uniform", &[low, high]) if low < high => Some(Self::Uniform(low, high)),
            _ => None,
        };
        prior.filter(|_| numbers.iter().all(|x| x.is_finite())).ok_or_else(|| format!("{word} takes {meaning}"))
    }

    /// Its word.
    #[must_use]
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Normal(..) => Self::WORDS[0],
            Self::Lognormal(..) => Self::WORDS[1],
            Self::Uniform(..) => Self::WORDS[2],
        }
    }

    /// Its two numbers, as a file has them.
    #[must_use]
    pub(crate) const fn numbers(&self) -> [f64; 2] {
        match *self {
            Self::Normal(a, b) | Self::Lognormal(a, b) | Self::Uniform(a, b) => [a, b],
        }
    }

    /// The value below which a share of the probability lies, 0 < `share` < 1.
    #[must_use]
    pub(crate) fn quantile(&self, share: f64) -> f64 {
        // the numbers were checked, so that there is always a distribution
        match *self {
            Self::Normal(mean, deviation) => Normal::new(mean, deviation).map_or(mean, |d| d.inverse_cdf(share)),
            Self::Lognormal(median, deviation) => {
                LogNormal::new(median.ln(), deviation).map_or(median, |d| d.inverse_cdf(share))
            }
            Self::Uniform(low, high) => Uniform::new(low, high).map_or(low, |d| d.inverse_cdf(share)),
        }
    }

    /// Its mean.
    #[must_use]
    pub fn mean(&self) -> f64 {
        match *self {
            Self::Normal(mean, _) => mean,
            Self::Lognormal(median, deviation) => median * (0.5 * deviation * deviation).exp(),
            Self::Uniform(low, high) => 0.5 * (low + high),
        }
    }

    /// Its standard deviation.
    #[must_use]
    pub fn standard_deviation(&self) -> f64 {
        match *self {
            Self::Normal(_, deviation) => deviation,
            Self::Lognormal(_, deviation) => self.mean() * (deviation * deviation).exp_m1().sqrt(),
            Self::Uniform(low, high) => (high - low) / 12f64.sqrt(),
        }
    }
}

/// As a file has it.
impl std::fmt::Display for Prior {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{{ {} = {} }}", self.word(), Value::from(self.numbers().to_vec()))
    }
}

/// How a recording lies to the model; keys of no part of the physics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recorded {
    /// Recorded depth at which the instrument touches the sample, m.
    ContactDepth,
    /// How late the force's stamps are against the position's, s.
    TimeOffset,
    /// What the load cell reads without load, N.
    ForceZero,
}

impl Recorded {
    /// Paths, with the range of each in its unit.
    pub const KEYS: [(&'static str, Self, Range); 3] = [
        ("align.contact_depth_m", Self::ContactDepth, Range::closed(-0.1, 0.1)),
        ("align.time_offset_s", Self::TimeOffset, Range::closed(-1e3, 1e3)),
        ("align.force_zero_n", Self::ForceZero, Range::closed(-1e4, 1e4)),
    ];

    /// The one of a path.
    #[must_use]
    pub fn of(path: &str) -> Option<Self> {
        Self::KEYS.iter().find(|(known, ..)| *known == path).map(|(_, recorded, _)| *recorded)
    }
}

/// A key whose value is not known for sure.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertain {
    /// Dotted path.
    pub key: String,
    /// What is believed of it.
    pub prior: Prior,
    /// Correlation with other keys, by their paths: see [`Dependence`](super::Dependence).
    pub correlation: BTreeMap<String, f64>,
}

/// As a file has it.
impl std::fmt::Display for Uncertain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let list: Vec<String> =
            self.correlation.iter().map(|(other, r)| format!("\"{other}\" = {}", Value::from(*r))).collect();
        let numbers = Value::from(self.prior.numbers().to_vec());
        match list.is_empty() {
            true => write!(f, "{}", self.prior),
            false => {
                write!(f, "{{ {} = {numbers}, {} = {{ {} }} }}", self.prior.word(), CORRELATION, list.join(", "))
            }
        }
    }
}

impl Uncertain {
    /// A key with the distribution of a word and two numbers. `place` says where it was written.
    ///
    /// # Errors
    /// [`SceneError`] for a key that is not known or can't be uncertain, and for wrong numbers.
    pub(crate) fn new(path: &str, word: &str, numbers: &[f64], place: &str) -> Result<Self, SceneError> {
        let shown = format!("{{ {word} = {} }}", Value::from(numbers.to_vec()));
        let refuse = |reason: String| inconsistent(path, &shown, place, reason);
        let (range, allowed) = range_of(path, &shown, place)?;
        let prior = Prior::new(word, numbers).map_err(refuse)?;
        let ends = if let Prior::Uniform(low, high) = prior { [low, high] } else { [prior.quantile(0.5); 2] };
        match ends.iter().find(|end| !range.contains(**end)) {
            Some(end) => Err(SceneError::OutOfRange {
                place: place.to_owned(),
                key: format!("{SECTION}.{path}"),
                value: Value::from(*end).to_string(),
                allowed,
            }),
            None => Ok(Self { key: path.to_owned(), prior, correlation: BTreeMap::new() }),
        }
    }

    /// The value below which a share of the probability lies. `place` says which draw it is for.
    ///
    /// # Errors
    /// [`SceneError::OutOfRange`] where the key can't have it.
    pub fn draw(&self, share: f64, place: &str) -> Result<f64, SceneError> {
        let value = self.prior.quantile(share);
        let (range, allowed) = range_of(&self.key, &self.prior.to_string(), place)?;
        if range.contains(value) {
            return Ok(value);
        }
        Err(SceneError::OutOfRange {
            place: place.to_owned(),
            key: self.key.clone(),
            value: Value::from(value).to_string(),
            allowed: format!("{allowed}. It was drawn from {}: choose a narrower one, or uniform", self.prior),
        })
    }
}

pub(super) fn inconsistent(path: &str, value: &str, place: &str, reason: String) -> SceneError {
    SceneError::Inconsistent {
        place: place.to_owned(),
        key: format!("{SECTION}.{path}"),
        value: value.to_owned(),
        reason,
    }
}

/// The range of a key that can be uncertain, and the same in words.
fn range_of(path: &str, value: &str, place: &str) -> Result<(Range, String), SceneError> {
    if let Some((.., range)) = Recorded::KEYS.iter().find(|(known, ..)| *known == path) {
        return Ok((*range, format!("number in {range}")));
    }
    let refuse = |reason: String| Err(inconsistent(path, value, place, reason));
    if path.starts_with("align.") {
        return refuse(format!("no such key; there are {}", Recorded::KEYS.map(|(known, ..)| known).join(", ")));
    }
    if path.starts_with("motion.") {
        return refuse("the motion is given: all members make the same one".to_owned());
    }
    let key = keys::require(path, value, place)?;
    match key.kind {
        Kind::Real(range) => Ok((range, key.allowed())),
        _ => refuse(format!("only a single number can be uncertain; this is: {}", key.allowed())),
    }
}

/// Word of a key's correlations.
pub(super) const CORRELATION: &str = "correlation";

/// Correlations of a key, as a file has them: paths of other keys and numbers, or what is wrong with them.
fn correlations(table: &DeTable<'_>) -> Result<BTreeMap<String, f64>, String> {
    let mut found = BTreeMap::new();
    for (name, value) in table {
        let name = name.get_ref();
        let number: f64 = match value.get_ref() {
            DeValue::Float(digits) => digits.as_str().parse().ok(),
            DeValue::Integer(digits) => digits.as_str().parse().ok(),
            DeValue::Table(inner) => {
                found.extend(correlations(inner)?.into_iter().map(|(key, r)| (format!("{name}.{key}"), r)));
                continue;
            }
            _ => None,
        }
        .unwrap_or(f64::NAN);
        if !(-1.0 < number && number < 1.0) {
            return Err(format!("a correlation is a number above -1 and below 1; that with {name} is not"));
        }
        found.insert(name.to_string(), number);
    }
    Ok(found)
}

/// Reads the distributions of a table, in which `"material.density"` and `material.density` are the same key; `shown` is how the
/// file has it.
pub(super) fn read(path: &str, value: &DeValue<'_>, shown: &str, place: &str) -> Result<Vec<Uncertain>, SceneError> {
    let wrong = |path: &str| inconsistent(path, shown, place, NEEDED.to_owned());
    let DeValue::Table(table) = value else { return Err(wrong(path)) };
    let mut found = Vec::new();
    // a distribution, with correlations or without
    let mut correlation = BTreeMap::new();
    let mut entries: Vec<_> = table.iter().collect();
    if let [a, b] = entries[..]
        && let Some((_, linked)) = [a, b].into_iter().find(|(name, _)| name.get_ref() == CORRELATION)
        && let DeValue::Table(linked) = linked.get_ref()
        && [a, b].iter().any(|(_, value)| value.get_ref().is_array())
    {
        correlation = correlations(linked).map_err(|reason| inconsistent(path, shown, place, reason))?;
        entries.retain(|(name, _)| name.get_ref() != CORRELATION);
    }
    let alone = entries.len() == 1;
    for (name, inner) in entries {
        let name = name.get_ref();
        match inner.get_ref() {
            DeValue::Table(_) => found.extend(read(&format!("{path}.{name}"), inner.get_ref(), shown, place)?),
            DeValue::Array(list) if alone => {
                let number = |x: &toml::Spanned<DeValue<'_>>| match x.get_ref() {
                    DeValue::Float(digits) => digits.as_str().parse().ok(),
                    DeValue::Integer(digits) => digits.as_str().parse().ok(),
                    _ => None,
                };
                let numbers: Vec<f64> = list.iter().map(|x| number(x).unwrap_or(f64::NAN)).collect();
                found.push(Uncertain {
                    correlation: correlation.clone(),
                    ..Uncertain::new(path, name, &numbers, place)?
                });
            }
            _ => return Err(wrong(path)),
        }
    }
    Ok(found)
}

/// Reads the distribution that a user wrote after `--set uncertainty.KEY=`.
pub(super) fn parse(path: &str, text: &str, place: &str) -> Result<Uncertain, SceneError> {
    let path = path.trim_matches(['"', '\'']);
    let wrong = || inconsistent(path, text, place, NEEDED.to_owned());
    let line = format!("x = {}", text.trim());
    let table = DeTable::parse(&line).map_err(|_| wrong())?;
    let value = table.get_ref().iter().next().map(|(_, value)| value.get_ref()).ok_or_else(wrong)?;
    let mut found = read(path, value, text, place)?;
    match (found.pop(), found.is_empty()) {
        (Some(one), true) => Ok(one),
        _ => Err(wrong()),
    }
}

impl Section for Vec<Uncertain> {
    fn keys() -> Vec<Key> {
        Vec::new()
    }

    fn read(values: &Values, _: Scope<'_>) -> Result<Self, SceneError> {
        Ok(values.priors().to_vec())
    }

    fn write(&self, values: &mut Values, _: Scope<'_>) {
        self.iter().for_each(|one| values.put_prior(one.clone()));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_have_the_mean_and_deviation_that_are_said() {
        for prior in [Prior::Normal(-2.0, 0.5), Prior::Lognormal(1678.0, 0.3), Prior::Uniform(0.2, 0.6)] {
            let n = 20_000;
            let values: Vec<f64> = (0..n).map(|i| prior.quantile((f64::from(i) + 0.5) / f64::from(n))).collect();
            let mean = values.iter().sum::<f64>() / f64::from(n);
            let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n);
            assert!((mean / prior.mean() - 1.0).abs() < 1e-4, "{prior}: {mean}");
            assert!((variance.sqrt() / prior.standard_deviation() - 1.0).abs() < 1e-3, "{prior}: {variance}");
        }
        assert!((Prior::Normal(0.0, 1.0).quantile(0.975) - 1.959_963_984_540_054).abs() < 1e-9);
        assert!((Prior::Lognormal(3.0, 0.7).quantile(0.5) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_distribution_needs_numbers_that_make_one() {
        let of = |word: &str, numbers: &[f64]| Uncertain::new("material.density_kg_per_m3", word, numbers, "here");
        assert!(of("normal", &[970.0, 10.0]).is_ok());
        for (word, numbers) in [
            ("normal", &[970.0][..]),
            ("normal", &[970.0, 0.0]),
            ("normal", &[f64::NAN, 1.0]),
            ("normal", &[970.0, f64::INFINITY]),
            ("lognormal", &[-1.0, 0.1]),
            ("uniform", &[980.0, 970.0]),
            ("gamma", &[1.0, 2.0]),
            ("uniform", &[-5.0, 970.0]),
            ("normal", &[-970.0, 10.0]),
        ] {
            let error = of(word, numbers).unwrap_err().to_string();
            assert!(error.starts_with("here: uncertainty.material.density_kg_per_m3"), "{error}");
        }
    }
}
