//! The one registry of scene keys.
//!
//! Parsing, validation, `--set`, error messages, `scene show --keys` and parameter descriptors all read [`KEYS`], which is
//! collected from the sections: a new key is a field of its section's struct, and nothing else.

use std::sync::LazyLock;

use super::key::{Key, Kind};
use super::section::Section as _;
use super::{Scene, SceneError};

/// Every key that a scene of this build can have, in the order in which a scene file is written. Paths of the sections in `LISTS` belong to each
/// of their elements: `targets.name` takes an index, `targets.0.name`, `materials.model` and `regions.shape` a name,
/// `materials.skin.model`.
pub static KEYS: LazyLock<Vec<Key>> = LazyLock::new(|| Scene::keys().into_iter().filter(Key::is_built).collect());

/// Keys that only a build with the feature `research` has. Their names are known, so that a scene with one is refused with the reason.
static NOT_BUILT: LazyLock<Vec<Key>> =
    LazyLock::new(|| Scene::keys().into_iter().filter(|key| !key.is_built()).collect());

/// Sections in the order in which a scene file is written.
pub static SECTIONS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let mut sections: Vec<_> = KEYS.iter().map(Key::section).filter(|section| !section.is_empty()).collect();
    sections.dedup();
    sections
});

/// Sections with several elements.
const LISTS: [&str; 3] = ["targets", "materials", "regions"];

/// Section, element and field of `SECTION.ELEMENT.FIELD` in one of the sections with several elements.
pub(super) fn split(path: &str) -> Option<(&str, &str, &str)> {
    let (section, rest) = path.split_once('.')?;
    let (element, field) = rest.split_once('.')?;
    let known = LISTS.contains(&section) && (section != "targets" || element.parse::<usize>().is_ok());
    known.then_some((section, element, field))
}

/// The path of a key of the registry beside another one's full path, in the same element.
pub(super) fn beside(path: &str, key: &str) -> String {
    match (split(path), key.rsplit_once('.')) {
        (Some((section, element, _)), Some((_, field))) => format!("{section}.{element}.{field}"),
        _ => key.to_owned(),
    }
}

/// The list and the place in it, from 0, of a path that names one of its numbers: `material.prony_shares[1]`.
pub fn element(path: &str) -> Option<(&str, usize)> {
    let (list, place) = path.strip_suffix(']')?.rsplit_once('[')?;
    Some((list, place.parse().ok()?))
}

/// The entry of a dotted path. A target's key takes the target's index, a material's and a region's its name:
/// `targets.0.name`, `regions.skin.shape`. That of a list is also the one of each of its numbers: `material.prony_shares[1]`.
#[must_use]
pub fn find(path: &str) -> Option<&'static Key> {
    if let Some((list, _)) = element(path) {
        return find(list).filter(|key| matches!(key.kind, Kind::List(..)));
    }
    match split(path) {
        Some((section, _, field)) => KEYS.iter().find(|key| key.section() == section && key.field() == field),
        None => KEYS.iter().chain(NOT_BUILT.iter()).find(|key| !LISTS.contains(&key.section()) && key.path == path),
    }
}

/// The known entry whose path is most like an unknown one, unless none is like it at all.
#[must_use]
pub fn nearest(path: &str) -> Option<&'static Key> {
    let plain = match split(path) {
        Some((section, _, field)) => format!("{section}.{field}"),
        None => path.to_owned(),
    };
    let of_materials = plain.starts_with("materials.");
    KEYS.iter()
        .filter(|key| of_materials || key.section() != "materials")
        .map(|key| (likeness(&plain, key.path), key))
        .filter(|(score, _)| *score > 0.6)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, key)| key)
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
