//! What is found of layers, and of what: readings, values with their errors, why a recording can't be evaluated.

/// Width of the intervals over which readings are averaged, in diameters.
pub(super) const PIECE: f64 = 0.025;
/// Height above the surface from which on readings are in air, in diameters.
pub(super) const AIR: f64 = 0.2;
/// Largest way, in diameters, that the tip of the first insertion counts as having pushed tissue ahead of it, so that less of the
/// shaft rubs than the depth says.
pub(super) const PUSHED: f64 = 4.0;

/// A value and its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Value.
    pub value: f64,
    /// Standard error.
    pub standard_error: f64,
}

/// Estimates for a layer; `None`: not determined by the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Depth of its upper boundary in undeformed tissue, m.
    pub from_depth_m: Option<Known>,
    /// Friction per length, N/m.
    pub friction_n_per_m: Known,
    /// Cutting force at the tip, N.
    pub cutting_force_n: Option<Known>,
    /// Puncture force at the layer's upper boundary, N; `None` also if no drop was seen.
    pub puncture_force_n: Option<Known>,
}

/// The force of the first insertion at a depth, and what of it is friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Depth, m.
    pub depth_m: f64,
    /// Reading less the zero, N.
    pub measured_n: f64,
    /// Friction along the shaft that was found, N.
    pub friction_n: f64,
    /// What the friction may exceed the reading by, N.
    pub allowed_n: f64,
}

impl Part {
    /// The rest, N: cutting, and tissue that the tip pushes ahead.
    #[must_use]
    pub fn at_the_tip_n(&self) -> f64 {
        self.measured_n - self.friction_n
    }
}

/// Result of the estimation.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Layers from the surface down.
    pub layers: Vec<Layer>,
    /// Quantities that can't be determined, each with the reason.
    pub cannot_tell: Vec<String>,
    /// Quantities that the first insertion and its retraction alone would not have determined.
    pub alone: Vec<String>,
    /// Root mean square residual of the friction's fit, N.
    pub rmse_n: f64,
    /// Depths of the drops of the first insertion, m.
    pub drops_m: Vec<f64>,
    /// What the force of the first insertion consists of, from the surface down.
    pub parts: Vec<Part>,
}

impl Found {
    /// Where the friction that was found exceeds the measured force most, if it does anywhere: it is then no friction
    /// of this recording.
    #[must_use]
    pub fn beyond(&self) -> Option<&Part> {
        let beyond = |p: &&Part| p.friction_n > p.measured_n + p.allowed_n;
        self.parts.iter().filter(beyond).min_by(|a, b| a.at_the_tip_n().total_cmp(&b.at_the_tip_n()))
    }
}

/// Why a recording can't be evaluated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LayersError {
    /// The scene's instrument is not a needle.
    #[error("the scene's instrument is no needle: name one with --scene")]
    NoNeedle,
    /// No retraction.
    #[error(
        "the recording has no way out after an insertion, and one insertion alone can't tell friction from cutting: record both, and a second"
    )]
    NoWayOut,
    /// No readings in air.
    #[error(
        "the recording has no readings above the surface, so the force's zero is not known: withdraw the needle out of it"
    )]
    NoAir,
    /// Too few readings.
    #[error("the recording has too few readings for {0} layers: fewer layers, or more readings")]
    Few(usize),
    /// The readings don't determine the friction's breakpoints.
    #[error("the readings don't determine the friction of {0} layers: try fewer")]
    Undetermined(usize),
}

/// A reading: time in s, depth in m, force against the insertion in N.
pub type Reading = [f64; 3];
