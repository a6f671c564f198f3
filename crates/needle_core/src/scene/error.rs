//! What can be wrong with a scene. Each message names where, which key, which value, what is allowed and what to do.

/// Why a scene is refused. `place` is `file:line`, `--set` or the like.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A scene file can't be read.
    #[error("{}: {reason}", .path.display())]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The text is not TOML.
    #[error("{place}: not TOML: {message}{excerpt}")]
    Syntax {
        /// Where.
        place: String,
        /// What the parser says.
        message: String,
        /// The line itself.
        excerpt: String,
    },
    /// A key that no scene has.
    #[error("{place}: unknown key {key} (value {value}); {hint}")]
    UnknownKey {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// The nearest known key.
        hint: String,
    },
    /// A value of the wrong type.
    #[error("{place}: {key} = {value} is {found}; allowed: {allowed}")]
    WrongType {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// What it is.
        found: &'static str,
        /// What it should be.
        allowed: String,
    },
    /// A number outside its range.
    #[error("{place}: {key} = {value} is out of range; allowed: {allowed}")]
    OutOfRange {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// The range, and why where that isn't plain.
        allowed: String,
    },
    /// A word that isn't one of the key's.
    #[error("{place}: {key} = \"{value}\" is not known; allowed: {allowed}")]
    UnknownWord {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// The word.
        value: String,
        /// The known words, and the nearest.
        allowed: String,
    },
    /// A required key is absent.
    #[error("{place}: {key} is missing; allowed: {allowed}{because}")]
    Missing {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its values.
        allowed: String,
        /// What makes it required.
        because: String,
    },
    /// A key that doesn't go with another one's word.
    #[error("{place}: {key} = {value} doesn't apply: {reason}")]
    DoesNotApply {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// The key that selects, its word, and the words with which this one would make sense.
        reason: String,
    },
    /// Two values that contradict each other.
    #[error("{place}: {key} = {value}: {reason}")]
    Inconsistent {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// What it contradicts, and what is allowed.
        reason: String,
    },
    /// A key or word of a build with the feature `research`, which this one is not.
    #[error(
        "{place}: {key} = {value} is for research and not part of this build: build with `--features research`, or leave it out ({description})"
    )]
    Research {
        /// Where.
        place: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// What the key means.
        description: String,
    },
    /// `--set` without `=`.
    #[error("{place}: \"{text}\" is not of the form key=value (as in --set material.poisson_ratio=0.49)")]
    NotAnAssignment {
        /// Where.
        place: String,
        /// What was given.
        text: String,
    },
    /// No preset has this name.
    #[error("no preset is named \"{name}\"; presets: {known}{hint}")]
    UnknownPreset {
        /// The name.
        name: String,
        /// Those that exist.
        known: String,
        /// The nearest.
        hint: String,
    },
}
