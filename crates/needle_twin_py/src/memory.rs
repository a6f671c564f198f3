//! Tables in memory: columns by their headers, frames and arrays, as the text that a table is read from.

use std::fmt::Write as _;

use needle_recording::TableLayout;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyMapping, PySlice};

/// A table as text.
pub(crate) struct Memory {
    /// For messages.
    pub name: &'static str,
    pub text: String,
    /// Whether the first line has headers.
    headers: bool,
}

impl Memory {
    /// Says how the text is laid out, so that nothing is guessed.
    pub(crate) fn lay_out(&self, layout: &mut TableLayout) {
        layout.separator.get_or_insert(',');
        layout.decimal_comma.get_or_insert(false);
        layout.header_line.get_or_insert(usize::from(self.headers));
    }
}

/// The table, if what was given is one and no path.
pub(crate) fn of(given: &Bound<'_, PyAny>) -> PyResult<Option<Memory>> {
    let frame = |text: String| Ok(Some(Memory { name: "the frame", text, headers: true }));
    if given.hasattr("to_csv")? {
        // an index that only counts the rows is no column
        let counts = given.getattr("index").and_then(|index| index.get_type().name()?.extract::<String>());
        let arguments = PyDict::new(given.py());
        arguments.set_item("index", counts.map_or(true, |name| name != "RangeIndex"))?;
        return frame(given.call_method("to_csv", (), Some(&arguments))?.extract()?);
    }
    if given.hasattr("write_csv")? {
        return frame(given.call_method0("write_csv")?.extract()?);
    }
    if let Ok(columns) = given.cast::<PyMapping>() {
        let mut named = Vec::new();
        for pair in columns.items()?.iter() {
            named.push((pair.get_item(0)?.extract::<String>()?, pair.get_item(1)?));
        }
        let text = of_columns(given.py(), &named)?;
        return Ok(Some(Memory { name: "the columns", text, headers: true }));
    }
    if !given.hasattr("__array_interface__")? {
        return Ok(None);
    }
    let names = given.getattr("dtype")?.getattr("names")?;
    if !names.is_none() {
        let names: Vec<String> = names.extract()?;
        let column = |name: String| given.get_item(&name).map(|column| (name, column));
        let columns = names.into_iter().map(column).collect::<PyResult<Vec<_>>>()?;
        let text = of_columns(given.py(), &columns)?;
        return Ok(Some(Memory { name: "the array", text, headers: true }));
    }
    if given.getattr("ndim")?.extract::<usize>()? != 2 {
        return Err(PyValueError::new_err("an array of a recording has two dimensions: a row for each reading"));
    }
    let columns = given.getattr("T")?.try_iter()?.map(|column| column.map(|column| (String::new(), column)));
    let mut text = of_columns(given.py(), &columns.collect::<PyResult<Vec<_>>>()?)?;
    text.drain(..=text.find('\n').unwrap_or_default());
    Ok(Some(Memory { name: "the array", text, headers: false }))
}

/// Rows of which the cells are objects of Python at once.
const ROWS: usize = 1 << 14;

fn of_columns<'py>(py: Python<'py>, columns: &[(String, Bound<'py, PyAny>)]) -> PyResult<String> {
    let numpy = py.import("numpy")?;
    let array = |(_, column): &(String, Bound<'py, PyAny>)| {
        let array = numpy.call_method1("asarray", (column,))?;
        let rows = array.len().map_err(|_| PyValueError::new_err("a column is a list of cells"))?;
        Ok::<_, PyErr>((array, rows))
    };
    let arrays = columns.iter().map(array).collect::<PyResult<Vec<_>>>()?;
    let rows = arrays.first().map_or(0, |(_, rows)| *rows);
    if let Some(((name, _), (_, other))) = columns.iter().zip(&arrays).find(|(_, (_, other))| *other != rows) {
        let first = &columns[0].0;
        return Err(PyValueError::new_err(format!(
            "column {name:?} has {other} rows, and {first:?} has {rows}: give readings of two rates as two files"
        )));
    }
    let mut text = columns.iter().map(|(name, _)| quoted(name)).collect::<Vec<_>>().join(",");
    for from in (0..rows).step_by(ROWS) {
        let part = PySlice::new(py, from as isize, (from + ROWS).min(rows) as isize, 1);
        let list = |(array, _): &(Bound<'py, PyAny>, usize)| {
            Ok::<_, PyErr>(array.get_item(&part)?.call_method0("tolist")?.cast_into::<PyList>()?)
        };
        let lists = arrays.iter().map(list).collect::<PyResult<Vec<_>>>()?;
        for row in 0..(rows - from).min(ROWS) {
            for (column, list) in lists.iter().enumerate() {
                text.push(if column == 0 { '\n' } else { ',' });
                add(&list.get_item(row)?, &mut text)?;
            }
        }
    }
    text.push('\n');
    Ok(text)
}

/// A cell as it stands in a table: all digits of a number, and nothing where nothing was measured.
fn add(cell: &Bound<'_, PyAny>, text: &mut String) -> PyResult<()> {
    match cell.extract::<f64>() {
        Ok(number) if number.is_nan() => {}
        Ok(number) => write!(text, "{number}").map_err(|error| PyValueError::new_err(error.to_string()))?,
        Err(_) if cell.is_none() => {}
        Err(_) => text.push_str(&quoted(&cell.str()?.extract::<String>()?)),
    }
    Ok(())
}

fn quoted(text: &str) -> String {
    let plain = !text.contains([',', '"', '\n']);
    if plain { text.to_owned() } else { format!("\"{}\"", text.replace('"', "\"\"")) }
}
