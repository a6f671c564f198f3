//! Why there is no ensemble.

use super::points::MOST;
use needle_core::scene::SceneError;

/// Why an ensemble can't be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnsembleError {
    /// Nothing is uncertain.
    #[error(
        "scene {scene} says of no key how uncertain it is. Give --set 'uncertainty.{key}={{normal=[{mean}, {deviation}]}}' (mean and standard \
         deviation; lognormal and uniform are there too), or add a section [uncertainty] to the scene with \"{key}\" = {{ normal = [{mean}, \
         {deviation}] }}"
    )]
    NoUncertainty {
        /// Its name.
        scene: String,
        /// A key that it has.
        key: &'static str,
        /// Its value.
        mean: f64,
        /// A tenth of it.
        deviation: f64,
    },
    /// A number of members that can't be had.
    #[error("{0} members: at least 2 are needed and at most {MOST} can be drawn")]
    Count(usize),
    /// More keys than a point has dimensions.
    #[error("{0} uncertain keys are more than can be drawn")]
    Keys(usize),
    /// Variance can't be shared out among keys that depend on each other.
    #[error(
        "uncertainty.{0} has a correlation: Sobol's indices are shares of independent keys. Take `correlation` out (--set \
         'uncertainty.{0}={{...}}' replaces the entry)"
    )]
    Dependent(String),
    /// A draw is no value of its key, or the values don't fit together.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A key that only a finished recording has.
    #[error("{0} can't be uncertain while the twin runs live: take it out of [uncertainty]")]
    NotLive(&'static str),
    /// The threads can't be started.
    #[error("can't start a thread of an ensemble: {0}; give fewer with --threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}
