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
    /// The surface was punctured at this depth, m.
    Puncture {
        /// Tip depth at puncture, m.
        depth_m: f64,
    },
}
