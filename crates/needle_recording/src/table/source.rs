//! What a file is: text, a workbook, arrays of NumPy, or a file of another program with the one command that converts it.

use std::fs;
use std::io::Read as _;
use std::path::Path;

use super::super::TableLayout;
use super::text::Text;
use super::{arrays, error::TableError};

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
    // columns of several lengths beside each other: vectors by their names, matrices, structures, what lies in groups
    let named = |array: &str, mark: char| {
        let name = format!("k.split('{mark}')[-1] + str(i or '')");
        format!("p.DataFrame({array}).rename(columns=lambda i: i if isinstance(i, str) else {name})")
    };
    let variables = format!(
        "concat([{} for k, v in p.json_normalize(s.loadmat('FILE', simplify_cells=True)).iloc[0].items() \
         if n.size(v) > 1 and k[0] != '_'], axis=1)",
        named("v", '.')
    );
    let datasets = |array: &str| {
        format!(
            "concat((lambda c: h.File('FILE').visititems(lambda k, v: c.append({}) if isinstance(v, h.Dataset) and v.size > 1 \
             else None) or c)([]), axis=1)",
            named(array, '/')
        )
    };
    // MATLAB stores columns first
    let (turned, datasets) = (datasets("n.squeeze(v[()]).T"), datasets("n.squeeze(v[()])"));
    let channels = "DataFrame(t.TdmsFile.read('FILE').as_dataframe()).rename(columns=lambda c: c.split(chr(39))[-2])";
    let start = start(path);
    let begins = |with: &[u8]| start.starts_with(with);
    let (what, imports, code) = match extension(path).as_str() {
        "mat" if begins(b"MATLAB 7.3") => ("a MATLAB file of version 7.3", "h5py as h, numpy as n", turned.as_str()),
        "mat" => {
            ("a MATLAB file (in MATLAB: writetable, writetimetable)", "scipy.io as s, numpy as n", variables.as_str())
        }
        "xlsx" | "xlsm" if cfg!(feature = "xlsx") => return Ok(()),
        _ if is_html(&start) => ("a page of HTML", "lxml", "read_html('FILE')[0]"),
        // many programs write text under this name
        "xls" if is_text(&start) => return Ok(()),
        "xls" => ("such a spreadsheet", "xlrd", "read_excel('FILE')"),
        "xlsb" => ("such a spreadsheet", "pyxlsb", "read_excel('FILE')"),
        "ods" => ("such a spreadsheet", "odf", "read_excel('FILE')"),
        "xlsx" | "xlsm" => ("such a spreadsheet", "openpyxl", "read_excel('FILE')"),
        "h5" | "hdf5" => ("an HDF5 file", "h5py as h, numpy as n", datasets.as_str()),
        "tdms" => ("a TDMS file", "nptdms as t", channels),
        "parquet" => ("a Parquet file", "pyarrow", "read_parquet('FILE')"),
        "pkl" | "pickle" => ("a pickle of Python", "pickle", "DataFrame(p.read_pickle('FILE'))"),
        "npy" | "npz" => return Ok(()),
        // under whatever name
        _ if begins(b"\x89HDF") => ("an HDF5 file", "h5py as h, numpy as n", datasets.as_str()),
        _ if begins(b"MATLAB 7.3") => ("a MATLAB file of version 7.3", "h5py as h, numpy as n", turned.as_str()),
        _ if begins(b"MATLAB 5.0") => {
            ("a MATLAB file (in MATLAB: writetable, writetimetable)", "scipy.io as s, numpy as n", variables.as_str())
        }
        _ if begins(b"TDSm") => ("a TDMS file", "nptdms as t", channels),
        _ if begins(b"{\"") => ("a JSON file of lines", "json", "read_json('FILE', lines=True)"),
        _ if begins(b"[{") => ("a JSON file", "json", "read_json('FILE')"),
        _ if begins(b"PAR1") => ("a Parquet file", "pyarrow", "read_parquet('FILE')"),
        _ if begins(b"ARROW1") => ("an Arrow file", "pyarrow", "read_feather('FILE')"),
        _ if begins(b"PK\x03\x04") => {
            ("such a spreadsheet under another name than .xlsx", "openpyxl", "read_excel('FILE')")
        }
        _ if begins(b"\x1f\x8b") || begins(b"BZh") || begins(b"\xfd7zXZ") || begins(b"\x28\xb5\x2f\xfd") => {
            let reason = "it is compressed: unpack it (gunzip, bunzip2, unxz, unzstd), and give the table".to_owned();
            return Err(TableError::Contents { path: path.to_owned(), reason });
        }
        _ if is_binary(&start) => {
            let reason = "it is binary and no text: export it as CSV, or give arrays of NumPy (.npy, .npz)".to_owned();
            return Err(TableError::Contents { path: path.to_owned(), reason });
        }
        _ => return Ok(()),
    };
    let how = frame(imports, &code.replace("FILE", &file.to_string()));
    Err(TableError::Foreign { path: path.to_owned(), what, how })
}

/// The first bytes of a file; none of a pipe, which can be read only once.
fn start(path: &Path) -> Vec<u8> {
    let mut start = Vec::new();
    if fs::metadata(path).is_ok_and(|found| found.is_file())
        && let Ok(file) = fs::File::open(path)
    {
        // what can't be read is said where it is opened
        let _ = file.take(4096).read_to_end(&mut start);
    }
    start
}

/// Whether bytes begin a page with a table.
fn is_html(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start).to_lowercase();
    text.trim_start_matches(['\u{feff}', ' ', '\r', '\n']).starts_with('<')
        && (text.contains("<html") || text.contains("<table"))
}

/// Whether bytes are lines of text.
fn is_text(start: &[u8]) -> bool {
    start.contains(&b'\n') && !is_binary(start) && !start.starts_with(b"PK") && !start.starts_with(b"\xd0\xcf\x11\xe0")
}

/// Whether bytes are no text in any encoding. Logs of serial lines have control characters, and UTF-16 has zeros.
fn is_binary(start: &[u8]) -> bool {
    let control = |b: &u8| matches!(b, 1..=8 | 14..=26);
    let utf_16 = start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]);
    !utf_16 && start.contains(&0) && start.iter().any(control)
}
