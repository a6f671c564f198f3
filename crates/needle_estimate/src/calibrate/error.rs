//! Why a calibration has no result.

use needle_core::scene::SceneError;
use needle_core::twin::BuildError;

/// Why a calibration has no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A key does not exist, or a value is not allowed.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A key that can't be searched for.
    #[error("--fit {key}: {reason}")]
    Key {
        /// The key.
        key: String,
        /// What is wrong with it, and what to do.
        reason: String,
    },
    /// The scene can't be built with its own values.
    #[error("scene {scene} can't be discretised: {source}")]
    Build {
        /// Its name.
        scene: String,
        /// Why.
        source: BuildError,
    },
    /// The scene diverges over the recorded motion with its own values.
    #[error("the scene diverges over the recorded motion: {0}. Start from other values with --set")]
    Diverged(String),
    /// Too few readings to fit.
    #[error("{readings} readings of the load cell fall on the motion, and {unknowns} unknowns need more: {remedy}")]
    TooFew {
        /// Readings with a measured force.
        readings: usize,
        /// Number of unknowns: keys, offset and drift.
        unknowns: usize,
        /// What to do.
        remedy: &'static str,
    },
    /// The instrument never touches the sample.
    #[error("the part of the recording that is fitted has no contact: the force says nothing about the scene")]
    NoContact,
    /// A value outside the table of curves.
    #[error("the scene's own values lie outside the bounds of the table: widen them, or begin within them")]
    OutsideTable,
    /// The user interrupted the search.
    #[error("interrupted: nothing is written")]
    Interrupted,
}
