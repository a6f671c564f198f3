//! What is to be found from what.

use super::{CurveTable, HoldOut};
use needle_core::scene::Scene;
use needle_recording::{ForceSeries, Reading};

/// A key that is to be found, and between which values.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Dotted path.
    pub key: String,
    /// Least and largest value, in the key's unit; `None`: the key's own range.
    pub bounds: Option<[f64; 2]>,
}

impl Wanted {
    /// From `KEY` or `KEY=LOW..HIGH`.
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

/// What of the load cell is estimated alongside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadCell {
    /// Nothing: its readings are taken as they are.
    Exact,
    /// Reading without load.
    Offset,
    /// The same, and its change with time.
    Drift,
    /// The same, unless the recording can't tell the change with time from what is sought: then the reading without load alone.
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

/// What is to be found from what.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// The scene; its own values are where the search begins. What its `[align]` says is taken out of the recording already
    /// ([`needle_recording::Recording::aligned`]), and what is found is added to it.
    pub scene: &'a Scene,
    /// The recorded motion.
    pub readings: &'a [Reading],
    /// The recorded force.
    pub measured: &'a ForceSeries,
    /// The keys.
    pub wanted: &'a [Wanted],
    /// What of the load cell is estimated.
    pub load_cell: LoadCell,
    /// Relative standard uncertainty of the force, from errors of discretisation and load cell that no number of readings
    /// reduces.
    pub force_error: f64,
    /// Which part of the recording is fitted.
    pub part: HoldOut,
    /// Where the force is read in place of runs of the twin.
    pub table: Option<&'a CurveTable>,
}
