//! Why a study of accuracy has no result.

use needle_core::scene::SceneError;
use needle_core::twin::BuildError;

/// Why a case can't be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The scene has no reference solution.
    #[error(
        "there is no reference solution of {0}; the presets compression, indentation and needle_insertion have one"
    )]
    NoReference(String),
    /// The scene reads its cloud from a file, so there is no spacing to change.
    #[error("scene {0} has no discretisation.spacing_m to change: its cloud comes from a mesh file")]
    NoCloud(String),
    /// The scene has no motion.
    #[error("scene {0} has no [motion] of its own (motion.depth_m, motion.speed_m_per_s, motion.pose_hz)")]
    NoMotion(String),
    /// The scene's own fine model gives no forces to compare with.
    #[error("the own model of scene {0} on a fine cloud did not come through, so there is nothing to compare with")]
    NoYardstick(String),
    /// The run of the scene's own fine model ended early.
    #[error("scene {scene}: its own model on a fine cloud ended {why}, so there is nothing to compare with")]
    Lost {
        /// The scene.
        scene: String,
        /// Where and why.
        why: String,
    },
    /// The scene is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It can't be discretised.
    #[error("{0}")]
    Build(#[from] BuildError),
    /// A table of rows can't be read or written.
    #[error("{}: {reason}", .path.display())]
    Table {
        /// The file.
        path: std::path::PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// No discretisation meets the requirements.
    #[error("{0}")]
    Untuned(String),
}
