//! What a file is: text, a workbook, arrays of NumPy, or a file of another program with the one command that converts it.

use std::fs;
use std::io::{Cursor, Read as _};
use std::path::Path;

use super::super::TableLayout;
use super::arrays;
use super::error::TableError;
use super::records::{self, Records};
use super::sheets::{self, Sheet};
use super::text::Text;

/// Bytes by which a file is known.
const START: usize = 4096;
/// What is among the first files of a workbook.
const WORKBOOKS: [&[u8]; 5] =
    [b"[Content_Types].xml", b"_rels/.rels", b"docProps/", b"xl/", b"mimetypeapplication/vnd"];

/// A table that can be read as text, and how.
pub(super) struct Source {
    pub text: Text,
    /// What it is besides its text, in words.
    pub what: String,
    pub layout: TableLayout,
    /// What of it is left out.
    pub notes: Vec<String>,
    /// Number of rows that are lost already, and the first of them with its line.
    pub bad: u64,
    pub first_bad: Option<String>,
}

/// What a file is, by its name and its first bytes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Text,
    Workbook,
    /// A workbook in XML, of 2003.
    Sheets,
    Array,
    Archive,
    Json,
    /// What `ros2 topic echo` prints.
    Echo,
    /// Lines of names and numbers.
    Labelled,
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

impl Form {
    fn of(path: &Path, start: &[u8]) -> Self {
        match extension(path).as_str() {
            "xlsx" | "xlsm" if cfg!(feature = "xlsx") => Self::Workbook,
            "npy" => Self::Array,
            "npz" => Self::Archive,
            _ if sheets::is_workbook(start) => Self::Sheets,
            "json" | "jsonl" | "ndjson" if !is_binary(start) => Self::Json,
            _ if records::is_json(start) => Self::Json,
            _ if records::is_echo(start) => Self::Echo,
            _ if records::is_labelled(start) => Self::Labelled,
            _ => Self::Text,
        }
    }

    fn of_file(path: &Path) -> Self {
        Self::of(path, &start(path))
    }
}

impl Source {
    /// # Errors
    /// If the file can't be read, or is of another program.
    pub(crate) fn of_file(path: &Path, said: &TableLayout) -> Result<Self, TableError> {
        refuse_foreign(path)?;
        let open = |source| TableError::Open { path: path.to_owned(), source };
        match Form::of_file(path) {
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
        let of_records = |made: Result<Records, String>, what: &str| {
            let Records { text, has_names, bad, first_bad } = made.map_err(contents)?;
            let (separator, decimal_comma) = (Some('\t'), Some(false));
            let header_line = Some(usize::from(has_names));
            let layout = TableLayout { separator, decimal_comma, header_line, ..said.clone() };
            let text = Text::made(Cursor::new(text));
            Ok(Self { text, what: what.to_owned(), layout, notes: Vec::new(), bad, first_bad })
        };
        match Form::of(path, &bytes[..bytes.len().min(START)]) {
            Form::Json => of_records(records::of_json(&bytes), "JSON, "),
            Form::Echo => of_records(records::of_echo(&bytes), "as of `ros2 topic echo`, "),
            Form::Labelled => of_records(records::of_labelled(&bytes), "values with their names, "),
            Form::Text => {
                let open = |source| TableError::Open { path: path.to_owned(), source };
                Ok(Self::plain(Text::of_bytes(bytes).map_err(open)?, said))
            }
            Form::Sheets => Ok(Self::sheet(sheets::read(&bytes, said).map_err(contents)?, said)),
            #[cfg(feature = "xlsx")]
            Form::Workbook => Ok(Self::sheet(super::workbook::read(bytes, said).map_err(contents)?, said)),
            form => {
                let found = if form == Form::Array { arrays::array(bytes) } else { arrays::archive(bytes) };
                let found = found.map_err(contents)?;
                let header_line = Some(usize::from(found.has_names()));
                let layout =
                    TableLayout { separator: Some('\t'), decimal_comma: Some(false), header_line, ..said.clone() };
                let (notes, what) = (found.notes.clone(), "arrays of NumPy, ".to_owned());
                Ok(Self { what, layout, notes, ..Self::plain(Text::made(found), said) })
            }
        }
    }

    fn plain(text: Text, said: &TableLayout) -> Self {
        Self { text, what: String::new(), layout: said.clone(), notes: Vec::new(), bad: 0, first_bad: None }
    }

    fn sheet(sheet: Sheet, said: &TableLayout) -> Self {
        let layout = TableLayout { separator: Some('\t'), ..said.clone() };
        let (what, notes) = (format!("sheet `{}`, ", sheet.name), sheet.notes);
        Self { what, layout, notes, ..Self::plain(Text::made(Cursor::new(sheet.text)), said) }
    }
}

/// Bytes of a file of text that can be read twice; `None` of a workbook, of arrays, of a pipe.
pub(in super::super) fn size_of_text(path: &Path) -> Option<u64> {
    let found = fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
    (Form::of_file(path) == Form::Text).then_some(found.len())
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
    let none = |forms: &[Form]| !paths.clone().any(|path| forms.contains(&Form::of_file(path)));
    let text = [Form::Text];
    let options = [
        (
            "--sheet",
            said.sheet.is_some() && none(&[Form::Workbook, Form::Sheets]),
            "sheets are of workbooks; leave it out",
        ),
        ("--separator", said.separator.is_some() && none(&text), "its cells are not text; leave it out"),
        (
            "--header-line",
            said.header_line.is_some() && none(&[Form::Text, Form::Workbook, Form::Sheets]),
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
    let has = |part: &[u8]| start.windows(part.len()).any(|bytes| bytes == part);
    let contents = |reason: &str| Err(TableError::Contents { path: path.to_owned(), reason: reason.to_owned() });
    let (what, imports, code) = match extension(path).as_str() {
        "mat" if begins(b"MATLAB 7.3") => ("a MATLAB file of version 7.3", "h5py as h, numpy as n", turned.as_str()),
        "mat" => {
            ("a MATLAB file (in MATLAB: writetable, writetimetable)", "scipy.io as s, numpy as n", variables.as_str())
        }
        "xlsx" | "xlsm" if cfg!(feature = "xlsx") => return Ok(()),
        _ if Form::of(path, &start) != Form::Text => return Ok(()),
        _ if start.is_empty() && fs::metadata(path).is_ok_and(|found| found.is_file()) => {
            return contents("it is empty: export it again");
        }
        _ if begins(b"version https://git-lfs.github.com/") => {
            return contents("it only names a file that Git LFS keeps: fetch that (git lfs pull)");
        }
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
        _ if begins(b"<?xml") => ("an XML file", "lxml", "read_xml('FILE')"),
        _ if begins(b"PAR1") => ("a Parquet file", "pyarrow", "read_parquet('FILE')"),
        _ if begins(b"ARROW1") => ("an Arrow file", "pyarrow", "read_feather('FILE')"),
        _ if begins(b"PK\x03\x04") && !WORKBOOKS.iter().any(|part| has(part)) => {
            return contents("it is an archive: unpack it (unzip), and give the table");
        }
        _ if begins(b"PK\x03\x04") => {
            ("such a spreadsheet under another name than .xlsx", "openpyxl", "read_excel('FILE')")
        }
        _ if begins(b"\x1f\x8b") || begins(b"BZh") || begins(b"\xfd7zXZ") || begins(b"\x28\xb5\x2f\xfd") => {
            return contents("it is compressed: unpack it (gunzip, bunzip2, unxz, unzstd), and give the table");
        }
        _ if is_binary(&start) => {
            return contents("it is binary and no text: export it as CSV, or give arrays of NumPy (.npy, .npz)");
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
        let _ = file.take(START as u64).read_to_end(&mut start);
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
