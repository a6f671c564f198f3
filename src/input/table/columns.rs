//! Which column is what, and in which unit.

use super::super::unit::Dimension;
use super::super::{Quantity, Selection};
use super::{TableError, layout::Layout};

/// A column that is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Place in a row, from 0.
    pub index: usize,
    /// Header, or the number from 1.
    pub name: String,
    /// The unit as it was written.
    pub unit: String,
    /// What one unit is, s, m or N, with the sign.
    pub scale: f64,
}

/// Columns that are taken of one table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// `None`: rows come at a rate.
    pub time: Option<Column>,
    /// Depth.
    pub position: Option<Column>,
    /// Force.
    pub force: Option<Column>,
    /// Tip.
    pub pose: Option<[Column; 3]>,
    /// Markers: x, y and z of each.
    pub markers: Vec<[Column; 3]>,
}

/// First words of headers that stand for a quantity.
const TIMES: [&str; 5] = ["time", "t", "elapsed", "timestamp", "zeit"];
const POSITIONS: [&str; 12] = [
    "compression",
    "displacement",
    "position",
    "depth",
    "extension",
    "travel",
    "stroke",
    "indentation",
    "insertion",
    "crosshead",
    "lvdt",
    "weg",
];
const FORCES: [&str; 6] = ["force", "load", "fz", "f", "kraft", "standardkraft"];

/// What is looked for.
struct Sought<'a> {
    what: &'static str,
    option: &'static str,
    words: &'a [&'a str],
    dimension: Dimension,
}

const TIME: Sought = Sought { what: "time", option: "--time", words: &TIMES, dimension: Dimension::Time };
const POSITION: Sought =
    Sought { what: "position", option: "--position", words: &POSITIONS, dimension: Dimension::Length };
const MARKER: Sought = Sought { what: "marker", option: "--position", words: &[], dimension: Dimension::Length };
const FORCE: Sought = Sought { what: "force", option: "--force", words: &FORCES, dimension: Dimension::Force };

/// Finds columns in one of several files.
pub(super) struct Finder<'a> {
    pub file: &'a str,
    pub layout: &'a Layout,
}

impl Finder<'_> {
    fn name(&self, index: usize) -> String {
        let header = self.layout.headers.as_ref().and_then(|h| h.get(index)).filter(|h| !h.is_empty());
        header.cloned().unwrap_or_else(|| (index + 1).to_string())
    }

    /// The columns, for a message.
    pub fn describe(&self) -> String {
        (0..self.layout.columns).map(|i| format!("{} `{}`", i + 1, self.name(i))).collect::<Vec<_>>().join(", ")
    }

    fn error(&self, reason: String) -> TableError {
        TableError::Columns { file: self.file.to_owned(), reason, columns: self.describe() }
    }

    /// A column by its header (whole, or without its unit), or by its number from 1.
    fn named(&self, text: &str) -> Option<usize> {
        let wanted = text.trim();
        let headers = self.layout.headers.as_deref().unwrap_or_default();
        let bare = |h: &str| h.split(['(', '[', '<']).next().unwrap_or(h).trim().to_owned();
        let exact = headers.iter().position(|h| h.trim() == wanted);
        let loose = || headers.iter().position(|h| bare(h).eq_ignore_ascii_case(wanted));
        let number = || wanted.parse::<usize>().ok().filter(|n| (1..=self.layout.columns).contains(n)).map(|n| n - 1);
        exact.or_else(loose).or_else(number)
    }

    /// The columns whose headers begin with one of the words, and are not stress or strain.
    fn standing_out(&self, sought: &Sought) -> Vec<usize> {
        let headers = self.layout.headers.as_deref().unwrap_or_default();
        let first = |h: &str| {
            let word = h.trim().trim_start_matches('"').to_lowercase();
            word.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_owned()
        };
        (0..headers.len()).filter(|&i| sought.words.contains(&first(&headers[i]).as_str())).collect()
    }

    fn place(&self, sought: &Sought, said: Option<&str>, taken: &[usize]) -> Result<Option<usize>, TableError> {
        if let Some(text) = said {
            return Ok(self.named(text));
        }
        let found: Vec<usize> = self.standing_out(sought).into_iter().filter(|i| !taken.contains(i)).collect();
        match found[..] {
            [] => Ok(None),
            [one] => Ok(Some(one)),
            _ => {
                Err(self
                    .error(format!("several columns could be the {}: name one with {}", sought.what, sought.option)))
            }
        }
    }

    fn column(&self, sought: &Sought, index: usize, unit: Option<&str>, sign: f64) -> Result<Column, TableError> {
        let name = self.name(index);
        let header = || sought.dimension.of_header(&name);
        let (unit, size) = match unit {
            Some(text) => {
                let known = || format!("{}-unit {text}: known are {}", sought.option, sought.dimension.names());
                (text.to_owned(), sought.dimension.unit(text).ok_or_else(|| self.error(known()))?)
            }
            None => header().ok_or_else(|| {
                self.error(format!(
                    "no unit stands in the header `{name}` of the {}: give it with {}-unit ({})",
                    sought.what,
                    sought.option,
                    sought.dimension.names()
                ))
            })?,
        };
        Ok(Column { index, name, unit, scale: sign * size })
    }

    /// A strain: a share of the gauge length, in per cent where the header or the option says so.
    fn strain(&self, index: usize, said: &Quantity, gauge_m: f64) -> Result<Column, TableError> {
        let name = self.name(index);
        let percent = said.unit.as_deref().map_or_else(|| name.contains('%'), |unit| unit == "%");
        if let Some(unit) = said.unit.as_deref().filter(|unit| !["%", "1", "-", "mm/mm"].contains(unit)) {
            return Err(self
                .error(format!("--position-unit {unit}: with --gauge-length-m the position is a strain, in % or 1")));
        }
        let size = if percent { 0.01 * gauge_m } else { gauge_m };
        let unit = format!("{} of {gauge_m} m", if percent { "%" } else { "1" });
        Ok(Column { index, name, unit, scale: said.sign() * size })
    }

    /// The columns of this file that the selection names or that stand out.
    pub fn find(&self, said: &Selection, number: usize) -> Result<Columns, TableError> {
        let time = said.time.get(number).or(said.time.last()).map(String::as_str);
        let time = if said.rate_hz.is_some() { None } else { self.place(&TIME, time, &[])? };
        let mut columns = Columns {
            time: time.map(|i| self.column(&TIME, i, said.time_unit.as_deref(), 1.0)).transpose()?,
            ..Columns::default()
        };
        let taken: Vec<usize> = time.into_iter().collect();
        if let Some(names) = &said.pose {
            let found: Vec<usize> = names.iter().filter_map(|name| self.named(name)).collect();
            if let [x, y, z] = found[..] {
                let of = |i| self.column(&POSITION, i, said.position.unit.as_deref(), 1.0);
                columns.pose = Some([of(x)?, of(y)?, of(z)?]);
            }
        }
        for names in said.markers.chunks_exact(3) {
            let found: Vec<usize> = names.iter().filter_map(|name| self.named(name)).collect();
            if let [x, y, z] = found[..] {
                let of = |i| self.column(&MARKER, i, said.position.unit.as_deref(), 1.0);
                columns.markers.push([of(x)?, of(y)?, of(z)?]);
            }
        }
        if said.pose.is_none() {
            let place = self.place(&POSITION, said.position.place.as_deref(), &taken)?;
            columns.position = place
                .map(|i| match said.gauge_length_m {
                    Some(gauge) => self.strain(i, &said.position, gauge),
                    None => self.column(&POSITION, i, said.position.unit.as_deref(), said.position.sign()),
                })
                .transpose()?;
        }
        let place = self.place(&FORCE, said.force.place.as_deref(), &taken)?;
        columns.force =
            place.map(|i| self.column(&FORCE, i, said.force.unit.as_deref(), said.force.sign())).transpose()?;
        Ok(columns)
    }
}
