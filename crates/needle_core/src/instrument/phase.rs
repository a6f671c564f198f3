//! Phases of the interaction between instrument and tissue, and what happens between them.

/// Phase of the interaction between instrument and tissue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The instrument is above the sample.
    Approach,
    /// In contact, surface not punctured (plate and indenter stay here).
    Indentation,
    /// The needle is inside and advances or rests.
    Penetration,
    /// The needle is being withdrawn.
    Retraction,
}

impl Phase {
    /// The word used in files and messages.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Approach => "approach",
            Self::Indentation => "indentation",
            Self::Penetration => "penetration",
            Self::Retraction => "retraction",
        }
    }
}

/// Something that happened between two poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The surface, or a membrane within, was punctured at this depth, m.
    Puncture {
        /// Tip depth at puncture, m.
        depth_m: f64,
        /// What the tip came into: 0 for what lies in no region, otherwise one more than the region's place in the scene.
        region: u8,
    },
    /// A frictional needle came into a region that no membrane closes.
    Entered {
        /// Tip depth, m.
        depth_m: f64,
        /// As of a puncture.
        region: u8,
    },
    /// The whole shaft of a frictional needle began to slip along the tissue, after it had stuck or slipped the other way.
    Slip {
        /// Tip depth, m.
        depth_m: f64,
        /// Where the tip is, as of a puncture.
        region: u8,
    },
}

impl Event {
    /// The word used in files and messages: `puncture`, `layer`, `slip`.
    #[must_use]
    pub const fn kind(self) -> &'static str {
        match self {
            Self::Puncture { .. } => "puncture",
            Self::Entered { .. } => "layer",
            Self::Slip { .. } => "slip",
        }
    }

    /// Tip depth, m.
    #[must_use]
    pub const fn depth_m(self) -> f64 {
        match self {
            Self::Puncture { depth_m, .. } | Self::Entered { depth_m, .. } | Self::Slip { depth_m, .. } => depth_m,
        }
    }

    /// Region: 0 for what lies in none of the scene's, otherwise one more than its place there.
    #[must_use]
    pub const fn region(self) -> u8 {
        match self {
            Self::Puncture { region, .. } | Self::Entered { region, .. } | Self::Slip { region, .. } => region,
        }
    }

    /// Depth of a puncture, m.
    #[must_use]
    pub const fn puncture_depth(self) -> Option<f64> {
        match self {
            Self::Puncture { depth_m, .. } => Some(depth_m),
            Self::Entered { .. } | Self::Slip { .. } => None,
        }
    }
}
