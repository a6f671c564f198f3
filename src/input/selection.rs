//! What of a recording is the depth, what the force, and what their numbers mean.

use super::TopicNames;
use super::unit::Dimension;

/// A recorded quantity: where it stands, and what its numbers mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quantity {
    /// Topic (`/load_cell`, `/daq[3]` for an element of an array), or column of a table by its header or by its number from 1.
    /// `None`: the one that stands out.
    pub place: Option<String>,
    /// Unit; `None`: as the header of the column says, SI of a topic.
    pub unit: Option<String>,
    /// The number rises as the depth falls, or is the force on the tissue.
    pub reversed: bool,
}

impl Quantity {
    /// Whether the recording's own numbers are taken as they are.
    #[must_use]
    pub const fn is_plain(&self) -> bool {
        self.place.is_none() && self.unit.is_none() && !self.reversed
    }

    /// +1 or -1.
    #[must_use]
    pub const fn sign(&self) -> f64 {
        if self.reversed { -1.0 } else { 1.0 }
    }

    /// Size of the unit of a topic's numbers with the sign, m or N.
    pub(super) fn scale(&self, dimension: Dimension, option: &'static str) -> Result<f64, UnknownUnit> {
        let unit = self.unit.as_deref().map_or(Ok(1.0), |text| {
            let unknown = || UnknownUnit { option, text: text.to_owned(), known: dimension.names() };
            dimension.unit(text).ok_or_else(unknown)
        });
        Ok(self.sign() * unit?)
    }
}

/// A unit that is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{option} {text}: known are {known}")]
pub struct UnknownUnit {
    /// Which option.
    pub option: &'static str,
    /// What it says.
    pub text: String,
    /// What it may say.
    pub known: String,
}

/// How the text of a table is laid out; what is not said is seen from the text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TableLayout {
    /// Between cells.
    pub separator: Option<char>,
    /// Numbers are written 0,5.
    pub decimal_comma: Option<bool>,
    /// Number of the line with the headers, from 1; 0: there are none.
    pub header_line: Option<usize>,
    /// What a line to be left out begins with.
    pub comment: Option<String>,
}

/// Everything that a user can say of a recording: of a bag and of a table alike.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Topics of this project's own types, joint and frame.
    pub names: TopicNames,
    /// The displacement sensor.
    pub position: Quantity,
    /// The load cell.
    pub force: Quantity,
    /// How late the force's stamps are against the position's, s: taken off them.
    pub time_offset_s: f64,
    /// Columns of time, one for all files or one for each.
    pub time: Vec<String>,
    /// Unit of the time.
    pub time_unit: Option<String>,
    /// Rows per second, of a table without time.
    pub rate_hz: Option<f64>,
    /// Columns of the tip's x, y and z in the sample's frame, in the position's unit.
    pub pose: Option<[String; 3]>,
    /// Columns of markers, x, y and z of each, in the position's unit.
    pub markers: Vec<String>,
    /// Length that a strain is a share of, m: the position is given as a strain.
    pub gauge_length_m: Option<f64>,
    /// How the text is laid out.
    pub layout: TableLayout,
}
