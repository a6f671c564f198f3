//! The one registry of scene keys.
//!
//! Parsing, validation, `--set`, error messages, `scene show --keys` and parameter descriptors all read [`KEYS`], which is
//! collected from the sections: a new key is a field of its section's struct, and nothing else.

use std::sync::LazyLock;

use super::section::Section as _;
use super::{Scene, SceneError, key::Key};

/// Every key of a scene, in the order in which a scene file is written. Paths that start with `targets.`
/// belong to each element of the list `[[targets]]` and take an index there: `targets.0.name`.
pub static KEYS: LazyLock<Vec<Key>> = LazyLock::new(Scene::keys);

/// Sections in the order in which a scene file is written.
pub static SECTIONS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let mut sections: Vec<_> = KEYS.iter().map(Key::section).filter(|section| !section.is_empty()).collect();
    sections.dedup();
    sections
});

/// The entry of a dotted path. A target's key takes the target's index: `targets.0.name`.
#[must_use]
pub fn find(path: &str) -> Option<&'static Key> {
    match split_target(path) {
        Some((_, field)) => KEYS.iter().find(|key| key.section() == "targets" && key.field() == field),
        None => KEYS.iter().find(|key| key.section() != "targets" && key.path == path),
    }
}

/// The known entry whose path is most like an unknown one, unless none is like it at all.
#[must_use]
pub fn nearest(path: &str) -> Option<&'static Key> {
    let plain = match split_target(path) {
        Some((_, field)) => format!("targets.{field}"),
        None => path.to_owned(),
    };
    KEYS.iter()
        .map(|key| (likeness(&plain, key.path), key))
        .filter(|(score, _)| *score > 0.6)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, key)| key)
}

/// The word of a list that is most like an unknown one, unless none is like it at all.
#[must_use]
pub fn nearest_word<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    words
        .iter()
        .map(|known| (strsim::jaro_winkler(word, known), *known))
        .filter(|(score, _)| *score > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

/// Likeness of two dotted paths in [0, 1]. A right last part in the wrong section counts nearly as much as the
/// right path, since that is the common mistake; so does a last part without its unit.
fn likeness(path: &str, known: &str) -> f64 {
    let whole = strsim::normalized_damerau_levenshtein(path, known);
    let (last, known_last) = (last_part(path), last_part(known));
    let part = strsim::normalized_damerau_levenshtein(last, known_last);
    let without_unit = if last.len() > 3 && known_last.starts_with(last) { 0.9 } else { 0.0 };
    whole.max(0.95 * part).max(without_unit)
}

fn last_part(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

/// Index and field of `targets.INDEX.FIELD`.
pub(super) fn split_target(path: &str) -> Option<(usize, &str)> {
    let (index, field) = path.strip_prefix("targets.")?.split_once('.')?;
    Some((index.parse().ok()?, field))
}

/// The entry of a path that must be known; `value` is what the message shows.
///
/// # Errors
/// [`SceneError::UnknownKey`], with the nearest known key.
pub fn require(path: &str, value: &str, place: &str) -> Result<&'static Key, SceneError> {
    find(path).ok_or_else(|| SceneError::UnknownKey {
        place: place.to_owned(),
        key: path.to_owned(),
        value: value.to_owned(),
        hint: match nearest(path) {
            Some(key) => format!("the nearest known key is {} ({})", key.shown_path(), key.allowed()),
            None => "`needle_twin scene show --keys` lists every key".to_owned(),
        },
    })
}
