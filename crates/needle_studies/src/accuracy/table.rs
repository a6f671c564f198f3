//! `accuracy.csv` on disk. Rows are appended as they finish, an interrupted study continues, and parts can be merged.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::record;
use super::{Row, StudyError};

/// A table to which rows are appended.
#[derive(Debug)]
pub struct Table {
    file: File,
    path: PathBuf,
    /// Existing and new rows.
    pub rows: Vec<Row>,
}

impl Table {
    /// Opens a table, or creates one. An incomplete last line of an interrupted run is removed.
    ///
    /// # Errors
    /// [`StudyError::Table`] if the file can't be read or written, or is not such a table.
    pub fn open(path: &Path) -> Result<Self, StudyError> {
        let rows = if path.exists() { read(path)? } else { Vec::new() };
        let text = super::csv(&rows);
        // write complete lines only, and rename the file when it is complete
        let partial = path.with_extension("csv.partial");
        let write = || -> std::io::Result<File> {
            let mut file = File::create(&partial)?;
            file.write_all(text.as_bytes())?;
            file.sync_data()?;
            std::fs::rename(&partial, path)?;
            OpenOptions::new().append(true).open(path)
        };
        let file = write().map_err(|e| unwritable(path, &e))?;
        Ok(Self { file, path: path.to_owned(), rows })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`StudyError::Table`] if it can't be written.
    pub fn append(&mut self, row: Row) -> Result<(), StudyError> {
        let line = record::line(&row);
        let written = self.file.write_all(line.as_bytes()).and_then(|()| self.file.sync_data());
        written.map_err(|e| unwritable(&self.path, &e))?;
        self.rows.push(row);
        Ok(())
    }
}

fn unwritable(path: &Path, error: &std::io::Error) -> StudyError {
    let reason = format!("can't be written ({error}); check permissions and free space, or give another --out");
    StudyError::Table { path: path.to_owned(), reason }
}

/// The rows of a table. A last line without a line end, which an interrupted run may leave, is ignored.
///
/// # Errors
/// [`StudyError::Table`] if it can't be read, or if a complete line is not a valid row: nothing is lost silently.
pub fn read(path: &Path) -> Result<Vec<Row>, StudyError> {
    let refuse = |reason: String| StudyError::Table { path: path.to_owned(), reason };
    let text = std::fs::read_to_string(path).map_err(|e| refuse(format!("can't be read ({e})")))?;
    let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
    if whole.is_empty() {
        return Ok(Vec::new());
    }
    if !whole.starts_with(&record::heading()) {
        return Err(refuse("not a table of this study (its first line differs); give another --out".to_owned()));
    }
    let row = |(i, row): (usize, Option<Row>)| row.ok_or_else(|| refuse(format!("row {} can't be read", i + 1)));
    record::rows(whole).enumerate().map(row).collect()
}

/// Merges parts without duplicate rows. If a case was run more than once, the cheapest run is kept, as within a run.
/// The second value is the number of rows left out for that reason.
#[must_use]
pub fn merge(parts: impl IntoIterator<Item = Row>) -> (Vec<Row>, usize) {
    let mut rows: Vec<Row> = Vec::new();
    let mut again = 0;
    for row in parts {
        match rows.iter_mut().find(|known| known.is_of(&row.scene, &row.case)) {
            None => rows.push(row),
            Some(known) => {
                again += 1;
                if row.cost_s < known.cost_s {
                    *known = row;
                }
            }
        }
    }
    (rows, again)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::Steps;
    use super::super::row::tests::row;
    use super::*;

    fn rows() -> [Row; 3] {
        [1, 2, 3].map(|steps| {
            let mut row = row(100, 0.01);
            row.case.steps = Steps::Fixed(steps);
            row
        })
    }

    #[test]
    fn a_table_goes_on_where_it_was_cut() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("accuracy.csv");
        let mut table = Table::open(&path).unwrap();
        rows().into_iter().for_each(|row| table.append(row).unwrap());
        drop(table);
        let text = std::fs::read_to_string(&path).unwrap();
        let second = text.lines().take(2).map(|l| l.len() + 1).sum::<usize>();
        for cut in second..text.len() {
            std::fs::write(&path, &text[..cut]).unwrap();
            let mut table = Table::open(&path).unwrap();
            let kept = text[..cut].matches('\n').count() - 1;
            assert_eq!(table.rows, rows()[..kept], "cut at byte {cut}");
            rows()[kept..].iter().for_each(|row| table.append(row.clone()).unwrap());
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text, "cut at byte {cut}");
        }
    }

    #[test]
    fn another_file_is_refused_and_a_broken_line_is_not_lost() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("accuracy.csv");
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(Table::open(&path).unwrap_err().to_string().contains("first line differs"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "a,b\n1,2\n", "left as it was");
        std::fs::write(&path, format!("{}1,2\n", record::heading())).unwrap();
        assert!(Table::open(&path).unwrap_err().to_string().contains("row 1 can't be read"));
    }

    #[test]
    fn merged_rows_are_there_once_and_the_cheapest() {
        let [a, b, c] = rows();
        let cheaper = Row { cost_s: 0.5 * a.cost_s, ..a.clone() };
        let dearer = Row { cost_s: 2.0 * b.cost_s, ..b.clone() };
        let (rows, again) = merge([a, b.clone(), cheaper.clone(), c.clone(), dearer]);
        assert_eq!((rows, again), (vec![cheaper, b, c], 2));
    }
}
