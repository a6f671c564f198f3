//! The input of a calibration.

use super::{CurveTable, HoldOut};
use needle_core::scene::Scene;
use needle_recording::{ForceSeries, Reading};

/// A key to identify, with bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Dotted path.
    pub key: String,
    /// Least and largest value, in the key's unit; `None`: the key's own range.
    pub bounds: Option<[f64; 2]>,
}

impl Wanted {
    /// Parses `KEY` or `KEY=LOW..HIGH`.
    ///
    /// # Errors
    /// What is wrong with the bounds.
    pub fn parse(text: &str) -> Result<Self, String> {
        let Some((key, bounds)) = text.split_once('=') else {
            return Ok(Self { key: text.trim().to_owned(), bounds: None });
        };
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        let both = bounds.split_once("..").and_then(|(low, high)| Some([number(low)?, number(high)?]));
        let bounds = both.ok_or_else(|| "bounds are two numbers, as in KEY=0.2..0.8".to_owned())?;
        Ok(Self { key: key.trim().to_owned(), bounds: Some(bounds) })
    }
}

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
