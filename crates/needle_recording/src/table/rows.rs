//! Reads the rows of a table: the required cells, and the start of the next recording.

use std::borrow::Cow;
use std::io;

use super::clock::{self, Clock};
use super::columns::{Column, Columns};
use super::contents::Table;
use super::error::TableError;
use super::layout::{self, Kind, LOOKED_AT, Layout, Splitter};
use super::number::{measure, number};
use super::row::Row;
use super::text::Text;
use crate::adapter::pose_of;
use crate::order::DISORDER_NS;
use crate::selection::TableLayout;
use ros2_messages::geometry_msgs::Quaternion;

/// Direction of an instrument whose poses have no orientation: straight down.
const HALF_A_TURN: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
/// Largest time that fits a stamp of 64 bits in ns, s.
const LONGEST_S: f64 = 9e9;
/// A larger step back in time starts a new recording, ns.
const AGAIN_NS: i64 = 1_000_000_000;
/// Most rows that wait for earlier ones: 12 MB.
const MOST_WAITING: usize = 1 << 16;
/// Behind headers that stand again the recording goes on after at most so many of its longest steps.
const PAUSE: i64 = 10;
const HALF_A_DAY_NS: i64 = 43_200_000_000_000;

/// Lines without data, with the bad rows among them: the end of a recording or of the file, or a loss.
#[derive(Default)]
struct Gap {
    /// Line of its beginning, and its text.
    line: usize,
    text: String,
    rows: Vec<Row>,
    bad: u64,
    first_bad: Option<String>,
    /// Number of these rows that have numbers, and the first of them.
    numbers: u64,
    first_number: Option<String>,
    /// Whether it repeats the headers.
    headers: bool,
}

/// What is said of headers that stand again.
const PAGES: &str = ", and time goes on: the pages are taken for one recording";

/// Cells of one row.
struct Cells<'a> {
    cells: &'a [Cow<'a, str>],
    comma: bool,
    /// Columns in which marks of no reading are usual.
    marked: &'a [usize],
}

impl Cells<'_> {
    fn text(&self, index: usize) -> &str {
        self.cells.get(index).map_or("", |cell| cell.as_ref())
    }

    /// Whether the cell is empty, or stands for no reading where that is usual.
    fn is_blank(&self, column: &Column) -> bool {
        let cell = self.text(column.index);
        cell.is_empty() || self.marked.contains(&column.index) && layout::is_no_reading(cell)
    }

    /// The number in SI; `None` for an empty cell.
    fn value(&self, column: &Column) -> Result<Option<f64>, ()> {
        let cell = self.text(column.index);
        if self.is_blank(column) {
            return Ok(None);
        }
        let own_unit = || measure(cell).filter(|(_, unit)| *unit == column.unit);
        let value = number(cell, self.comma).or_else(|| number(own_unit()?.0, self.comma));
        value.filter(|x| x.is_finite()).map(|x| Some(column.si(x))).ok_or(())
    }

    /// As [`Cells::value`]; NaN if the cell says so: an axis that is not measured.
    fn component(&self, column: &Column) -> Result<f64, ()> {
        let nan = |cell: &str| cell.is_empty() || cell.eq_ignore_ascii_case("nan");
        if nan(self.text(column.index)) { Ok(f64::NAN) } else { self.value(column).map(|x| x.unwrap_or(f64::NAN)) }
    }

    fn several<const N: usize>(&self, columns: &[Column; N]) -> Result<Option<[f64; N]>, ()> {
        let mut values = [0.0; N];
        for (value, column) in values.iter_mut().zip(columns) {
            let Some(found) = self.value(column)? else { return Ok(None) };
            *value = found;
        }
        Ok(Some(values))
    }

    /// Time, ns; `None` for an empty cell.
    fn stamp(&self, (column, clock): &(Column, Clock)) -> Result<Option<i64>, ()> {
        let cell = self.text(column.index);
        if cell.is_empty() {
            return Ok(None);
        }
        let said = match clock {
            Clock::Number => {
                let time_s = self.value(column)?.filter(|s| s.abs() < LONGEST_S).ok_or(())?;
                Some((time_s * 1e9).round() as i64)
            }
            Clock::Nanoseconds(rest) => {
                let whole = cell.parse::<i64>().ok().filter(|s| s.unsigned_abs() < LONGEST_S as u64);
                let rest = self.text(*rest).parse::<i64>().ok().filter(|ns| (0..1_000_000_000).contains(ns));
                whole.zip(rest).map(|(s, ns)| s * 1_000_000_000 + ns)
            }
            Clock::DateTime(format) => clock::date_time(cell, format),
            Clock::TimeOfDay => clock::of_day(cell),
            Clock::Date(format, [date, day]) => {
                clock::date(self.text(*date), format).zip(clock::of_day(self.text(*day))).map(|(a, b)| a + b)
            }
        };
        said.map(Some).ok_or(())
    }

    fn row(&self, columns: &Columns, at_s: Option<f64>) -> Row {
        let stamp = columns.time.as_ref().map(|time| self.stamp(time));
        let stamp = stamp.unwrap_or(Ok(at_s.map(|s| (s * 1e9).round() as i64)));
        let Ok(stamp) = stamp else { return Row { bad: true, ..Row::default() } };
        let mut row = Row { stamp, ..Row::default() };
        let filled = self.fill(columns, &mut row);
        // a reading without a time is lost
        row.bad = match stamp {
            Some(_) => filled.is_err(),
            None => columns.time.is_some() && filled.is_ok() && row.has_sample(),
        };
        row
    }

    /// Fills the row; on an error, the cells before the bad one are kept.
    fn fill(&self, columns: &Columns, row: &mut Row) -> Result<(), ()> {
        if let Some(column) = &columns.position {
            row.depth_m = self.value(column)?;
        }
        if let Some(column) = &columns.force {
            row.force_n = self.value(column)?.map(|force_n| [0.0, 0.0, force_n]);
        }
        // a row without any of the components has no reading; one with a NaN for each has one that is none
        let felt = |axes: &&[Column; 3]| !axes.iter().all(|axis| self.is_blank(axis));
        if let Some([x, y, z]) = columns.forces.as_ref().filter(felt) {
            row.force_n = Some([self.component(x)?, self.component(y)?, self.component(z)?]);
        }
        if let Some(pose) = &columns.pose {
            let tip = self.several(pose)?;
            let turned = match &columns.orientation {
                Some(quaternion) => self.several(quaternion)?,
                None => Some(HALF_A_TURN),
            };
            let of = |(tip, [x, y, z, w]): ([f64; 3], [f64; 4])| pose_of(tip, Quaternion { x, y, z, w }).map_err(drop);
            row.pose = tip.zip(turned).map(of).transpose()?;
        }
        if !columns.markers.is_empty() {
            // an empty cell means that the marker was not seen
            let one = |column: &Column| self.value(column).map(|x| x.unwrap_or(f64::NAN));
            let of = |[x, y, z]: &[Column; 3]| Ok::<_, ()>([one(x)?, one(y)?, one(z)?]);
            row.markers = Some(columns.markers.iter().map(of).collect::<Result<Vec<_>, ()>>()?);
        }
        Ok(())
    }
}

/// The rows of one recording, taken a piece of the text at a time.
pub(super) struct Taking {
    columns: Columns,
    split: Splitter,
    /// Number of cells below which a row was cut off.
    least: usize,
    /// Columns in which marks of no reading are usual.
    marked: Vec<usize>,
    rate_hz: Option<f64>,
    /// Lines so far, from the beginning of the file.
    number: usize,
    gap: Option<Gap>,
    /// Whether the line before was blank.
    blank: bool,
    clock: Unrolled,
    /// First stamp, the longest step from one to the next so far, ns, and whether one jumped ahead.
    first: Option<i64>,
    longest: i64,
    leapt: bool,
    /// Rows so far.
    passed: u64,
}

/// What came of a piece of the text.
pub(super) enum Taken {
    /// Samples, or none.
    Piece,
    /// The recording has ended; the next one begins at this line, where the text goes on.
    End(Option<usize>),
}

impl Taking {
    /// `line`: number of the text's first line, from 0.
    pub(super) fn new(table: &mut Table, text: &mut Text, layout: &Layout, line: usize) -> Self {
        let of_day = matches!(table.columns.time, Some((_, Clock::TimeOfDay)));
        let number = line + layout.first_row;
        table.lines = [number + 1; 2];
        text.skip(layout.offset);
        let needed = table.columns.indices().into_iter().filter(|column| !layout.is_often_empty(*column));
        Self {
            marked: table.columns.indices().into_iter().filter(|column| layout.has_marks(*column)).collect(),
            least: needed.max().filter(|_| text.is_file).map_or(0, |last| last + 1),
            columns: table.columns.clone(),
            split: Splitter::new(layout.separator, layout.arrows),
            rate_hz: table.rate_hz,
            number,
            gap: None,
            blank: false,
            clock: Unrolled { of_day, ..Unrolled::default() },
            first: None,
            longest: 0,
            leapt: false,
            passed: 0,
        }
    }

    /// Takes the cells that are wanted of every row of the next piece.
    pub(super) fn piece(&mut self, table: &mut Table, text: &mut Text, layout: &Layout) -> io::Result<Taken> {
        let Some(piece) = text.take()? else { return Ok(Taken::End(self.end(table, text))) };
        let (mut cells, mut byte) = (Vec::new(), 0);
        for whole in piece.split_inclusive('\n') {
            let (place, raw) = ([byte, self.number], whole.trim_end_matches(['\n', '\r']));
            byte += whole.len();
            self.number += 1;
            if let Some(gap) = &mut self.gap {
                gap.text.push_str(whole);
            }
            if raw.trim().is_empty() {
                self.blank = true;
                continue;
            }
            if layout::is_comment(raw, layout.comment.as_deref()) {
                continue;
            }
            self.split.split(raw, &mut cells);
            if whole.len() == raw.len() && cells.last().is_some_and(|cell| cell.is_empty()) {
                // the file ends behind a separator: the cell was to come
                cells.pop();
            }
            // the last cell of a row that was cut off may be a part of one
            let cut =
                !layout.places.as_ref().is_none_or(|places| places.put(raw, &mut cells)) || cells.len() < self.least;
            let of = Cells { cells: &cells, comma: layout.decimal_comma, marked: &self.marked };
            let mut row = match cut {
                true => Row { bad: true, ..Row::default() },
                false => of.row(&self.columns, self.rate_hz.map(|hz| self.passed as f64 / hz)),
            };
            row.stamp = row.stamp.map(|stamp| self.clock.unrolled(stamp));
            let back = row.stamp.zip(self.clock.last).is_some_and(|(now, last)| last.saturating_sub(now) > AGAIN_NS);
            let words = row.bad && {
                let data = |&c: &usize| Kind::of(of.text(c), layout.decimal_comma).is_data();
                !layout.numeric.iter().any(data)
            };
            if !row.bad {
                // headers stand again on each page of a print
                let step = row.stamp.zip(self.clock.last).map_or(0, |(now, last)| now.saturating_sub(last));
                let goes_on = (1..=self.longest.saturating_mul(PAUSE)).contains(&step);
                if self.gap.as_ref().map_or(self.blank && back, |gap| gap.headers && !goes_on || back) {
                    let (mut again, next) =
                        self.gap.take().map_or_else(|| (whole.to_owned(), place[1]), |gap| (gap.text, gap.line));
                    again.push_str(&piece[byte..]);
                    text.put_back(again);
                    return Ok(Taken::End(Some(next)));
                }
                if let Some(gap) = self.gap.take_if(|gap| gap.headers) {
                    table.turn_page(gap);
                } else if let Some(gap) = self.gap.take() {
                    table.lose(gap);
                } else if back
                    && !self.leapt
                    && row.stamp.zip(self.first).is_some_and(|(now, first)| now - first <= AGAIN_NS)
                {
                    // time begins anew: another recording, if the next row goes on from here, or else a stray stamp
                    self.gap = Some(Gap { line: place[1], text: whole.to_owned(), rows: vec![row], ..Gap::default() });
                    self.blank = false;
                    self.passed += 1;
                    continue;
                }
                self.leapt |=
                    row.stamp.zip(self.clock.last).is_some_and(|(now, last)| now.saturating_sub(last) > AGAIN_NS);
                self.longest = self.longest.max(step);
                self.first = self.first.or(row.stamp);
                self.clock.last = row.stamp.or(self.clock.last);
                table.add(row);
            } else if words || self.gap.is_some() {
                let begun = || Gap { line: place[1], text: whole.to_owned(), ..Gap::default() };
                let gap = self.gap.get_or_insert_with(begun);
                gap.headers |= layout.header_text.as_deref() == Some(raw.trim());
                gap.bad += 1;
                gap.first_bad.get_or_insert_with(|| shown(self.number, &cells, cut));
                if !words {
                    gap.numbers += 1;
                    gap.first_number.get_or_insert_with(|| shown(self.number, &cells, cut));
                }
                gap.rows.push(row);
            } else {
                table.bad += 1;
                table.first_bad.get_or_insert_with(|| shown(self.number, &cells, cut));
                table.add(row);
            }
            self.blank = false;
            self.passed += 1;
            if self.gap.is_none() {
                table.rows += 1;
                table.lines[1] = self.number;
            }
        }
        Ok(Taken::Piece)
    }

    /// What stands behind the last row is no row of it: another table, whose line is given, or a foot.
    fn end(&mut self, table: &mut Table, text: &mut Text) -> Option<usize> {
        let gap = self.gap.take()?;
        let another = Layout::of(&gap.text, &TableLayout::default(), LOOKED_AT);
        if gap.bad == 0 {
            // a last row with a stray stamp
            table.lines[1] = self.number;
            table.lose(gap);
            return None;
        }
        if another.is_some_and(|other| other.has_rows()) {
            text.put_back(gap.text);
            return Some(gap.line);
        }
        let (file, count) = (&table.file, gap.bad);
        let lines = if count == 1 { "1 line" } else { &format!("{count} lines") };
        let warning = format!("{file}: {lines} behind the data, from line {} on, are no rows of it", gap.line + 1);
        table.warnings.push(warning);
        None
    }
}

impl Table {
    /// Headers and titles between two pages are no rows; rows of numbers among them are lost as elsewhere.
    fn turn_page(&mut self, gap: Gap) {
        let said = |warning: &String| warning.ends_with(PAGES);
        if !self.warnings.iter().any(said) {
            self.warnings.push(format!("{}: the headers stand again on line {}{PAGES}", self.file, gap.line + 1));
        }
        let mut rows = gap.rows;
        rows.retain(|row| row.stamp.is_some());
        self.lose(Gap { bad: gap.numbers, first_bad: gap.first_number, rows, ..Gap::default() });
    }

    fn lose(&mut self, gap: Gap) {
        self.bad += gap.bad;
        self.rows += gap.rows.len() as u64;
        if self.first_bad.is_none() {
            self.first_bad = gap.first_bad;
        }
        gap.rows.into_iter().for_each(|row| self.add(row));
    }

    fn add(&mut self, row: Row) {
        let has_sample = row.depth_m.is_some() || row.pose.is_some() || row.force_n.is_some() || row.markers.is_some();
        let Some(stamp) = row.stamp.filter(|_| has_sample) else { return };
        self.usable = true;
        let Some(mut waiting) = self.waiting.take() else { return self.keep(stamp, row) };
        let before_ns = waiting.back().map_or(0, |latest| latest.0.saturating_sub(stamp));
        self.survey.iter_mut().for_each(|survey| survey.arrive(stamp, &row, before_ns));
        let place = if before_ns > 0 { waiting.partition_point(|other| other.0 <= stamp) } else { waiting.len() };
        waiting.insert(place, (stamp, row));
        let latest = stamp.saturating_add(before_ns.max(0));
        let is_over = |first: &(i64, Row)| latest.saturating_sub(first.0) > DISORDER_NS;
        while waiting.len() > MOST_WAITING || waiting.front().is_some_and(is_over) {
            waiting.pop_front().into_iter().for_each(|(stamp, row)| self.keep(stamp, row));
        }
        self.waiting = Some(waiting);
    }

    /// Keeps the rows that waited for earlier ones.
    pub(super) fn keep_all(&mut self) {
        self.waiting.take().into_iter().flatten().for_each(|(stamp, row)| self.keep(stamp, row));
    }

    fn keep(&mut self, stamp: i64, row: Row) {
        if let Some(survey) = &mut self.survey {
            return survey.note(stamp, row);
        }
        let Row { depth_m, force_n, pose, markers, .. } = row;
        let [depths, forces, poses, seen] = &mut self.thin;
        depth_m.into_iter().for_each(|depth_m| depths.take(&mut self.depths, (stamp, depth_m)));
        force_n.into_iter().for_each(|force_n| forces.take(&mut self.forces, (stamp, force_n)));
        pose.into_iter().for_each(|pose| poses.take(&mut self.poses, (stamp, pose)));
        markers.into_iter().for_each(|markers| seen.take(&mut self.markers, (stamp, markers)));
    }

    /// Rejects a table without a usable row.
    pub(super) fn believable(&self) -> Result<(), TableError> {
        if self.usable || self.bad == 0 {
            return Ok(());
        }
        let first = self.first_bad.as_deref().unwrap_or_default();
        let time = self.columns.time.as_ref().map_or_else(String::new, |(column, _)| {
            format!(
                "; its time is column `{}` in {}, and a time is less than {LONGEST_S:e} s: see --time-unit",
                column.name, column.unit
            )
        });
        let reason = format!(
            "no row can be used: a cell that is needed is missing, no number or no time, first in {first}{time}"
        );
        Err(TableError::Columns { file: self.file.clone(), reason, columns: self.all_columns.clone() })
    }
}

/// Continues times of day past midnight.
#[derive(Default)]
struct Unrolled {
    of_day: bool,
    days_ns: i64,
    last: Option<i64>,
}

impl Unrolled {
    fn unrolled(&mut self, stamp: i64) -> i64 {
        if self.of_day && self.last.is_some_and(|last| last - (stamp + self.days_ns) > HALF_A_DAY_NS) {
            self.days_ns += 2 * HALF_A_DAY_NS;
        }
        stamp + self.days_ns
    }
}

fn shown(line: usize, cells: &[Cow<'_, str>], cut: bool) -> String {
    let end = if cut { format!(" (cut off before column {})", cells.len() + 1) } else { String::new() };
    format!("line {line}: {}{end}", cells.join(" | "))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::Selection;
    use std::path::Path;

    /// Number of lost rows, the first of them, and the numbers of depths and forces.
    fn read(text: &str) -> (u64, String, usize, usize) {
        let table = Table::from_bytes(Path::new("t.csv"), text.as_bytes().to_vec(), &Selection::default(), 0).unwrap();
        (table.bad, table.first_bad.unwrap_or_default(), table.depths.len(), table.forces.len())
    }

    #[test]
    fn a_row_that_ends_before_a_needed_column_is_lost() {
        let of = |row: &dyn Fn(u32) -> String| {
            "Time (s),Depth (mm),Load (N),Comment\n".to_owned() + &(0..40).map(row).collect::<String>()
        };
        let plain = of(&|i| format!("{i},{i},1.5{i}\n"));
        assert_eq!(read(&plain), (0, String::new(), 40, 40));
        let cut = |behind: &str| plain[..plain.find(behind).unwrap() + behind.len()].to_owned();
        let lost = |line: &str| (1, line.to_owned(), 39, 39);
        assert_eq!(read(&cut("\n39,3")), lost("line 41: 39 | 3 (cut off before column 3)"));
        assert_eq!(read(&cut("\n39,39,")), lost("line 41: 39 | 39 (cut off before column 3)"));
        assert_eq!(read(&cut("\n39")), lost("line 41: 39 (cut off before column 2)"));
        assert_eq!(read(&plain.replace("\n20,20,1.520", "\n20")), lost("line 22: 20 (cut off before column 2)"));
        // a force at a lower rate, with separators and without
        let slow = of(&|i| if i % 4 == 0 { format!("{i},{i},1.5\n") } else { format!("{i},{i},\n") });
        assert_eq!(read(&slow), (0, String::new(), 40, 10));
        assert_eq!(read(&slow.replace(",\n", "\n")), (0, String::new(), 40, 10));
        // single empty cells are no reading, and no loss
        assert_eq!(read(&plain.replace(",1.520\n", ",\n")), (0, String::new(), 40, 39));
        // readings without a time are lost; rows without anything are none
        assert_eq!(read(&plain.replace("\n20,20,", "\n,20,")), lost("line 22:  | 20 | 1.520"));
        assert_eq!(read(&plain.replace("\n0,0,", "\n,0,")), lost("line 2:  | 0 | 1.50"));
        assert_eq!(read(&(plain.clone() + ",,\n,,\n")), (0, String::new(), 40, 40));
    }
}
