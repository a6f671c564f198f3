//! How the text of a table is laid out: what separates its cells, how numbers are written, where headers and data stand.

use std::cell::{OnceCell, RefCell};

use super::super::TableLayout;
use super::super::unit::is_unit;

/// Lines that are looked at for the beginning of the data.
const LOOKED_AT: usize = 400;
/// Rows in a row that are data.
const ROWS: usize = 3;
/// Separators that are tried, in this order where two do as well.
const SEPARATORS: [char; 4] = ['\t', ';', ',', ' '];
/// What comment lines begin with.
const COMMENTS: [&str; 3] = ["#", "//", "%"];

/// What was seen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub separator: char,
    pub decimal_comma: bool,
    /// Of each column; `None` without headers. With its unit from a row of units in brackets.
    pub headers: Option<Vec<String>>,
    /// Number of the first line of data, from 0, and the byte at which it begins.
    pub first_row: usize,
    pub offset: usize,
    pub columns: usize,
    pub comment: Option<String>,
}

/// A number, after the decimal comma is a point.
pub(super) fn number(cell: &str, decimal_comma: bool) -> Option<f64> {
    let cell = cell.trim();
    if decimal_comma && cell.contains(',') { cell.replace(',', ".").parse().ok() } else { cell.parse().ok() }
}

/// What separates the cells of a line. The reader of quoted cells is made at the first of them, once: its table of states costs 20 us.
struct Splitter {
    separator: char,
    quoted: OnceCell<RefCell<csv_core::Reader>>,
}

impl Splitter {
    fn new(separator: char) -> Self {
        Self { separator, quoted: OnceCell::new() }
    }

    fn cells(&self, line: &str) -> Vec<String> {
        if self.separator == ' ' {
            return line.split_whitespace().map(str::to_owned).collect();
        }
        if line.contains(['"', '\r']) {
            return self.quoted(line);
        }
        line.split(self.separator).map(|cell| cell.trim().to_owned()).collect()
    }

    /// Cells of a line of which some may stand in quotation marks.
    fn quoted(&self, line: &str) -> Vec<String> {
        let delimiter = super::delimiter(self.separator);
        let build = || RefCell::new(csv_core::ReaderBuilder::new().delimiter(delimiter).build());
        // a clone of such a reader splits wrongly (csv-core 0.1.13), one that is reset does not
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
            .map(|(from, to)| String::from_utf8_lossy(&text[*from..*to]).trim().to_owned())
            .collect()
    }
}

/// A line of data: two cells or more, none of them a word, at least two of them numbers; how many cells it has.
fn data(line: &str, split: &Splitter, decimal_comma: bool) -> Option<usize> {
    let cells = split.cells(line);
    let numbers = cells.iter().filter(|cell| number(cell, decimal_comma).is_some_and(f64::is_finite)).count();
    let all = cells.iter().all(|cell| cell.is_empty() || number(cell, decimal_comma).is_some());
    (numbers >= 2 && all).then_some(cells.len())
}

impl Layout {
    /// Looks at the beginning of a text; `None` if there is no table of numbers in it.
    pub fn of(text: &str, said: &TableLayout) -> Option<Self> {
        let lines: Vec<&str> = text.split('\n').take(LOOKED_AT).map(|line| line.trim_end_matches('\r')).collect();
        let separators = said.separator.map_or_else(|| SEPARATORS.to_vec(), |c| vec![c]);
        let decimals = said.decimal_comma.map_or_else(|| vec![false, true], |comma| vec![comma]);
        let splitters: Vec<Splitter> = separators.into_iter().map(Splitter::new).collect();
        let ways = splitters.iter().flat_map(|s| decimals.iter().map(move |&d| (s, d)));
        let ways = ways.filter(|&(s, d)| said.separator.is_some() || !(d && s.separator == ','));
        let comment = said.comment.as_deref();
        let seen = ways.filter_map(|(split, comma)| {
            let (first, columns) = Self::first_row(&lines, split, comma, comment, said.header_line)?;
            Some((first, columns, split, comma))
        });
        // the reading that finds data first, then the one with the most columns
        let (first_row, columns, split, decimal_comma) =
            seen.min_by_key(|(first, columns, ..)| (*first, std::cmp::Reverse(*columns)))?;
        let headers = Self::headers(&lines, first_row, columns, split, said.header_line);
        let separator = split.separator;
        let offset = lines[first_row].as_ptr() as usize - text.as_ptr() as usize;
        let comment = said.comment.clone();
        Some(Self { separator, decimal_comma, headers, first_row, offset, columns, comment })
    }

    fn first_row(
        lines: &[&str],
        split: &Splitter,
        comma: bool,
        comment: Option<&str>,
        header_line: Option<usize>,
    ) -> Option<(usize, usize)> {
        let kept: Vec<usize> = (header_line.unwrap_or(0)..lines.len())
            .filter(|&i| !lines[i].trim().is_empty() && !is_comment(lines[i], comment))
            .collect();
        let of = |i: usize| data(lines[i], split, comma);
        kept.iter().enumerate().find_map(|(k, &i)| {
            let columns = of(i)?;
            let rows = &kept[k..(k + ROWS).min(kept.len())];
            rows.iter().all(|&row| of(row) == Some(columns)).then_some((i, columns))
        })
    }

    /// The nearest line above the data with as many cells, or the one that was named; a row of units goes into the headers.
    fn headers(
        lines: &[&str],
        first_row: usize,
        columns: usize,
        splitter: &Splitter,
        said: Option<usize>,
    ) -> Option<Vec<String>> {
        let split = |i: usize| {
            let line = lines[i].trim_start_matches(['\u{feff}', '#', '%']);
            let split = splitter.cells(line);
            if splitter.separator == ' ' && split.len() != columns { by_gaps(line) } else { split }
        };
        if let Some(line) = said {
            return (line > 0).then(|| split(line - 1));
        }
        // headers may stand in a comment, and comments between them and the data
        let kept =
            |&i: &usize| !lines[i].trim().is_empty() && (!is_comment(lines[i], None) || split(i).len() == columns);
        let mut above = (0..first_row).rev().filter(kept).map(split);
        let last = above.next().filter(|cells| cells.len() == columns)?;
        if !last.iter().all(|cell| is_unit(cell)) {
            return Some(last);
        }
        let names = above.next().filter(|cells| cells.len() == columns)?;
        let bare = |unit: &str| unit.trim_matches(['(', ')', '[', ']']).to_owned();
        Some(names.iter().zip(&last).map(|(name, unit)| format!("{name} ({})", bare(unit))).collect())
    }
}

/// Headers with blanks in them, two blanks or more apart.
fn by_gaps(line: &str) -> Vec<String> {
    line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).map(str::to_owned).collect()
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
        let split = Splitter::new(',');
        for _ in 0..2 {
            for (line, cells) in [
                ("0.0, 1.5,-2", &["0.0", "1.5", "-2"][..]),
                ("\"0.0\",\" 1.5\",\"-2\"", &["0.0", "1.5", "-2"]),
                ("\"a, \"\"b\"\"\",c,", &["a, \"b\"", "c", ""]),
                ("\"open, and", &["open, and"]),
                ("a,b\r\"c\"", &["a", "b"]),
            ] {
                assert_eq!(split.cells(line), cells, "{line}");
            }
        }
    }
}
