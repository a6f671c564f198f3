//! Workbooks of spreadsheet programs (`.xlsx`): a sheet as text between tabs.
//!
//! Rows and columns keep their places, so that a line of the text is a row of the sheet. Numbers are written so that they are the same
//! with a decimal point and with a decimal comma: cells that hold text have either.

use std::fmt::Write as _;
use std::io::Cursor;

use calamine::{DataRef, ExcelDateTime, Reader as _, Xlsx};
use chrono::{Datelike as _, NaiveDate, NaiveDateTime, NaiveTime, TimeDelta};

use super::super::TableLayout;
use super::sheets::{Sheet, choose, plain};

/// A sheet of more text is not taken.
const MOST_BYTES: usize = 1 << 30;
/// Whole numbers up to here are written as such.
const WHOLE: f64 = 1e15;

type Workbook = Xlsx<Cursor<Vec<u8>>>;

/// The sheet that was named, or the first with rows of numbers.
///
/// # Errors
/// Why there is none, and what to do.
pub(super) fn read(bytes: Vec<u8>, said: &TableLayout) -> Result<Sheet, String> {
    let mut book: Workbook = Xlsx::new(Cursor::new(bytes))
        .map_err(|e| format!("the workbook can't be opened ({e}): save it as .xlsx without a password, or as CSV"))?;
    let names = book.sheet_names();
    choose(&names, said, |name, rows| text(&mut book, name, rows))
}

/// The first rows of a sheet.
fn text(book: &mut Workbook, name: &str, rows: usize) -> Result<String, String> {
    let broken = |e| format!("sheet `{name}` can't be read ({e}): save it as CSV");
    let mut cells = book.worksheet_cells_reader(name).map_err(broken)?;
    let (mut text, mut row, mut column) = (String::new(), 0, 0);
    while let Some(cell) = cells.next_cell().map_err(broken)? {
        let (of_row, of_column) = cell.get_position();
        if *cell.get_value() == DataRef::Empty {
            continue;
        }
        if (of_row, of_column) < (row, column) {
            return Err(format!("sheet `{name}` has its cells in no order: open and save it, or save it as CSV"));
        }
        if of_row as usize >= rows {
            break;
        }
        if of_row > row {
            text.extend(std::iter::repeat_n('\n', (of_row - row) as usize));
            (row, column) = (of_row, 0);
        }
        text.extend(std::iter::repeat_n('\t', (of_column - column) as usize));
        column = of_column;
        write(cell.get_value(), &mut text);
        if text.len() > MOST_BYTES {
            return Err(format!(
                "sheet `{name}` holds more than 1 GiB of text: save it as CSV, which is read piece by piece"
            ));
        }
    }
    text.push('\n');
    Ok(text)
}

fn write(cell: &DataRef, out: &mut String) {
    // a String takes anything
    let _ = match cell {
        DataRef::Int(number) => write!(out, "{number}"),
        DataRef::Float(number) if number.fract() == 0.0 && number.abs() < WHOLE => write!(out, "{number:.0}"),
        DataRef::Float(number) => write!(out, "{number:e}"),
        DataRef::DateTime(time) => write!(out, "{}", date(time)),
        DataRef::Bool(truth) => write!(out, "{truth}"),
        DataRef::String(text) | DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => {
            write!(out, "{}", plain(text))
        }
        DataRef::SharedString(text) => write!(out, "{}", plain(text)),
        // its mark `#` would make a comment of the row
        DataRef::Error(error) => write!(out, "error {error}"),
        DataRef::Empty => Ok(()),
    };
}

/// Date and time of day; a time of day where it is less than a day, and of a duration, which goes on past midnight.
fn date(time: &ExcelDateTime) -> String {
    const DAY_US: f64 = 86_400e6;
    let (days, us) = (time.as_f64(), (time.as_f64() * DAY_US).round());
    if time.is_duration() || days < 1.0 {
        let in_day = TimeDelta::microseconds(us.rem_euclid(DAY_US) as i64);
        return (NaiveDateTime::default() + in_day).format("%H:%M:%S%.6f").to_string();
    }
    // days are counted from 1899-12-30, or from four years later in workbooks of old Macintosh programs
    let first =
        |year: i32, month, day| NaiveDate::from_ymd_opt(year, month, day).unwrap_or_default().and_time(NaiveTime::MIN);
    let (year, ..) = time.to_ymd_hms_milli();
    let at = |first: NaiveDateTime| first.checked_add_signed(TimeDelta::microseconds(us as i64)).unwrap_or(first);
    let (late, early) = (at(first(1904, 1, 1)), at(first(1899, 12, 30)));
    let of_1904 = late.year().abs_diff(year.into()) < early.year().abs_diff(year.into());
    (if of_1904 { late } else { early }).format("%Y-%m-%d %H:%M:%S%.6f").to_string()
}
