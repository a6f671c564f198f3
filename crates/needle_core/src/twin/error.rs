//! Why a twin can't be built.

/// Why a scene can't be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The scene asks for something that this version can't do.
    #[error("{key}: {reason}")]
    Unsupported {
        /// The key at fault.
        key: &'static str,
        /// Why, and what to do.
        reason: &'static str,
    },
    /// The scene's mesh can't be used, or its parts don't fit it.
    #[error("{key}: {reason}")]
    Mesh {
        /// The key at fault.
        key: String,
        /// Why, and what to do.
        reason: String,
    },
    /// The cloud of nodes could not be made.
    #[error("cloud: {0}")]
    Cloud(String),
    /// The shape functions could not be made.
    #[error("shape functions: {0}")]
    Approximation(String),
}
