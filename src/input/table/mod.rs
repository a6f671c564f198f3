//! Tables of numbers as text: what load cells, testing machines and spreadsheets write.

mod columns;
mod layout;

use std::fs;
use std::path::{Path, PathBuf};

use super::Selection;
use crate::twin::Pose;
use columns::Finder;
pub use columns::{Column, Columns};
use layout::{Layout, number};

/// The instrument of a table's poses points straight down.
const DOWN: [f64; 3] = [0.0, 0.0, -1.0];

/// Why a table can't be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file can't be opened.
    #[error("{}: can't be read: {source}", .path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file of another program.
    #[error("{}: {what} is not read; save it as CSV text ({how})", .path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// How to make a table of it.
        how: &'static str,
    },
    /// There is no table in it.
    #[error(
        "{}: no rows of numbers were found in its first lines; say how it is laid out with --separator, --decimal-comma, \
         --header-line or --comment", .path.display()
    )]
    NoTable {
        /// The file.
        path: PathBuf,
    },
    /// Columns can't be told, or have no unit.
    #[error("{file}: {reason}. Its columns: {columns}")]
    Columns {
        /// The file.
        file: String,
        /// What is wrong, and what to do.
        reason: String,
        /// What there is.
        columns: String,
    },
    /// No file has what is needed.
    #[error("no column for the {what}: name it with {option}, by its header or its number from 1. {columns}")]
    Missing {
        /// What is needed.
        what: &'static str,
        /// How it is named.
        option: &'static str,
        /// Columns of all files.
        columns: String,
    },
}

/// Rows of one file, as far as they were taken.
#[derive(Debug, Default)]
pub struct Table {
    /// Its name.
    pub file: String,
    /// How it is laid out, in words.
    pub layout: String,
    /// The columns that were taken.
    pub columns: Columns,
    /// All columns, in words.
    pub all_columns: String,
    /// Rows of data.
    pub rows: u64,
    /// Rows with a cell that is no number, and the first of them with its line.
    pub bad: u64,
    /// See `bad`.
    pub first_bad: Option<String>,
    pub(super) depths: Vec<(i64, f64)>,
    pub(super) forces: Vec<(i64, [f64; 3])>,
    pub(super) poses: Vec<(i64, Pose)>,
    pub(super) markers: Vec<(i64, Vec<[f64; 3]>)>,
}

/// What separates cells, to a reader.
fn delimiter(separator: char) -> u8 {
    u8::try_from(separator).unwrap_or(b',')
}

/// UTF-8, UTF-16 with its mark, or else Latin-1: the units µm and °C stand in old files.
fn text(bytes: Vec<u8>) -> String {
    let wide = |of: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes[2..].chunks_exact(2).map(|pair| of([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&units)
    };
    match bytes.get(..2) {
        Some([0xff, 0xfe]) => wide(u16::from_le_bytes),
        Some([0xfe, 0xff]) => wide(u16::from_be_bytes),
        _ => String::from_utf8(bytes).unwrap_or_else(|e| e.into_bytes().iter().map(|&b| char::from(b)).collect()),
    }
}

/// Files that are no text.
fn refuse_foreign(path: &Path) -> Result<(), TableError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let foreign = match extension.as_str() {
        "mat" => ("a MATLAB file", "in MATLAB: writetable, writetimetable or writematrix"),
        "xlsx" | "xls" | "ods" => ("a spreadsheet", "in the spreadsheet program: save as CSV"),
        "tdms" => ("a TDMS file", "in LabVIEW or DIAdem: export as text"),
        _ => return Ok(()),
    };
    Err(TableError::Foreign { path: path.to_owned(), what: foreign.0, how: foreign.1 })
}

impl Table {
    /// Reads the file with the given number, from 0, of those of a recording.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn read(path: &Path, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        refuse_foreign(path)?;
        let bytes = fs::read(path).map_err(|source| TableError::Open { path: path.to_owned(), source })?;
        Self::from_bytes(path, bytes, said, file_number)
    }

    /// As [`Table::read`], from what the file holds.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        let text = text(bytes);
        let text = text.trim_start_matches('\u{feff}');
        let layout = Layout::of(text, &said.layout).ok_or_else(|| TableError::NoTable { path: path.to_owned() })?;
        let file = path.display().to_string();
        let finder = Finder { file: &file, layout: &layout };
        let columns = finder.find(said, file_number)?;
        let mut table =
            Self { layout: describe(&layout), all_columns: finder.describe(), columns, file, ..Self::default() };
        table.take(&text[layout.offset..], &layout, said.rate_hz);
        Ok(table)
    }

    /// Takes the cells that are wanted of every row.
    fn take(&mut self, data: &str, layout: &Layout, rate_hz: Option<f64>) {
        let one_tab;
        let (data, separator) = if layout.separator == ' ' {
            let tabbed = |line: &str| line.split_whitespace().collect::<Vec<_>>().join("\t");
            one_tab = data.lines().map(tabbed).collect::<Vec<_>>().join("\n");
            (one_tab.as_str(), '\t')
        } else {
            (data, layout.separator)
        };
        let columns = self.columns.clone();
        let mut reader = csv::ReaderBuilder::new();
        let mut reader =
            reader.has_headers(false).flexible(true).delimiter(delimiter(separator)).from_reader(data.as_bytes());
        let mut record = csv::ByteRecord::new();
        let mut rows = 0;
        while reader.read_byte_record(&mut record).unwrap_or(false) {
            let first = String::from_utf8_lossy(record.get(0).unwrap_or_default());
            if layout::is_comment(&first, layout.comment.as_deref()) {
                continue;
            }
            let row = Row { record: &record, comma: layout.decimal_comma };
            if self.take_row(&row, &columns, rate_hz.map(|hz| rows as f64 / hz)).is_none() {
                self.bad += 1;
                let at = record.position().map_or(0, |p| p.byte() as usize);
                // where lines end with two characters, the second belongs to the next record
                let before = data[..at].matches('\n').count() + usize::from(data[at..].starts_with('\n'));
                let line = layout.first_row + 1 + before;
                let cells = || record.iter().map(|cell| String::from_utf8_lossy(cell)).collect::<Vec<_>>().join(" | ");
                self.first_bad.get_or_insert_with(|| format!("line {line}: {}", cells()));
            }
            rows += 1;
        }
        self.rows = rows;
    }

    /// `None` where a cell is no number.
    fn take_row(&mut self, row: &Row, columns: &Columns, at_s: Option<f64>) -> Option<()> {
        let time = columns.time.as_ref().map_or(Ok(at_s), |column| row.value(column)).ok()?;
        let Some(stamp) = time.map(|s| (s * 1e9).round() as i64) else { return Some(()) };
        if let Some(column) = &columns.position {
            self.depths.extend(row.value(column).ok()?.map(|depth_m| (stamp, depth_m)));
        }
        if let Some(column) = &columns.force {
            self.forces.extend(row.value(column).ok()?.map(|force_n| (stamp, [0.0, 0.0, force_n])));
        }
        if let Some([x, y, z]) = &columns.pose {
            let (x, y, z) = (row.value(x).ok()?, row.value(y).ok()?, row.value(z).ok()?);
            if let (Some(x), Some(y), Some(z)) = (x, y, z) {
                self.poses.push((stamp, Pose { tip: [x, y, z], axis: DOWN }));
            }
        }
        if !columns.markers.is_empty() {
            // an empty cell: not seen
            let one = |column: &Column| row.value(column).map(|x| x.unwrap_or(f64::NAN));
            let of = |[x, y, z]: &[Column; 3]| Ok::<_, ()>([one(x)?, one(y)?, one(z)?]);
            let positions = columns.markers.iter().map(of).collect::<Result<Vec<_>, ()>>().ok()?;
            self.markers.push((stamp, positions));
        }
        Some(())
    }
}

struct Row<'a> {
    record: &'a csv::ByteRecord,
    comma: bool,
}

impl Row<'_> {
    /// The number in SI; `None` of an empty cell.
    fn value(&self, column: &Column) -> Result<Option<f64>, ()> {
        let cell = self.record.get(column.index).unwrap_or_default().trim_ascii();
        if cell.is_empty() {
            return Ok(None);
        }
        let text = std::str::from_utf8(cell).map_err(drop)?;
        number(text, self.comma).filter(|x| x.is_finite()).map(|x| Some(x * column.scale)).ok_or(())
    }
}

fn describe(layout: &Layout) -> String {
    let separator = match layout.separator {
        '\t' => "tabs".to_owned(),
        ' ' => "blanks".to_owned(),
        c => format!("`{c}`"),
    };
    let decimal = if layout.decimal_comma { "decimal comma" } else { "decimal point" };
    let headers = if layout.headers.is_some() { "with headers" } else { "without headers" };
    format!(
        "{} columns between {separator}, {decimal}, {headers}, data from line {}",
        layout.columns,
        layout.first_row + 1
    )
}
