//! Why an ensemble can't be made.

use super::points::MOST;
use needle_core::scene::SceneError;

/// Why an ensemble can't be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnsembleError {
    /// The scene has no uncertain key.
    #[error(
        "scene {scene} says of no key how uncertain it is. Give --set 'uncertainty.{key}={{normal=[{mean}, {deviation}]}}' (mean and standard \
         deviation; lognormal and uniform are there too), or add a section [uncertainty] to the scene with \"{key}\" = {{ normal = [{mean}, \
         {deviation}] }}"
    )]
    NoUncertainty {
        /// Its name.
        scene: String,
        /// An example of a key.
        key: &'static str,
        /// Its value.
        mean: f64,
        /// A tenth of the value.
        deviation: f64,
    },
    /// An invalid number of members.
    #[error("{0} members: at least 2 are needed and at most {MOST} can be drawn")]
    Count(usize),
    /// More keys than a point has dimensions.
    #[error("{0} uncertain keys are more than can be drawn")]
    Keys(usize),
    /// Sobol's indices are not defined for correlated keys.
    #[error(
        "uncertainty.{0} has a correlation: Sobol's indices are shares of independent keys. Take `correlation` out (--set \
         'uncertainty.{0}={{...}}' replaces the entry)"
    )]
    Dependent(String),
    /// A draw is not a valid value of its key, or the values contradict each other.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A key that applies to finished recordings only.
    #[error("{0} can't be uncertain while the twin runs live: take it out of [uncertainty]")]
    NotLive(&'static str),
    /// The threads can't be started.
    #[error("can't start a thread of an ensemble: {0}; give fewer with --threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}
