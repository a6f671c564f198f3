//! Why a calibration finds nothing.

use needle_core::scene::SceneError;
use needle_core::twin::BuildError;

/// Why nothing was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A key isn't one, or a value isn't allowed.
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
    /// The scene as it is can't be built.
    #[error("scene {scene} can't be discretised: {source}")]
    Build {
        /// Its name.
        scene: String,
        /// Why.
        source: BuildError,
    },
    /// The scene as it is can't be run over the recorded motion.
    #[error("the scene diverges over the recorded motion: {0}. Start from other values with --set")]
    Diverged(String),
    /// Too little to fit.
    #[error("{readings} readings of the load cell fall on the motion, and {unknowns} unknowns need more: {remedy}")]
    TooFew {
        /// Readings with a measured force.
        readings: usize,
        /// Keys, offset and drift.
        unknowns: usize,
        /// What to do.
        remedy: &'static str,
    },
    /// The instrument never touches the sample.
    #[error("the part of the recording that is fitted has no contact: the force says nothing about the scene")]
    NoContact,
    /// A value that the table of curves does not hold.
    #[error("the scene's own values lie outside the bounds of the table: widen them, or begin within them")]
    OutsideTable,
    /// The user ended it.
    #[error("interrupted: nothing is written")]
    Interrupted,
}
