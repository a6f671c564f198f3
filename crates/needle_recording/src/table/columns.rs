//! Assigns columns to quantities and units.

use super::super::unit::Dimension;
use super::super::{Quantity, Selection};
use super::clock::{self, Clock};
use super::error::TableError;
use super::layout::{Kind, Layout};
use super::names::{self, Words};
use super::number::{measure, number};

/// A column that is used.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Index in a row, from 0.
    pub index: usize,
    /// Header, or the number from 1.
    pub name: String,
    /// The unit as it was written.
    pub unit: String,
    /// Size of one unit, in s, m or N, with the sign.
    pub scale: f64,
    /// The recorded number at zero.
    pub zero: f64,
}

impl Column {
    /// The quantity in SI.
    #[must_use]
    pub(crate) fn si(&self, number: f64) -> f64 {
        (number - self.zero) * self.scale
    }
}

/// Columns used of one table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// `None`: rows have a constant rate.
    pub time: Option<(Column, Clock)>,
    /// Depth.
    pub position: Option<Column>,
    /// Force as a single number.
    pub force: Option<Column>,
    /// Force as a vector.
    pub forces: Option<[Column; 3]>,
    /// Tip.
    pub pose: Option<[Column; 3]>,
    /// Orientation of the instrument, a quaternion: x, y, z, w.
    pub orientation: Option<[Column; 4]>,
    /// Markers: x, y and z of each.
    pub markers: Vec<[Column; 3]>,
}

impl Columns {
    /// Indices of all columns that are used.
    pub(super) fn indices(&self) -> Vec<usize> {
        let single = self.time.iter().map(|(column, _)| column).chain(&self.position).chain(&self.force);
        let several = self.forces.iter().chain(&self.pose).chain(&self.markers).flatten();
        let mut all: Vec<usize> =
            single.chain(several).chain(self.orientation.iter().flatten()).map(|column| column.index).collect();
        match &self.time {
            Some((_, Clock::Date(_, both))) => all.extend(both),
            Some((_, Clock::Nanoseconds(rest))) => all.push(*rest),
            _ => {}
        }
        all
    }
}

/// A quantity that is searched for.
struct Sought<'a> {
    what: &'static str,
    option: &'static str,
    words: &'a Words,
    dimension: Dimension,
    /// Whether it is a ratio of that dimension, a strain.
    is_ratio: bool,
}

const TIME: Sought =
    Sought { what: "time", option: "--time", words: &names::TIME, dimension: Dimension::Time, is_ratio: false };
const POSITION: Sought = Sought {
    what: "position",
    option: "--position",
    words: &names::POSITION,
    dimension: Dimension::Length,
    is_ratio: false,
};
const STRAIN: Sought = Sought { is_ratio: true, ..POSITION };
const FORCE: Sought =
    Sought { what: "force", option: "--force", words: &names::FORCE, dimension: Dimension::Force, is_ratio: false };

/// A column that the user named, and the option.
pub(super) type Named<'a> = (&'static str, &'a str);

/// All columns that a selection names, except that of the time, which may have another name in each file.
pub(super) fn named(said: &Selection) -> Vec<Named<'_>> {
    let mut all: Vec<Named<'_>> = said.position.place.iter().map(|name| ("--position", name.as_str())).collect();
    all.extend(said.force.place.iter().map(|name| ("--force-column", name.as_str())));
    all.extend(said.pose.iter().flatten().map(|name| ("--pose-columns", name.as_str())));
    all.extend(said.orientation.iter().flatten().map(|name| ("--pose-columns", name.as_str())));
    all.extend(said.forces.iter().flatten().map(|name| ("--force-columns", name.as_str())));
    all.extend(said.markers.iter().map(|name| ("--marker-columns", name.as_str())));
    all
}

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

    /// The columns, for messages.
    pub(crate) fn describe(&self) -> String {
        (0..self.layout.columns).map(|i| format!("{} `{}`", i + 1, self.name(i))).collect::<Vec<_>>().join(", ")
    }

    pub(super) fn error(&self, reason: String) -> TableError {
        TableError::Columns { file: self.file.to_owned(), reason, columns: self.describe() }
    }

    /// A column by its header (complete, or without its unit), or by its number from 1.
    ///
    /// # Errors
    /// If several columns have the header.
    pub(crate) fn named(&self, text: &str) -> Result<Option<usize>, TableError> {
        let wanted = text.trim();
        let headers = self.layout.headers.as_deref().unwrap_or_default();
        let bare = |h: &str| h.split(['(', '[', '<']).next().unwrap_or(h).trim().to_owned();
        let of =
            |fits: &dyn Fn(&str) -> bool| -> Vec<usize> { (0..headers.len()).filter(|&i| fits(&headers[i])).collect() };
        let exact = of(&|h| h.trim() == wanted);
        let found = if exact.is_empty() { of(&|h| bare(h).eq_ignore_ascii_case(wanted)) } else { exact };
        match found[..] {
            [one] => Ok(Some(one)),
            [first, ..] => Err(self.error(format!(
                "{} columns have the header `{wanted}`: name the one to take by its number, the first is {}",
                found.len(),
                first + 1
            ))),
            [] => {
                let number = wanted.parse::<usize>().ok().filter(|n| (1..=self.layout.columns).contains(n));
                Ok(number.map(|n| n - 1))
            }
        }
    }

    /// The columns whose headers match the quantity best.
    fn standing_out(&self, sought: &Sought, taken: &[usize]) -> Vec<usize> {
        let headers = self.layout.headers.as_deref().unwrap_or_default();
        let is_time = sought.dimension == Dimension::Time;
        // the time column may have no cells if the file states the time step
        let empty = |i: usize| is_time && self.layout.kind(i) == Kind::Empty;
        let free = (0..headers.len()).filter(|i| !taken.contains(i) && !empty(*i));
        let ranks: Vec<(usize, u8)> =
            free.map(|i| (i, sought.words.rank(&headers[i]))).filter(|(_, r)| *r > 0).collect();
        // a column in a unit of something else, as a strain in %, is only taken if no other fits
        let fits = |i: usize| {
            let is_of = sought.dimension.of_header(&headers[i]).is_some();
            if sought.is_ratio { !is_of } else { is_of || !headers[i].ends_with([')', ']']) }
        };
        let some_fit = ranks.iter().any(|(i, _)| fits(*i));
        let ranks = || ranks.iter().filter(|(i, _)| !some_fit || fits(*i));
        let best = ranks().map(|(_, rank)| *rank).max();
        let mut found: Vec<usize> = ranks().filter(|(_, rank)| Some(*rank) == best).map(|(i, _)| *i).collect();
        // words are of no quantity where numbers are
        if !is_time && found.iter().any(|i| self.layout.kind(*i) == Kind::Number) {
            found.retain(|i| self.layout.kind(*i) != Kind::Text);
        }
        found
    }

    /// The columns of numbers that have a unit of the quantity, and no name that says otherwise.
    fn of_unit(&self, sought: &Sought, taken: &[usize]) -> Vec<usize> {
        let headers = self.layout.headers.as_deref().unwrap_or_default();
        let of = |i: &usize| {
            let header = &headers[*i];
            let known = [names::TIME, names::POSITION, names::FORCE].iter().any(|words| words.rank(header) > 0);
            !taken.contains(i)
                && self.layout.kind(*i) == Kind::Number
                && sought.dimension.in_brackets(header)
                && !known
                && !names::is_other(header)
        };
        (0..headers.len()).filter(of).collect()
    }

    /// A message about forces, by their units, of which none is taken.
    pub(super) fn forces_left(&self, columns: &Columns) -> Option<String> {
        let left = self.of_unit(&FORCE, &[]);
        let none = columns.force.is_none() && columns.forces.is_none() && left.len() > 1;
        let names = || left.iter().map(|&i| format!("{} `{}`", i + 1, self.name(i))).collect::<Vec<_>>().join(", ");
        none.then(|| {
            format!("columns {} are forces by their units, and none was taken: name one with --force", names())
        })
    }

    /// The column of dates and times where none has a name for it.
    fn of_times(&self) -> Option<usize> {
        let all: Vec<usize> = (0..self.layout.columns).filter(|&i| self.layout.kind(i) == Kind::Time).collect();
        match all[..] {
            [one] => Some(one),
            [first, second] if second == first + 1 => Some(first),
            _ => None,
        }
    }

    fn place(&self, sought: &Sought, said: Option<&str>, taken: &[usize]) -> Result<Option<usize>, TableError> {
        if let Some(text) = said {
            return self.named(text);
        }
        let found = self.standing_out(sought, taken);
        match found[..] {
            [] => Ok(match self.of_unit(sought, taken)[..] {
                [one] => Some(one),
                _ => None,
            }),
            [one] => Ok(Some(one)),
            _ => {
                let three =
                    if sought.dimension == Dimension::Force { ", or three with --force-columns X,Y,Z" } else { "" };
                let (what, option) = (sought.what, sought.option);
                Err(self.error(format!("several columns could be the {what}: name one with {option}{three}")))
            }
        }
    }

    fn column(&self, sought: &Sought, index: usize, said: &Quantity) -> Result<Column, TableError> {
        let name = self.name(index);
        let in_cells = || {
            let (_, unit) = self.layout.cells(index).find_map(measure)?;
            sought.dimension.unit(unit).map(|size| (unit.to_owned(), size))
        };
        let header = || sought.dimension.of_header(&name).or_else(in_cells);
        let (unit, size) = match said.unit.as_deref() {
            Some(text) => {
                let known = || format!("{}-unit {text}: known are {}", sought.option, sought.dimension.names());
                (text.to_owned(), sought.dimension.unit(text).ok_or_else(|| self.error(known()))?)
            }
            None => header().ok_or_else(|| {
                let counts = match sought.dimension {
                    Dimension::Length if name.contains('%') => {
                        ", and of a strain the length that it is of with --gauge-length-m"
                    }
                    Dimension::Length => ", and of an encoder's counts the length of one with --position-scale",
                    _ => "",
                };
                self.error(format!(
                    "no unit stands in the header `{name}` of the {}: give it with {}-unit ({}){counts}",
                    sought.what,
                    sought.option,
                    sought.dimension.names()
                ))
            })?,
        };
        Ok(Column { index, name, unit, scale: said.sign() * said.factor.unwrap_or(1.0) * size, zero: said.zero })
    }

    /// A strain relative to the gauge length; in per cent if the header or the option says so.
    fn strain(&self, index: usize, said: &Quantity, gauge_m: f64) -> Result<Column, TableError> {
        let name = self.name(index);
        let percent = said.unit.as_deref().map_or_else(|| name.contains('%'), |unit| unit == "%");
        if let Some(unit) = said.unit.as_deref().filter(|unit| !["%", "1", "-", "mm/mm"].contains(unit)) {
            return Err(self
                .error(format!("--position-unit {unit}: with --gauge-length-m the position is a strain, in % or 1")));
        }
        let size = if percent { 0.01 * gauge_m } else { gauge_m };
        let unit = format!("{} of {gauge_m} m", if percent { "%" } else { "1" });
        Ok(Column { index, name, unit, scale: said.sign() * said.factor.unwrap_or(1.0) * size, zero: said.zero })
    }

    /// Several columns by their names, if this file has all of them.
    fn several<const N: usize>(
        &self,
        names: Option<&[String; N]>,
        of: impl Fn(usize) -> Result<Column, TableError>,
    ) -> Result<Option<[Column; N]>, TableError> {
        let Some(names) = names else { return Ok(None) };
        let found = names.iter().map(|name| self.named(name)).collect::<Result<Option<Vec<usize>>, _>>()?;
        let Some(found) = found else { return Ok(None) };
        let columns = found.into_iter().map(of).collect::<Result<Vec<Column>, _>>()?;
        Ok(columns.try_into().ok())
    }

    /// The column of the time, and its format.
    fn time(&self, said: &Selection, number: usize) -> Result<Option<(Column, Clock)>, TableError> {
        let of_file = |list: &[String]| list.get(number).or(list.last()).cloned();
        let place = match of_file(&said.time) {
            Some(name) => self.named(&name)?,
            None => match self.standing_out(&TIME, &[])[..] {
                // a date and a time of day
                [first, second] if self.layout.kind(first) == Kind::Time && self.layout.kind(second) == Kind::Time => {
                    Some(first)
                }
                // a channel each with the same times, as LabVIEW writes them
                [first, ref others @ ..]
                    if others.iter().all(|&i| self.layout.cells(i).eq(self.layout.cells(first))) =>
                {
                    Some(first)
                }
                ref several => match self.seconds_and_nanoseconds().or_else(|| self.only_number(several)) {
                    Some(seconds) => Some(seconds),
                    None => match self.place(&TIME, None, &[])? {
                        Some(named) => Some(named),
                        None => self.of_times(),
                    },
                },
            },
        };
        let Some(index) = place else { return Ok(None) };
        let clock = self.clock(index)?;
        let unit = of_file(&said.time_unit);
        let quantity = Quantity { unit: unit.clone().or_else(|| self.unit_since_1970(index)), ..Quantity::default() };
        let column = match (&clock, unit.as_deref()) {
            (Clock::Number, _) => self.column(&TIME, index, &quantity)?,
            (Clock::Nanoseconds(_), None | Some("s")) | (_, None) => {
                Column { index, name: self.name(index), unit: clock.describe().to_owned(), scale: 1.0, zero: 0.0 }
            }
            (_, Some(unit)) => {
                let name = self.name(index);
                let what = clock.describe();
                return Err(self.error(format!("--time-unit {unit}: column `{name}` is {what}, which has no unit")));
            }
        };
        Ok(Some((column, clock)))
    }

    /// The one column of numbers with a unit among others of dates and times.
    fn only_number(&self, of: &[usize]) -> Option<usize> {
        let has_unit = |i: &&usize| TIME.dimension.of_header(&self.name(**i)).is_some();
        let (dates, numbers): (Vec<usize>, Vec<usize>) = of.iter().partition(|i| self.layout.kind(**i) == Kind::Time);
        let [one] = numbers[..] else { return None };
        Some(one).filter(|one| !dates.is_empty() && has_unit(&one))
    }

    /// The unit of times since 1970 of which the header has none: no two of these units fit one time of this century.
    fn unit_since_1970(&self, index: usize) -> Option<String> {
        let header = TIME.dimension.of_header(&self.name(index));
        let cells = || self.layout.cells(index).filter(|cell| !cell.is_empty());
        let fits = |size: f64| {
            let is_time = |s: f64| (1e9..5e9).contains(&(s * size));
            cells().all(|cell| number(cell, self.layout.decimal_comma).is_some_and(is_time))
        };
        let units = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];
        let found = units.into_iter().find(|(_, size)| header.is_none() && cells().next().is_some() && fits(*size));
        found.map(|(unit, _)| unit.to_owned())
    }

    /// The column `sec` next to one `nanosec`, as in exported bags.
    fn seconds_and_nanoseconds(&self) -> Option<usize> {
        let headers = self.layout.headers.as_deref().unwrap_or_default();
        let last = |h: &String| h.to_lowercase().rsplit(['.', '/', '_']).next().unwrap_or_default().to_owned();
        let is = |h: &String, words: &[&str]| words.contains(&last(h).as_str());
        headers
            .windows(2)
            .position(|pair| is(&pair[0], &["sec", "secs"]) && is(&pair[1], &["nanosec", "nsec", "nsecs", "nanosecs"]))
    }

    fn clock(&self, index: usize) -> Result<Clock, TableError> {
        let cells = |i: usize| -> Vec<&str> { self.layout.cells(i).filter(|cell| !cell.is_empty()).collect() };
        let own = cells(index);
        if self.layout.kind(index) != Kind::Time {
            // 20260304 next to a time of day is a date
            let day = clock::format_of(&own, clock::date).filter(|_| own.len() > 1);
            return Ok(match day.filter(|_| self.layout.kind(index + 1) == Kind::Time) {
                Some(format) => Clock::Date(format, [index, index + 1]),
                None if self.has_nanoseconds(index) => Clock::Nanoseconds(index + 1),
                None => Clock::Number,
            });
        }
        // a row whose cell is not a time is lost
        let own: Vec<&str> = own.into_iter().filter(|cell| clock::is_time(cell)).collect();
        if own.iter().all(|cell| clock::of_day(cell).is_some()) {
            let before = index.checked_sub(1).filter(|&i| self.layout.kind(i) == Kind::Time);
            let day = before.and_then(|i| Some((i, clock::format_of(&cells(i), clock::date)?)));
            // the date is in a column before it
            return Ok(day.map_or(Clock::TimeOfDay, |(i, format)| Clock::Date(format, [i, index])));
        }
        let beside = self.layout.kind(index + 1) == Kind::Time
            && cells(index + 1).iter().filter(|cell| clock::is_time(cell)).all(|cell| clock::of_day(cell).is_some());
        let day = clock::format_of(&own, clock::date).filter(|_| beside);
        if let Some(format) = clock::format_of(&own, clock::date_time).filter(|_| day.is_none()) {
            return Ok(Clock::DateTime(format));
        }
        let error = || {
            let (name, cell) = (self.name(index), own.first().copied().unwrap_or_default());
            self.error(format!("the times of column `{name}` can't be read, as `{cell}`: name another one with --time"))
        };
        day.map(|format| Clock::Date(format, [index, index + 1])).ok_or_else(error)
    }

    /// Whether a column has whole seconds since 1970 and the next one nanoseconds.
    fn has_nanoseconds(&self, index: usize) -> bool {
        let whole = |i: usize| self.layout.cells(i).map(|cell| cell.parse::<u64>().ok()).collect::<Option<Vec<u64>>>();
        let (Some(seconds), Some(rest)) = (whole(index), whole(index + 1)) else { return false };
        let headed = self.seconds_and_nanoseconds() == Some(index);
        let since_1970 = seconds.iter().all(|s| (1_000_000_000..5_000_000_000).contains(s));
        (headed || since_1970)
            && rest.iter().all(|ns| *ns < 1_000_000_000)
            && (headed || rest.iter().any(|ns| *ns >= 1_000_000))
    }

    /// The columns of this file that the selection names or that are detected.
    pub(crate) fn find(&self, said: &Selection, number: usize) -> Result<Columns, TableError> {
        let time = if said.rate_hz.is_some() { None } else { self.time(said, number)? };
        let mut taken: Vec<usize> = time.iter().map(|(column, _)| column.index).collect();
        match &time {
            Some((_, Clock::Date(_, both))) => taken.extend(both),
            Some((_, Clock::Nanoseconds(also))) => taken.push(*also),
            _ => {}
        }
        let length = |i| self.column(&POSITION, i, &Quantity { reversed: false, zero: 0.0, ..said.position.clone() });
        let plain = |i| Ok(Column { index: i, name: self.name(i), unit: "1".to_owned(), scale: 1.0, zero: 0.0 });
        let mut forces = self.several(said.forces.as_ref(), |i| self.column(&FORCE, i, &said.force))?;
        if let (Some(columns), Some(zeros)) = (&mut forces, said.force_zeros) {
            columns.iter_mut().zip(zeros).for_each(|(column, zero)| column.zero = zero);
        }
        let mut columns = Columns {
            time,
            pose: self.several(said.pose.as_ref(), length)?,
            orientation: self.several(said.orientation.as_ref(), plain)?,
            forces,
            ..Columns::default()
        };
        for names in said.markers.chunks_exact(3) {
            let names: Option<&[String; 3]> = names.try_into().ok();
            columns.markers.extend(self.several(names, length)?);
        }
        if said.pose.is_none() {
            let sought = if said.gauge_length_m.is_some() { &STRAIN } else { &POSITION };
            let place = self.place(sought, said.position.place.as_deref(), &taken)?;
            columns.position = place
                .map(|i| match said.gauge_length_m {
                    Some(gauge) => self.strain(i, &said.position, gauge),
                    None => self.column(&POSITION, i, &said.position),
                })
                .transpose()?;
        }
        if said.forces.is_none() {
            let place = self.place(&FORCE, said.force.place.as_deref(), &taken)?;
            columns.force = place.map(|i| self.column(&FORCE, i, &said.force)).transpose()?;
        }
        Ok(columns)
    }
}
