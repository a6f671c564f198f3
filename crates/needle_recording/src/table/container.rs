//! Binary tables: spreadsheets, arrays of NumPy, variables of MATLAB. Each is converted to text, so that all tables
//! are read in the same way.

use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

use calamine::{Data, Reader as _, open_workbook_auto_from_rs};
use matfile::{MatFile, NumericData};
use npyz::NpyFile;

use super::TableError;

/// A column with its name.
type Named = (String, Vec<f64>);

/// Content of a file as a tab-separated table; text is returned unchanged.
///
/// # Errors
/// [`TableError::Foreign`] for a file that can't be read here; the message names a converter.
pub(super) fn as_text(path: &Path, bytes: Vec<u8>) -> Result<Vec<u8>, TableError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let file = path.display();
    let foreign = |what: &'static str, how: String| Err(TableError::Foreign { path: path.to_owned(), what, how });
    let python = |code: String| format!("python -c \"{code}\"");
    let hdf5 = || {
        python(format!(
            "import h5py, pandas as pd; f = h5py.File('{file}'); pd.DataFrame({{k: v[:].ravel() for k, v in f.items() if isinstance(v, \
             h5py.Dataset)}}).to_csv('{file}.csv', index=False)"
        ))
    };
    let read = match extension.as_str() {
        "xlsx" | "xls" | "xlsb" | "ods" => spreadsheet(bytes),
        "npy" => array(&bytes).map(|columns| text_of(&columns, false)),
        "npz" => archive(bytes).map(|columns| text_of(&columns, true)),
        "mat" if bytes.get(..10) == Some(b"MATLAB 7.3") => return foreign("a MATLAB file of version 7.3", hdf5()),
        "mat" => variables(&bytes).map(|columns| text_of(&columns, true)),
        "h5" | "hdf5" => return foreign("an HDF5 file", hdf5()),
        "tdms" => {
            let code = format!("from nptdms import TdmsFile; TdmsFile.read('{file}').as_dataframe().to_csv('{file}.csv', index=False)");
            return foreign("a TDMS file", python(code));
        }
        "parquet" => {
            return foreign("a Parquet file", python(format!("import pandas; pandas.read_parquet('{file}').to_csv('{file}.csv', index=False)")));
        }
        _ => return Ok(bytes),
    };
    match (read, extension.as_str()) {
        (Some(text), _) => Ok(text.into_bytes()),
        (None, "mat") => foreign("a MATLAB file without columns of numbers", "in MATLAB: writetable, writetimetable or writematrix".to_owned()),
        (None, "npy" | "npz") => {
            let code = format!("import numpy as n, pandas as p; p.DataFrame(n.load('{file}')).to_csv('{file}.csv', index=False)");
            foreign("an array that is not of plain numbers", python(code))
        }
        (None, _) => foreign("a spreadsheet that can't be opened", "in the spreadsheet program: save as CSV".to_owned()),
    }
}

/// Columns of equal length with their names, as text.
fn text_of(columns: &[Named], headers: bool) -> String {
    let rows = columns.iter().map(|(_, values)| values.len()).max().unwrap_or(0);
    let columns: Vec<&Named> = columns.iter().filter(|(_, values)| values.len() == rows).collect();
    let mut text = String::new();
    if headers {
        let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
        text = names.join("\t") + "\n";
    }
    for row in 0..rows {
        for (k, (_, values)) in columns.iter().enumerate() {
            let tab = if k == 0 { "" } else { "\t" };
            let _ = write!(text, "{tab}{}", values[row]); // writing to a String can't fail
        }
        text.push('\n');
    }
    text
}

/// The first sheet.
fn spreadsheet(bytes: Vec<u8>) -> Option<String> {
    let mut book = open_workbook_auto_from_rs(Cursor::new(bytes)).ok()?;
    let sheet = book.worksheet_range_at(0)?.ok()?;
    let row = |row: &[Data]| row.iter().map(cell).collect::<Vec<_>>().join("\t") + "\n";
    Some(sheet.rows().map(row).collect())
}

fn cell(cell: &Data) -> String {
    match cell {
        Data::DateTime(time) if time.is_duration() => format!("{}", time.as_f64() * 86_400.0),
        Data::DateTime(time) => date(time.as_f64()),
        other => other.to_string().replace(['\t', '\n', '\r'], " "),
    }
}

/// Days since 1899-12-30 as date and time of day; a number below one is a time of day.
fn date(days: f64) -> String {
    let zero = chrono::NaiveDate::from_ymd_opt(1899, 12, 30).and_then(|day| day.and_hms_opt(0, 0, 0));
    let since = chrono::TimeDelta::try_milliseconds((days * 86_400_000.0).round() as i64);
    let time = zero.zip(since).and_then(|(zero, since)| zero.checked_add_signed(since));
    let format = if days < 1.0 { "%H:%M:%S%.3f" } else { "%Y-%m-%d %H:%M:%S%.3f" };
    time.map_or_else(String::new, |time| time.format(format).to_string())
}

/// The numbers of an array in row-major order, and its shape.
fn numbers<R: std::io::Read>(file: NpyFile<R>) -> Option<(Vec<f64>, Vec<u64>)> {
    let (shape, rows_first) = (file.shape().to_vec(), file.order() == npyz::Order::C);
    let all = match file.try_data::<f64>() {
        Ok(data) => data.collect::<Result<Vec<f64>, _>>().ok()?,
        Err(file) => match file.try_data::<f32>() {
            Ok(data) => data.map(|x| x.map(f64::from)).collect::<Result<_, _>>().ok()?,
            Err(file) => match file.try_data::<i32>() {
                Ok(data) => data.map(|x| x.map(f64::from)).collect::<Result<_, _>>().ok()?,
                Err(file) => file.try_data::<i64>().ok()?.map(|x| x.map(|x| x as f64)).collect::<Result<_, _>>().ok()?,
            },
        },
    };
    let columns = usize::try_from(shape.get(1).copied().unwrap_or(1)).ok()?;
    let rows = all.len().checked_div(columns)?;
    let ordered = if rows_first { all } else { (0..all.len()).map(|i| all[i % columns * rows + i / columns]).collect() };
    Some((ordered, shape))
}

/// Columns of an array of one or two dimensions.
fn columns(name: &str, (values, shape): (Vec<f64>, Vec<u64>)) -> Option<Vec<Named>> {
    let width = match shape[..] {
        [_] => 1,
        [_, width] => usize::try_from(width).ok().filter(|w| *w > 0)?,
        _ => return None,
    };
    let one = |k: usize| {
        let name = if width == 1 { name.to_owned() } else { format!("{name}_{}", k + 1) };
        (name, values.iter().skip(k).step_by(width).copied().collect())
    };
    Some((0..width).map(one).collect())
}

fn array(bytes: &[u8]) -> Option<Vec<Named>> {
    columns("", numbers(NpyFile::new(bytes).ok()?)?)
}

fn archive(bytes: Vec<u8>) -> Option<Vec<Named>> {
    let mut archive = npyz::npz::NpzArchive::new(Cursor::new(bytes)).ok()?;
    let names: Vec<String> = archive.array_names().map(str::to_owned).collect();
    let mut all = Vec::new();
    for name in names {
        let found = archive.by_name(&name).ok().flatten().and_then(numbers);
        all.extend(found.and_then(|found| columns(&name, found)).unwrap_or_default());
    }
    (!all.is_empty()).then_some(all)
}

/// Vectors and matrices of a MATLAB file of version 5. A row vector also becomes a column.
fn variables(bytes: &[u8]) -> Option<Vec<Named>> {
    let file = MatFile::parse(bytes).ok()?;
    let all = file.arrays().iter().filter_map(|array| {
        let values = real(array.data())?;
        let (rows, width) = match array.size()[..] {
            [1, n] | [n, 1] => (n, 1),
            [rows, width] => (rows, width),
            _ => return None,
        };
        // MATLAB's order is column-major
        let by_rows = (0..values.len()).map(|i| values[i % width * rows + i / width]).collect();
        columns(array.name(), (by_rows, vec![rows as u64, width as u64]))
    });
    let all: Vec<Named> = all.flatten().filter(|(_, values)| values.len() > 1).collect();
    (!all.is_empty()).then_some(all)
}

fn real(data: &NumericData) -> Option<Vec<f64>> {
    Some(match data {
        NumericData::Double { real, .. } => real.clone(),
        NumericData::Single { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::Int8 { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::UInt8 { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::Int16 { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::UInt16 { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::Int32 { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::UInt32 { real, .. } => real.iter().map(|x| f64::from(*x)).collect(),
        NumericData::Int64 { real, .. } => real.iter().map(|x| *x as f64).collect(),
        NumericData::UInt64 { real, .. } => real.iter().map(|x| *x as f64).collect(),
    })
}
