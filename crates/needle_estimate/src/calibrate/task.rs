//! The input of a calibration.

use super::wanted::Wanted;
use super::{CurveTable, HoldOut};
use needle_core::scene::Scene;
use needle_recording::{ForceSeries, Reading};

/// Which parameters of the load cell are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadCell {
    /// None: its readings are taken as exact.
    Exact,
    /// The reading without load.
    Offset,
    /// The reading without load, and its change with time.
    Drift,
    /// As [`LoadCell::Drift`], unless the recording can't distinguish the drift from the unknowns. Then only the
    /// reading without load.
    Auto,
}

impl LoadCell {
    /// How many of drift and zero are known.
    pub(super) const fn known(self) -> usize {
        match self {
            Self::Drift | Self::Auto => 0,
            Self::Offset => 1,
            Self::Exact => 2,
        }
    }
}

/// The input of a calibration.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// The scene; its values are the start of the search. The recording must already be corrected by the scene's
    /// `[align]` ([`needle_recording::Recording::aligned`]); further corrections found are added to it.
    pub scene: &'a Scene,
    /// The recorded motion.
    pub readings: &'a [Reading],
    /// The recorded force.
    pub measured: &'a ForceSeries,
    /// The keys to identify.
    pub wanted: &'a [Wanted],
    /// Which parameters of the load cell are estimated.
    pub load_cell: LoadCell,
    /// Relative standard uncertainty of the force, from errors of discretisation and load cell that no number of
    /// readings reduces.
    pub force_error: f64,
    /// Which part of the recording is fitted.
    pub part: HoldOut,
    /// Table that replaces runs of the twin.
    pub table: Option<&'a CurveTable>,
}
