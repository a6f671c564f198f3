//! Text tables of numbers, as written by load cells, testing machines and spreadsheets.

mod clock;
mod columns;
mod encoding;
mod layout;
mod names;
mod number;
mod rows;

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::{Selection, TableLayout};
pub use clock::Clock;
use columns::Finder;
pub use columns::{Column, Columns};
use layout::Layout;
use needle_core::twin::Pose;

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
    /// A file in another format.
    #[error("{}: {what} is not read; make a CSV of it: {how}", .path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Its format.
        what: &'static str,
        /// How to convert it to a table.
        how: String,
    },
    /// The file contains no table.
    #[error(
        "{}: no rows of numbers were found in its first lines; say how it is laid out with --separator, --decimal-comma, \
         --header-line or --comment", .path.display()
    )]
    NoTable {
        /// The file.
        path: PathBuf,
    },
    /// Columns are ambiguous, or have no unit.
    #[error("{file}: {reason}. Its columns: {columns}")]
    Columns {
        /// The file.
        file: String,
        /// What is wrong, and what to do.
        reason: String,
        /// The columns of the file.
        columns: String,
    },
    /// No file has a required quantity.
    #[error("no column for the {what}: name it with {option}, by its header or its number from 1. {columns}")]
    Missing {
        /// The quantity.
        what: &'static str,
        /// The option that names its column.
        option: &'static str,
        /// Columns of all files.
        columns: String,
    },
    /// No file has a column that the user named.
    #[error("{option} {name}: there is no such column. {columns}")]
    NoColumn {
        /// The option that named it.
        option: &'static str,
        /// Its name.
        name: String,
        /// Columns of all files.
        columns: String,
    },
    /// One file has several recordings, or not the requested number.
    #[error("{file}: {reason}: {blocks}")]
    Blocks {
        /// The file.
        file: String,
        /// What is wrong, and what to do.
        reason: String,
        /// The recordings of the file.
        blocks: String,
    },
}

/// The rows of one file that were read.
#[derive(Debug, Default)]
pub struct Table {
    /// Its name.
    pub file: String,
    /// Description of the layout.
    pub layout: String,
    /// The columns that are used.
    pub columns: Columns,
    /// Description of all columns.
    pub all_columns: String,
    /// Number of data rows.
    pub rows: u64,
    /// Number of rows with a cell that is not a number.
    pub bad: u64,
    /// The first of these rows with its line number.
    pub first_bad: Option<String>,
    /// Irregularities without a loss of data.
    pub warnings: Vec<String>,
    /// Rows per second, if they have no time.
    pub rate_hz: Option<f64>,
    /// Columns that the user named, by their options, and that are not in this file.
    absent: Vec<(&'static str, String)>,
    /// First and last line, from 1.
    lines: [usize; 2],
    pub(super) depths: Vec<(i64, f64)>,
    pub(super) forces: Vec<(i64, [f64; 3])>,
    pub(super) poses: Vec<(i64, Pose)>,
    pub(super) markers: Vec<(i64, Vec<[f64; 3]>)>,
}

/// Rejects binary files, with a line of Python that converts them to a table.
fn refuse_foreign(path: &Path) -> Result<(), TableError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let file = path.display();
    let frame = |imports: &str, frame: &str| {
        format!("python -c \"import {imports}, pandas as p; p.{frame}.to_csv('{file}.csv', index=False)\"")
    };
    let variables = "DataFrame({k: v.ravel() for k, v in s.loadmat('FILE').items() if k[0] != '_'})";
    let datasets = "DataFrame({k: v[:].ravel() for k, v in h.File('FILE').items() if isinstance(v, h.Dataset)})";
    let (what, imports, code) = match extension.as_str() {
        "mat" if starts_with(path, b"MATLAB 7.3") => ("a MATLAB file of version 7.3", "h5py as h", datasets),
        "mat" => ("a MATLAB file (in MATLAB: writetable, writetimetable)", "scipy.io as s", variables),
        "xlsx" | "xls" | "ods" => ("a spreadsheet", "openpyxl", "read_excel('FILE')"),
        "npy" => ("an array of NumPy", "numpy as n", "DataFrame(n.load('FILE')).add_prefix('c')"),
        "npz" => ("an archive of NumPy", "numpy as n", "DataFrame(dict(n.load('FILE')))"),
        "h5" | "hdf5" => ("an HDF5 file", "h5py as h", datasets),
        "tdms" => ("a TDMS file", "nptdms as t", "DataFrame(t.TdmsFile.read('FILE').as_dataframe())"),
        "parquet" => ("a Parquet file", "pyarrow", "read_parquet('FILE')"),
        _ => return Ok(()),
    };
    let how = frame(imports, &code.replace("FILE", &file.to_string()));
    Err(TableError::Foreign { path: path.to_owned(), what, how })
}

/// Whether a file can be read and begins with these bytes.
fn starts_with(path: &Path, bytes: &[u8]) -> bool {
    let mut start = vec![0; bytes.len()];
    fs::File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok() && start == bytes)
}

impl Table {
    /// Reads one file of a recording; `file_number` is its index, from 0.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn read(path: &Path, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        Self::from_bytes(path, bytes_of(path)?, said, file_number)
    }

    /// Same as [`Table::read`], with the file's content given.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        let text = encoding::text(bytes);
        let text = text.trim_start_matches('\u{feff}');
        let file = path.display().to_string();
        let mut blocks = Blocks { text, said, file: &file, file_number, place: Some([0, 0]) };
        let no_table = || TableError::NoTable { path: path.to_owned() };
        let mut wanted = blocks.next().ok_or_else(no_table)??;
        let mut all = vec![wanted.extent()];
        for (number, block) in (2..).zip(blocks) {
            match block {
                Ok(block) => {
                    all.push(block.extent());
                    wanted = if said.layout.block == Some(number) { block } else { wanted };
                }
                // errors in the columns of a block that is not requested are ignored
                Err(error) if said.layout.block == Some(number) => return Err(error),
                Err(_) => all.push("of other columns".to_owned()),
            }
        }
        let reason = match (said.layout.block, all.len()) {
            (None, 2..) => "it holds several recordings: name the one to take with --block N",
            (Some(block), count) if !(1..=count).contains(&block) => "there is no such block (--block)",
            _ => return Ok(wanted),
        };
        let blocks = (1..).zip(all).map(|(n, extent): (usize, _)| format!("{n} is {extent}")).collect::<Vec<_>>();
        Err(TableError::Blocks { file: file.clone(), reason: reason.to_owned(), blocks: blocks.join(", ") })
    }

    /// Columns that the user named and that are not in this file.
    pub(super) fn absent(&self) -> &[(&'static str, String)] {
        &self.absent
    }

    fn extent(&self) -> String {
        let [first, last] = self.lines;
        format!("lines {first} to {last} ({} rows)", self.rows)
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, TableError> {
    refuse_foreign(path)?;
    fs::read(path).map_err(|source| TableError::Open { path: path.to_owned(), source })
}

/// Number of consecutive recordings in a file; 1 if it can't be determined.
#[must_use]
pub fn blocks(path: &Path, said: &Selection) -> usize {
    let Ok(bytes) = bytes_of(path) else { return 1 };
    let text = encoding::text(bytes);
    let file = path.display().to_string();
    Blocks { text: text.trim_start_matches('\u{feff}'), said, file: &file, file_number: 0, place: Some([0, 0]) }
        .count()
        .max(1)
}

/// The consecutive recordings in a text.
struct Blocks<'a> {
    text: &'a str,
    said: &'a Selection,
    file: &'a str,
    file_number: usize,
    /// Byte offset and line at which the next one begins.
    place: Option<[usize; 2]>,
}

impl Iterator for Blocks<'_> {
    type Item = Result<Table, TableError>;

    fn next(&mut self) -> Option<Self::Item> {
        let [byte, line] = self.place.take()?;
        // the header line that the user gave is that of the first block
        let header_line = self.said.layout.header_line.filter(|n| byte == 0 || *n == 0);
        let said = TableLayout { header_line, ..self.said.layout.clone() };
        let text = &self.text[byte..];
        let layout = Layout::of(text, &said)?;
        let finder = Finder { file: self.file, layout: &layout };
        let table = finder.find(self.said, self.file_number).and_then(|columns| {
            let named = columns::named(self.said);
            let gone = named.into_iter().filter_map(|(option, name)| match finder.named(name) {
                Ok(Some(_)) => None,
                Ok(None) => Some(Ok((option, name.to_owned()))),
                Err(error) => Some(Err(error)),
            });
            Ok(Table {
                file: self.file.to_owned(),
                layout: describe(&layout, line),
                all_columns: finder.describe(),
                absent: gone.collect::<Result<_, _>>()?,
                warnings: layout.note.iter().map(|note| format!("{}: {note}", self.file)).collect(),
                columns,
                ..Table::default()
            })
        });
        let mut table = match table {
            Ok(table) => table,
            Err(error) => return Some(Err(error)),
        };
        let rate_hz = self.said.rate_hz.or_else(|| layout.step_s.map(|step| step.recip()));
        let rate_hz = rate_hz.filter(|_| table.columns.time.is_none());
        table.rate_hz = rate_hz;
        let end = table.take(text, &layout, line, rate_hz);
        self.place = end.map(|[b, l]| [byte + b, l]);
        Some(table.believable().map(|()| table))
    }
}

fn describe(layout: &Layout, line: usize) -> String {
    let separator = match layout.separator {
        '\t' => "tabs".to_owned(),
        ' ' => "blanks".to_owned(),
        c => format!("`{c}`"),
    };
    let decimal = if layout.decimal_comma { "decimal comma" } else { "decimal point" };
    let headers = if layout.headers.is_some() { "with headers" } else { "without headers" };
    let step = layout.step_s.map_or_else(String::new, |step| format!(", a row each {step} s"));
    format!(
        "{} columns between {separator}, {decimal}, {headers}, data from line {}{step}",
        layout.columns,
        line + layout.first_row + 1
    )
}
