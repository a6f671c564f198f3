//! Why a cloud has no approximation, with the place.

/// Why a shape table can't be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ApproximationError {
    /// No node's support reaches the point, however much it is enlarged.
    #[error(
        "the point ({:.6}, {:.6}, {:.6}) m lies outside the support of every node: raise discretisation.support_factor or \
         refine the cloud there", at[0], at[1], at[2]
    )]
    Uncovered {
        /// Where, m.
        at: [f64; 3],
    },
    /// The support nodes do not span the space.
    #[error(
        "singular moment matrix at point ({:.6}, {:.6}, {:.6}) m: its {nodes} support nodes lie in one {shape}, even with \
         larger supports: add nodes outside of it", at[0], at[1], at[2]
    )]
    Coplanar {
        /// Where, m.
        at: [f64; 3],
        /// How many nodes reach the point.
        nodes: usize,
        /// `plane` or, in a half plane, `line`.
        shape: &'static str,
    },
    /// The moment matrix is singular although the support nodes span the space: the basis asks for more of them.
    #[error(
        "singular moment matrix at point ({:.6}, {:.6}, {:.6}) m: its {nodes} support nodes do not determine the basis, even \
         with larger supports: refine the cloud there, take discretisation.penalty > 0, or discretisation.method = \
         \"mls\"", at[0], at[1], at[2]
    )]
    Singular {
        /// Where, m.
        at: [f64; 3],
        /// How many nodes reach the point.
        nodes: usize,
    },
    /// No correction of the gradients makes the sums those of the integrals.
    #[error(
        "the gradients can't be made consistent near ({:.6}, {:.6}, {:.6}) m: take discretisation.integration = \"plain\", or \
         refine the cloud there", at[0], at[1], at[2]
    )]
    Unbalanced {
        /// Where, m.
        at: [f64; 3],
    },
}

impl ApproximationError {
    /// Where, m.
    #[must_use]
    pub const fn at(&self) -> [f64; 3] {
        match self {
            Self::Uncovered { at }
            | Self::Coplanar { at, .. }
            | Self::Singular { at, .. }
            | Self::Unbalanced { at } => *at,
        }
    }
}
