//! What a file is: text, a workbook, arrays of NumPy, or a file of another program with the one command that converts it.

use std::fs;
use std::io::Read as _;
use std::path::Path;

use super::super::TableLayout;
use super::text::Text;
use super::{TableError, arrays};

/// A table that can be read as text, and how.
pub(super) struct Source {
    pub text: Text,
    /// What it is besides its text, in words.
    pub what: String,
    pub layout: TableLayout,
    /// What of it is left out.
    pub notes: Vec<String>,
}

/// What a file is by its name.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Text,
    Workbook,
    Array,
    Archive,
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

impl Form {
    fn of(path: &Path) -> Self {
        match extension(path).as_str() {
            "xlsx" | "xlsm" if cfg!(feature = "xlsx") => Self::Workbook,
            "npy" => Self::Array,
            "npz" => Self::Archive,
            _ => Self::Text,
        }
    }
}

impl Source {
    /// # Errors
    /// If the file can't be read, or is of another program.
    pub(crate) fn of_file(path: &Path, said: &TableLayout) -> Result<Self, TableError> {
        refuse_foreign(path)?;
        let open = |source| TableError::Open { path: path.to_owned(), source };
        match Form::of(path) {
            Form::Text => Ok(Self::plain(Text::of_file(path).map_err(open)?, said)),
            _ => Self::of_bytes(path, fs::read(path).map_err(open)?, said),
        }
    }

    /// As [`Source::of_file`], from what the file holds.
    ///
    /// # Errors
    /// As [`Source::of_file`].
    pub(crate) fn of_bytes(path: &Path, bytes: Vec<u8>, said: &TableLayout) -> Result<Self, TableError> {
        let contents = |reason| TableError::Contents { path: path.to_owned(), reason };
        match Form::of(path) {
            Form::Text => {
                let open = |source| TableError::Open { path: path.to_owned(), source };
                Ok(Self::plain(Text::of_bytes(bytes).map_err(open)?, said))
            }
            #[cfg(feature = "xlsx")]
            Form::Workbook => {
                let sheet = super::workbook::read(bytes, said).map_err(contents)?;
                let layout = TableLayout { separator: Some('\t'), ..said.clone() };
                let text = Text::made(std::io::Cursor::new(sheet.text));
                Ok(Self { text, what: format!("sheet `{}`, ", sheet.name), layout, notes: sheet.notes })
            }
            form => {
                let found = if form == Form::Array { arrays::array(bytes) } else { arrays::archive(bytes) };
                let found = found.map_err(contents)?;
                let header_line = Some(usize::from(found.has_names()));
                let layout =
                    TableLayout { separator: Some('\t'), decimal_comma: Some(false), header_line, ..said.clone() };
                let (notes, what) = (found.notes.clone(), "arrays of NumPy, ".to_owned());
                Ok(Self { text: Text::made(found), what, layout, notes })
            }
        }
    }

    fn plain(text: Text, said: &TableLayout) -> Self {
        Self { text, what: String::new(), layout: said.clone(), notes: Vec::new() }
    }
}

/// Bytes of a file of text that can be read twice; `None` of a workbook, of arrays, of a pipe.
pub(in super::super) fn size_of_text(path: &Path) -> Option<u64> {
    let found = fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
    (Form::of(path) == Form::Text).then_some(found.len())
}

/// Refuses options that have no meaning for any of the files.
///
/// # Errors
/// [`TableError::NotHere`].
pub(super) fn refuse_options<'a>(
    paths: impl Iterator<Item = &'a Path> + Clone,
    said: &TableLayout,
) -> Result<(), TableError> {
    let Some(first) = paths.clone().next() else { return Ok(()) };
    let none = |forms: &[Form]| !paths.clone().any(|path| forms.contains(&Form::of(path)));
    let text = [Form::Text];
    let options = [
        ("--sheet", said.sheet.is_some() && none(&[Form::Workbook]), "sheets are of .xlsx files; leave it out"),
        ("--separator", said.separator.is_some() && none(&text), "its cells are not text; leave it out"),
        (
            "--header-line",
            said.header_line.is_some() && none(&[Form::Text, Form::Workbook]),
            "its columns have names, or numbers from 1",
        ),
    ];
    let wrong = options.into_iter().find(|(_, wrong, _)| *wrong);
    wrong.map_or(Ok(()), |(option, _, remedy)| Err(TableError::NotHere { option, path: first.to_owned(), remedy }))
}

/// Files that are read as text only when another program has made text of them, with the one line of Python that does it.
fn refuse_foreign(path: &Path) -> Result<(), TableError> {
    let file = path.display();
    let frame = |imports: &str, frame: &str| {
        format!("python -c \"import {imports}, pandas as p; p.{frame}.to_csv('{file}.csv', index=False)\"")
    };
    let variables = "DataFrame({k: v.ravel() for k, v in s.loadmat('FILE').items() if k[0] != '_'})";
    let datasets = "DataFrame({k: v[:].ravel() for k, v in h.File('FILE').items() if isinstance(v, h.Dataset)})";
    let (what, imports, code) = match extension(path).as_str() {
        "mat" if starts_with(path, b"MATLAB 7.3") => ("a MATLAB file of version 7.3", "h5py as h", datasets),
        "mat" => ("a MATLAB file (in MATLAB: writetable, writetimetable)", "scipy.io as s", variables),
        "xlsx" | "xlsm" if cfg!(feature = "xlsx") => return Ok(()),
        "xlsx" | "xlsm" | "xls" | "xlsb" | "ods" => ("such a spreadsheet", "openpyxl", "read_excel('FILE')"),
        "h5" | "hdf5" => ("an HDF5 file", "h5py as h", datasets),
        "tdms" => ("a TDMS file", "nptdms as t", "DataFrame(t.TdmsFile.read('FILE').as_dataframe())"),
        "parquet" => ("a Parquet file", "pyarrow", "read_parquet('FILE')"),
        _ => return Ok(()),
    };
    let how = frame(imports, &code.replace("FILE", &file.to_string()));
    Err(TableError::Foreign { path: path.to_owned(), what, how })
}

/// Whether a file can be read and begins so.
fn starts_with(path: &Path, bytes: &[u8]) -> bool {
    let mut start = vec![0; bytes.len()];
    fs::File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok() && start == bytes)
}
