//! What can be wrong with a wanted or an imported cloud.

use crate::vector::Point;

/// Why a cloud was refused: what, where, and what to do about it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CloudError {
    /// A number of the domain, the spacing or a feature is outside its range.
    #[error("{key} = {value} is out of range: {rule}")]
    OutOfRange {
        /// Name of the quantity, close to the scene's key.
        key: &'static str,
        /// The value given.
        value: f64,
        /// What is allowed, and what to change.
        rule: String,
    },
    /// The spacing asks for more nodes than the limit.
    #[error(
        "a finest spacing of {finest} m ({far} m far from every edge) needs about {nodes:.2e} nodes, {cells:.2e} cells and {gigabytes:.3} GB of memory; the limit is {limit} nodes: use a larger spacing, or let it grow faster"
    )]
    TooManyNodes {
        /// Smallest spacing in metres.
        finest: f64,
        /// Spacing far from every feature in metres.
        far: f64,
        /// Predicted number of nodes.
        nodes: f64,
        /// Predicted number of cells.
        cells: f64,
        /// Predicted memory of cloud and solver tables in 10^9 bytes.
        gigabytes: f64,
        /// Largest allowed number of nodes.
        limit: usize,
    },
    /// The generator could not make a valid triangulation (features too close for the spacing).
    #[error("the points could not be joined into cells: {reason}; use a smaller spacing near that place")]
    NotMeshable {
        /// What failed, and where.
        reason: String,
    },
    /// A cloud (imported, say) breaks a rule of [`crate::check`].
    #[error("cloud refused: {0}")]
    Invalid(#[from] crate::check::Fault),
}

impl CloudError {
    /// Nodes at `p` and `q` that edges or features ask for, closer to each other than the spacing h there allows.
    pub(crate) fn too_close(p: Point, q: Point, h: f64) -> Self {
        let [p, q] = [p, q].map(|[x, y, z]| format!("({:.3}, {:.3}, {:.3}) mm", 1e3 * x, 1e3 * y, 1e3 * z));
        let reason = format!(
            "edges or features ask for nodes at {p} and {q}, less than half of the spacing of {:.3} mm apart",
            1e3 * h
        );
        Self::NotMeshable { reason }
    }
}
