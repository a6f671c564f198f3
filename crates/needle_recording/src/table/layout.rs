//! Detects the layout of a text table: separator, number format, position of headers and data.
//!
//! Data begin with the first rows that have numbers (or times) in two or more columns; other columns may contain
//! words. A word in a number column is a bad cell; it does not belong to the headers. Rows above the first complete
//! ones are included if they have numbers and headers above them.

use std::cell::{OnceCell, RefCell};

use super::super::TableLayout;
use super::super::unit::{has_unit, is_unit};
use super::clock::is_time;
use super::names;
use super::number::{measure, number};

/// Number of lines in which the beginning of the data is searched, and of those in which it is if there is none.
pub(super) const LOOKED_AT: usize = 400;
pub(super) const MOST_LOOKED_AT: usize = 20_000;
/// Number of consecutive rows that establish data.
const ROWS: usize = 3;
/// Number of rows on which the choice of columns and formats is based.
const JUDGED: usize = 64;
/// Separators that are tried; of two that fit equally, the first is used.
const SEPARATORS: [char; 5] = ['\t', ';', ',', ' ', '|'];
/// What the serial monitor of Arduino writes behind the time of day.
const ARROW: &str = " -> ";
/// What stands for no reading in a column of numbers, in lower case.
const NO_READING: [&str; 14] = [
    "nan",
    "-nan",
    "nan(ind)",
    "-nan(ind)",
    "1.#qnan",
    "-1.#ind",
    "na",
    "n/a",
    "#n/a",
    "null",
    "none",
    "missing",
    "-",
    "--",
];
/// Beginnings of comment lines.
const COMMENTS: [&str; 3] = ["#", "//", "%"];

/// Content of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Empty,
    Number,
    /// A date or a time of day.
    Time,
    Text,
}

impl Kind {
    pub(super) fn of(cell: &str, decimal_comma: bool) -> Self {
        match cell {
            "" => Self::Empty,
            _ if number(cell, decimal_comma).is_some() => Self::Number,
            _ if is_time(cell) => Self::Time,
            _ if measure(cell).is_some_and(|(digits, _)| number(digits, decimal_comma).is_some()) => Self::Number,
            _ => Self::Text,
        }
    }

    /// Whether such cells can be data.
    pub(super) const fn is_data(self) -> bool {
        matches!(self, Self::Number | Self::Time)
    }
}

/// The detected layout.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub separator: char,
    pub decimal_comma: bool,
    /// Header of each column, with its unit from a row of units; `None` without headers.
    pub headers: Option<Vec<String>>,
    /// The header line as in the text.
    pub header_text: Option<String>,
    /// Number of the first data line, from 0, and its byte offset.
    pub first_row: usize,
    pub offset: usize,
    pub columns: usize,
    pub comment: Option<String>,
    /// Columns that distinguish data from other lines.
    pub numeric: Vec<usize>,
    /// Whether an arrow separates cells too.
    pub arrows: bool,
    /// Places of the columns between blanks.
    pub places: Option<Places>,
    /// Number of cells of the nearest line above, if it names at least two quantities.
    pub names_beside: Option<usize>,
    /// Time between rows, s, if the file states it (LabVIEW's `Delta_X`).
    pub step_s: Option<f64>,
    /// Message about a line that was found and not used.
    pub note: Option<String>,
    /// Cells and kinds of the first rows.
    rows: Vec<Line>,
}

/// Splits a line into cells. The reader of quoted cells is built only once, at the first of them: its state table
/// costs 20 us.
pub(super) struct Splitter {
    separator: char,
    /// Whether an arrow separates cells too.
    arrows: bool,
    quoted: OnceCell<RefCell<csv_core::Reader>>,
}

impl Splitter {
    pub(crate) fn new(separator: char, arrows: bool) -> Self {
        Self { separator, arrows, quoted: OnceCell::new() }
    }

    /// The cells of a line, in a buffer that is reused.
    pub(crate) fn split<'a>(&self, line: &'a str, cells: &mut Vec<std::borrow::Cow<'a, str>>) {
        cells.clear();
        if self.arrows
            && let Some((stamp, rest)) = line.split_once(ARROW)
        {
            cells.push(stamp.trim().into());
            let mut others = Vec::new();
            self.split(rest, &mut others);
            cells.append(&mut others);
        } else if self.separator == ' ' {
            cells.extend(line.split_whitespace().map(Into::into));
        } else if line.contains(['"', '\r']) {
            cells.extend(self.quoted(line).into_iter().map(Into::into));
        } else {
            cells.extend(line.split(self.separator).map(|cell| cell.trim().into()));
        }
    }

    fn cells(&self, line: &str) -> Vec<String> {
        let mut cells = Vec::new();
        self.split(line, &mut cells);
        cells.into_iter().map(Into::into).collect()
    }

    /// Cells of a line that may contain quoted ones.
    fn quoted(&self, line: &str) -> Vec<String> {
        let delimiter = u8::try_from(self.separator).unwrap_or(b',');
        let build = || RefCell::new(csv_core::ReaderBuilder::new().delimiter(delimiter).build());
        // a cloned reader splits wrongly (csv-core 0.1.13); one that is reset works
        let mut reader = self.quoted.get_or_init(build).borrow_mut();
        reader.reset();
        let (mut text, mut ends) = (vec![0; line.len() + 1], vec![0; line.len() + 1]);
        let (read, _, _, mut cells) = reader.read_record(line.as_bytes(), &mut text, &mut ends);
        if read == csv_core::ReadRecordResult::InputEmpty {
            // the end of the input ends the record
            cells += reader.read_record(&[], &mut text, &mut ends[cells..]).3;
        }
        let begins = std::iter::once(&0).chain(&ends);
        begins
            .zip(&ends[..cells])
            .map(|(from, to)| {
                let cell = String::from_utf8_lossy(&text[*from..*to]);
                // a formula of a spreadsheet that says its cell is text: `="0.25"`
                let said = cell.trim().strip_prefix("=\"").and_then(|rest| rest.strip_suffix('"'));
                said.unwrap_or(cell.trim()).to_owned()
            })
            .collect()
    }
}

/// A line in one possible format.
#[derive(Clone, Debug, PartialEq)]
struct Line {
    number: usize,
    cells: Vec<String>,
    kinds: Vec<Kind>,
}

impl Line {
    fn kind(&self, column: usize) -> Kind {
        self.kinds.get(column).copied().unwrap_or(Kind::Empty)
    }

    fn has_data(&self, columns: &[usize]) -> bool {
        columns.iter().any(|&c| self.kind(c).is_data())
    }

    /// Whether each of these columns has a name or a unit.
    fn names(&self, columns: &[usize]) -> bool {
        columns.iter().all(|&c| self.kind(c) != Kind::Empty)
    }
}

/// The lines in one possible format: start and columns of the data.
struct Seen<'a> {
    split: &'a Splitter,
    decimal_comma: bool,
    lines: Vec<Line>,
    /// Index into the lines.
    first: usize,
    /// Columns with numbers or times in the first rows.
    numeric: Vec<usize>,
    /// Number of word cells in the first rows.
    words: usize,
    /// Whether there are fewer rows than [`ROWS`].
    short: bool,
}

impl<'a> Seen<'a> {
    fn of(kept: &[(usize, &str)], split: &'a Splitter, decimal_comma: bool) -> Option<Self> {
        let line = |&(number, text): &(usize, &str)| {
            let cells = split.cells(text);
            let kinds = cells.iter().map(|cell| Kind::of(cell, decimal_comma)).collect();
            Line { number, cells, kinds }
        };
        // further lines are needed only if data begin here
        let mut lines: Vec<Line> = kept.iter().take(ROWS).map(line).collect();
        let mut first = 0;
        let numeric = loop {
            let rows = lines.get(first..(first + ROWS).min(lines.len())).filter(|rows| !rows.is_empty())?;
            if let Some(numeric) = data_columns(rows, first.checked_sub(1).map(|above| &lines[above])) {
                break numeric;
            }
            lines.extend(kept.get(lines.len()).map(line));
            first += 1;
        };
        let end = (first + JUDGED).min(kept.len());
        lines.extend(kept.get(lines.len()..end).unwrap_or_default().iter().map(line));
        let words = lines[first..].iter().flat_map(|line| &line.kinds).filter(|kind| **kind == Kind::Text).count();
        let short = lines.len() < first + ROWS;
        Some(Self { split, decimal_comma, lines, first, numeric, words, short })
    }

    /// Includes rows above the first complete ones that have a word among their numbers.
    fn take_in_above(&mut self) {
        let is_row = |i: &usize| self.lines[*i].has_data(&self.numeric);
        let reach = (0..self.first).rev().take_while(is_row).last().unwrap_or(self.first);
        // specimens 1, 2, 3 can be headers; a word that names no quantity can't
        let words = || self.lines[0].cells.iter().any(|cell| names::is_known(cell));
        let all = if reach == 0 { !words() } else { self.lines[reach - 1].names(&self.numeric) };
        let whole = |i: &usize| self.numeric.iter().all(|&c| self.lines[*i].kind(c).is_data());
        let from = if all { Some(reach) } else { (reach..self.first).find(whole) };
        self.first = from.unwrap_or(self.first);
    }
}

/// Columns in which all of some rows have numbers or times; `None` unless there are two, one of them with numbers.
/// `above`: the line above them, which may have the headers.
fn data_columns(rows: &[Line], above: Option<&Line>) -> Option<Vec<usize>> {
    let least = rows.iter().map(|line| line.kinds.len()).min()?;
    let all = |c: usize, fits: &dyn Fn(Kind) -> bool| rows.iter().all(|line| fits(line.kind(c)));
    let columns: Vec<usize> = (0..least).filter(|&c| all(c, &Kind::is_data)).collect();
    let numbers = columns.iter().any(|&c| all(c, &|kind| kind == Kind::Number));
    // exclude lists of settings: a word and its values on each line
    let first: Vec<&String> = rows.iter().filter_map(|line| line.cells.first()).collect();
    let named = above.is_some_and(|line| line.cells.iter().filter(|cell| names::is_known(cell)).count() > 1);
    let settings =
        all(0, &|kind| kind == Kind::Text) && !named && (rows.len() < 2 || first.windows(2).any(|w| w[0] != w[1]));
    (columns.len() >= 2 && numbers && !settings).then_some(columns)
}

impl Layout {
    /// Analyses the beginning of a text; `None` if it contains no table of numbers.
    ///
    /// `most`: number of lines in which it is sought.
    pub(crate) fn of(text: &str, said: &TableLayout, most: usize) -> Option<Self> {
        let lines: Vec<&str> = text.split('\n').take(most).map(|line| line.trim_end_matches('\r')).collect();
        let comment = said.comment.as_deref();
        let header_line = said.header_line.unwrap_or(0);
        let kept: Vec<(usize, &str)> = (header_line..lines.len())
            .map(|i| (i, lines[i]))
            .filter(|(_, line)| !line.trim().is_empty() && !is_comment(line, comment) && !is_rule(line))
            .collect();
        let separators = said.separator.map_or_else(|| SEPARATORS.to_vec(), |c| vec![c]);
        let decimals = said.decimal_comma.map_or_else(|| vec![false, true], |comma| vec![comma]);
        let arrows = kept.len() >= ROWS && kept.iter().rev().take(ROWS).all(|(_, line)| line.contains(ARROW));
        let splitters: Vec<Splitter> = separators.into_iter().map(|c| Splitter::new(c, arrows)).collect();
        let quoted = text.get(..text.len().min(4096)).unwrap_or(text).contains('"');
        let ways = splitters.iter().flat_map(|s| decimals.iter().map(move |&d| (s, d)));
        let ways = ways.filter(|&(s, d)| said.separator.is_some() || quoted || !(d && s.separator == ','));
        let seen = ways.filter_map(|(split, comma)| Seen::of(&kept, split, comma));
        // prefer the format with the fewest words, then the earliest data, then the most columns
        let score = |seen: &Seen| {
            (seen.short, seen.words, seen.lines[seen.first].number, std::cmp::Reverse(seen.numeric.len()))
        };
        let mut seen = seen.min_by_key(score)?;
        let units = said.header_line.filter(|line| *line > 0).map_or(0, |_| {
            let is_units = |line: &&Line| {
                seen.numeric.iter().all(|&c| line.cells.get(c).is_some_and(|cell| !cell.is_empty() && is_unit(cell)))
            };
            usize::from(seen.lines.first().filter(|_| seen.first > 0).filter(is_units).is_some())
        });
        // if the user gave the header line, everything after it is data
        let behind = seen.lines.iter().skip(units).position(|line| line.has_data(&seen.numeric)).map(|i| i + units);
        match (said.header_line, behind) {
            (Some(1..), Some(first)) => seen.first = seen.first.min(first),
            _ => seen.take_in_above(),
        }
        Some(Self::put_together(text, &lines, seen, said, units > 0))
    }

    fn put_together(text: &str, lines: &[&str], seen: Seen, said: &TableLayout, units_below: bool) -> Self {
        let first_row = seen.lines[seen.first].number;
        let rows: Vec<Line> = seen.lines[seen.first..].to_vec();
        let columns = rows.iter().map(|line| line.cells.len()).max().unwrap_or(0);
        let labview = LabView::of(lines, first_row, seen.split, seen.decimal_comma);
        let above = Above { lines, first_row, seen: &seen, columns };
        let units = units_below.then(|| seen.lines[0].cells.clone());
        let names_beside = above.nearest_names(said.header_line);
        let (mut headers, header_text, note) = above.headers(said.header_line, units);
        if let Some(headers) = &mut headers {
            labview.add_units(headers);
        }
        let offset = lines[first_row].as_ptr() as usize - text.as_ptr() as usize;
        let places = (seen.split.separator == ' ').then(|| Places::of(&rows, lines));
        Self {
            arrows: seen.split.arrows,
            places,
            separator: seen.split.separator,
            decimal_comma: seen.decimal_comma,
            headers,
            header_text,
            first_row,
            offset,
            columns,
            comment: said.comment.clone(),
            numeric: seen.numeric.clone(),
            names_beside,
            step_s: labview.step_s,
            note,
            rows,
        }
    }

    /// Takes the headers of the recording before it in the file, if it has none and as many columns.
    pub(super) fn inherit(&mut self, before: &(Option<Vec<String>>, usize)) {
        if self.headers.is_none() && before.1 == self.columns {
            self.headers.clone_from(&before.0);
        }
    }

    /// Content of a column, from its first rows.
    pub(crate) fn kind(&self, column: usize) -> Kind {
        let kinds = || self.rows.iter().map(|line| line.kind(column));
        let most = [Kind::Time, Kind::Number, Kind::Text];
        let count = |of: Kind| kinds().filter(|kind| *kind == of).count();
        most.into_iter().filter(|kind| count(*kind) > 0).max_by_key(|kind| count(*kind)).unwrap_or(Kind::Empty)
    }

    /// Whether rows without a cell in this column are usual: more than one of the first rows, and more than a tenth.
    pub(super) fn is_often_empty(&self, column: usize) -> bool {
        let empty = self.rows.iter().filter(|line| line.kind(column) == Kind::Empty).count();
        empty > 1 && empty * 10 > self.rows.len()
    }

    /// Whether marks of no reading, as `NaN`, are usual in this column: as often as [`Layout::is_often_empty`] asks for.
    pub(super) fn has_marks(&self, column: usize) -> bool {
        let marks =
            self.rows.iter().filter(|line| line.cells.get(column).is_some_and(|cell| is_no_reading(cell))).count();
        marks > 1 && marks * 10 > self.rows.len()
    }

    /// Whether decimal commas stand between commas: there are more cells than names, and all of them are whole numbers.
    pub(super) fn has_commas_twice(&self) -> bool {
        let whole = |cell: &String| {
            let digits = cell.trim_start_matches(['-', '+']);
            !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
        };
        let names = self.names_beside.unwrap_or(0);
        let is_row = |line: &Line| (names + 1..=2 * names).contains(&line.cells.len()) && line.cells.iter().all(whole);
        self.separator == ',' && names >= 2 && self.rows.iter().take(JUDGED).all(is_row)
    }

    /// Number of lines up to the end of a short table, and of bytes of its text; `None` if it goes on behind the first rows.
    pub(super) fn end(&self, text: &str) -> Option<(usize, usize)> {
        let behind = self.rows.iter().find(|line| !line.has_data(&self.numeric))?.number;
        Some((behind, text.split_inclusive('\n').take(behind).map(str::len).sum()))
    }

    /// Whether there are enough rows for a recording.
    pub(crate) fn has_rows(&self) -> bool {
        self.rows.len() >= ROWS
    }

    /// Cells of a column in the first rows.
    pub(crate) fn cells(&self, column: usize) -> impl Iterator<Item = &str> {
        self.rows.iter().map(move |line| line.cells.get(column).map_or("", String::as_str))
    }
}

/// Whether a cell stands for no reading.
pub(super) fn is_no_reading(cell: &str) -> bool {
    cell.len() < 10 && NO_READING.contains(&cell.to_lowercase().as_str())
}

/// Where the cells of a table between blanks end or begin: an empty cell of such a row leaves no mark but its place.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Places {
    /// Number of cells of rows of numbers that are whole.
    whole: usize,
    /// Byte at which the cells of a column begin, and that at which they end, as far as they are the same in all of these rows. Empty if
    /// rows are not padded with blanks: there the cells behind an empty one move up.
    columns: Vec<[Option<usize>; 2]>,
}

impl Places {
    fn of(rows: &[Line], lines: &[&str]) -> Self {
        let is_data = |row: &&Line| row.kinds.iter().all(|kind| kind.is_data());
        let whole = rows.iter().filter(is_data).map(|row| row.cells.len()).max().unwrap_or(0);
        let (mut columns, mut padded) = (Vec::new(), false);
        for row in rows.iter().filter(is_data).filter(|row| row.cells.len() == whole) {
            let found: Vec<[usize; 2]> = extents(lines[row.number]).collect();
            padded |= found.windows(2).any(|pair| pair[1][0] > pair[0][1] + 1);
            columns.resize(whole, None);
            for (known, new) in columns.iter_mut().zip(found) {
                let known = known.get_or_insert(new.map(Some));
                known.iter_mut().zip(new).for_each(|(known, new)| *known = known.filter(|place| *place == new));
            }
        }
        let mut columns: Vec<[Option<usize>; 2]> = columns.into_iter().flatten().collect();
        let all = [0, 1].map(|side| columns.iter().all(|place| place[side].is_some()));
        columns.iter_mut().for_each(|place| (0..2).filter(|side| !all[*side]).for_each(|side| place[side] = None));
        columns.retain(|_| padded && all.contains(&true));
        Self { whole, columns }
    }

    /// Puts the cells of a row that has fewer of them into their columns. False if they could be of several.
    pub(super) fn put<'a>(&self, line: &'a str, cells: &mut Vec<std::borrow::Cow<'a, str>>) -> bool {
        if cells.len() >= self.whole {
            return true;
        }
        let (mut row, mut from) = (Vec::with_capacity(self.whole), 0);
        for ([begin, end], cell) in extents(line).zip(cells.iter()) {
            let fits = |place: &[Option<usize>; 2]| place[0] == Some(begin) || place[1] == Some(end);
            let Some(at) = self.columns.iter().skip(from).position(fits) else { return false };
            row.extend(std::iter::repeat_n("".into(), at));
            row.push(cell.clone());
            from += at + 1;
        }
        row.resize(self.whole, "".into());
        *cells = row;
        true
    }
}

/// First byte of each word of a line, and the byte behind it.
fn extents(line: &str) -> impl Iterator<Item = [usize; 2]> {
    line.split_whitespace().map(move |word| {
        let begin = word.as_ptr() as usize - line.as_ptr() as usize;
        [begin, begin + word.len()]
    })
}

/// The lines above the data.
struct Above<'a> {
    lines: &'a [&'a str],
    first_row: usize,
    seen: &'a Seen<'a>,
    columns: usize,
}

impl Above<'_> {
    fn split(&self, line: &str) -> Vec<String> {
        let of = |line: &str| -> Vec<String> {
            self.seen.split.cells(line).iter().map(|cell| cell.replace('\n', " ")).collect()
        };
        // the unit of a strain, and no comment
        let whole = of(line);
        if whole.len() == self.columns && whole.first().is_some_and(|cell| cell == "%") {
            return whole;
        }
        let line = line.trim_start_matches(['\u{feff}', '#', '%']);
        let cells = of(line);
        if self.seen.split.separator == ' ' && cells.len() != self.columns { by_gaps(line) } else { cells }
    }

    /// Whether a line names every column of numbers. One that leaves cells empty must name two quantities: the column of
    /// numbers that pandas writes in front has no name.
    fn names(&self, cells: &[String]) -> bool {
        let all = self.seen.numeric.iter().all(|&c| cells.get(c).is_some_and(|cell| !cell.is_empty()));
        let reach = || self.seen.numeric.iter().all(|&c| c < cells.len());
        all || (reach() && cells.iter().filter(|cell| names::is_known(cell)).count() >= 2)
    }

    /// The nearest line above the data that names every number column, or the line that the user gave. A row of units
    /// is merged into the headers. Also returns the line itself, and a message about a line that was not used.
    fn headers(
        &self,
        said: Option<usize>,
        units_below: Option<Vec<String>>,
    ) -> (Option<Vec<String>>, Option<String>, Option<String>) {
        let mut at = self.first_row;
        if let Some(line) = said {
            if line == 0 {
                return (None, None, None);
            }
            let names = self.split(self.lines[line - 1]);
            return (
                Some(units_below.map_or(names.clone(), |units| with_units(&names, &units))),
                Some(self.lines[line - 1].trim().to_owned()),
                None,
            );
        }
        let mut units: Option<Vec<String>> = None;
        let (line, text, names) = loop {
            // units may be all that the columns have for names
            let Some((line, text)) = self.next_above(at) else {
                return (units.as_deref().map(units_alone), None, None);
            };
            let cells = self.split(&text);
            at = line;
            if !self.are_units(&cells) {
                break (line, text, cells);
            }
            // of several rows of units, as one of dashes, the one that says most
            let said = |row: &[String]| row.iter().filter(|cell| cell.chars().any(char::is_alphabetic)).count();
            units = Some(units.filter(|below| said(below) >= said(&cells)).unwrap_or(cells));
        };
        if !self.names(&names) {
            let words = names.iter().filter(|cell| cell.chars().any(char::is_alphabetic)).count();
            let units = units.as_deref().map(units_alone);
            let note = (words >= 2 && units.is_none()).then(|| {
                format!(
                    "line {} has no name for every column of numbers below it, so its words were not taken for headers",
                    line + 1
                )
            });
            return (units, None, note);
        }
        if units.is_none() && !names.iter().any(|name| has_unit(name)) {
            // units above the names
            let above = self.next_above(line).map(|(_, text)| self.split(&text));
            units = above.filter(|cells| self.are_units(cells));
        }
        let text = text.lines().last().unwrap_or_default().trim().to_owned();
        (Some(units.map_or(names.clone(), |units| with_units(&names, &units))), Some(text), None)
    }

    /// Number of cells of the nearest line above the data, or of the line that the user gave, if it names at least two quantities.
    fn nearest_names(&self, said: Option<usize>) -> Option<usize> {
        let line = match said {
            Some(line) => (*self.lines.get(line.checked_sub(1)?)?).to_owned(),
            None => self.next_above(self.first_row)?.1,
        };
        let names = self.split(&line);
        (names.iter().filter(|name| names::is_known(name)).count() >= 2).then_some(names.len())
    }

    /// The nearest line above another that may be one of headers, and its text. A cell in quotation marks may go over several lines.
    fn next_above(&self, line: usize) -> Option<(usize, String)> {
        // headers may be in a comment, and comments may be between them and the data
        let kept = |&i: &usize| {
            !self.lines[i].trim().is_empty()
                && !is_rule(self.lines[i])
                && (!is_comment(self.lines[i], None) || self.split(self.lines[i]).len() == self.columns)
        };
        let last = (0..line).rev().find(kept)?;
        let is_whole = |first: &usize| {
            let marks = self.lines[*first..=last].iter().map(|line| line.matches('"').count()).sum::<usize>();
            marks.is_multiple_of(2)
        };
        let first = (0..=last).rev().find(is_whole).unwrap_or(last);
        Some((first, self.lines[first..=last].join("\n")))
    }

    /// Whether a line has units of the columns of numbers; some of them may have none.
    fn are_units(&self, cells: &[String]) -> bool {
        let of = |c: &usize| cells.get(*c).map_or("", String::as_str);
        let said = self.seen.numeric.iter().filter(|c| !of(c).is_empty()).count();
        2 * said >= self.seen.numeric.len() && self.seen.numeric.iter().all(|c| is_unit(of(c)))
    }
}

/// Headers of columns that have units and no names.
fn units_alone(units: &[String]) -> Vec<String> {
    with_units(&vec![String::new(); units.len()], units)
}

/// Headers with the units of a row below them.
fn with_units(names: &[String], units: &[String]) -> Vec<String> {
    let bare = |unit: &str| unit.trim_matches(['(', ')', '[', ']']).to_owned();
    let one = |(i, name): (usize, &String)| match units.get(i) {
        Some(unit) if !unit.is_empty() => format!("{name} ({})", bare(unit)).trim_start().to_owned(),
        _ => name.clone(),
    };
    names.iter().enumerate().map(one).collect()
}

/// Channel information in the head of a LabVIEW file.
#[derive(Default)]
struct LabView {
    units: Vec<String>,
    step_s: Option<f64>,
}

impl LabView {
    fn of(lines: &[&str], first_row: usize, split: &Splitter, decimal_comma: bool) -> Self {
        let row = |key: &str| {
            let found = lines[..first_row].iter().rev().find(|line| line.trim_start().starts_with(key));
            found.map(|line| split.cells(line))
        };
        let step = row("Delta_X").and_then(|cells| number(cells.get(1)?, decimal_comma)).filter(|step| *step > 0.0);
        Self { units: row("Y_Unit_Label").unwrap_or_default(), step_s: step }
    }

    fn add_units(&self, headers: &mut [String]) {
        for (name, unit) in headers.iter_mut().zip(&self.units).skip(1).filter(|(_, unit)| !unit.is_empty()) {
            *name = format!("{name} ({unit})");
        }
        if let Some(time) = headers.first_mut().filter(|name| *name == "X_Value") {
            time.push_str(" (s)");
        }
    }
}

/// Headers that contain blanks, separated by two or more blanks.
fn by_gaps(line: &str) -> Vec<String> {
    line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).map(str::to_owned).collect()
}

/// Whether a line is drawn, as below headers.
fn is_rule(line: &str) -> bool {
    (line.contains("---") || line.contains("===")) && line.chars().all(|c| "-=+|: ".contains(c))
}

/// Whether a line is a comment.
pub(super) fn is_comment(line: &str, said: Option<&str>) -> bool {
    let line = line.trim_start_matches(['\u{feff}', ' ', '"']);
    said.map_or_else(|| COMMENTS.iter().any(|mark| line.starts_with(mark)), |mark| line.starts_with(mark))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_in_quotation_marks_are_split_as_others() {
        let split = Splitter::new(',', false);
        for _ in 0..2 {
            for (line, cells) in [
                ("0.0, 1.5,-2", &["0.0", "1.5", "-2"][..]),
                ("\"0.0\",\" 1.5\",\"-2\"", &["0.0", "1.5", "-2"]),
                ("\"a, \"\"b\"\"\",c,", &["a, \"b\"", "c", ""]),
                ("\"open, and", &["open, and"]),
                ("a,b\r\"c\"", &["a", "b"]),
                ("=\"0.5\",\"1,5\"", &["0.5", "1,5"]),
            ] {
                assert_eq!(split.cells(line), cells, "{line}");
            }
        }
    }
}
