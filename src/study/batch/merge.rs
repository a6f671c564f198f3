//! Rows of one or several folders as one answer.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::pool::{fit_of, pool};
use super::{Fit, Group, Row, Sample};

/// Folder of the rows below the output folder.
pub const ROWS: &str = "recordings";

/// Why rows can't be put together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// A file is no row.
    #[error("{}: {reason}; remove it and run its shard again", .path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// There are none.
    #[error("no rows in {}: run `needle_twin batch MANIFEST --out` it first", .0.display())]
    Nothing(PathBuf),
    /// Two rows of one name are not of one recording.
    #[error("two rows are called {name} and differ ({}, {}): these folders are not of one manifest and version", .first.display(), .second.display())]
    Differ {
        /// Name of the row.
        name: String,
        /// The file that was read first.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
}

/// All rows in the manifest's order, and what follows from them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Merged {
    /// The rows.
    pub rows: Vec<Row>,
    /// Recordings of the manifest that have no row.
    pub missing: usize,
    /// Kinds of samples.
    pub groups: Vec<Group>,
    /// Samples.
    pub samples: Vec<Sample>,
}

impl Merged {
    /// Of rows in any order.
    #[must_use]
    pub fn of(mut rows: Vec<Row>) -> Self {
        rows.sort_by(|a, b| (a.number, &a.name).cmp(&(b.number, &b.name)));
        let all = rows.iter().map(|row| row.of).max().unwrap_or(0);
        let (groups, samples) = pool(&rows);
        Self { missing: all.saturating_sub(rows.len()), rows, groups, samples }
    }

    /// The fit of a row with the candidate that was chosen for its kind.
    #[must_use]
    pub fn chosen<'a>(&self, row: &'a Row) -> Option<&'a Fit> {
        let group = self.groups.iter().find(|group| group.name == row.group)?;
        fit_of(row, &group.candidate)
    }

    /// Recordings that failed.
    #[must_use]
    pub fn failed(&self) -> usize {
        self.rows.iter().filter(|row| row.failed.is_some()).count()
    }
}

/// Reads the rows of folders. The same row in two of them counts once.
///
/// # Errors
/// [`MergeError`].
pub fn merge(folders: &[PathBuf]) -> Result<Merged, MergeError> {
    let mut rows: BTreeMap<String, (PathBuf, Row)> = BTreeMap::new();
    for folder in folders {
        let files = files(folder).ok_or_else(|| MergeError::Nothing(folder.clone()))?;
        for path in files {
            let row = read(&path)?;
            match rows.get(&row.name) {
                // one that failed here may have been done there
                Some((_, known)) if known.failed.is_none() && row.failed.is_some() => {}
                Some((first, known)) if known.failed.is_none() && *known != row => {
                    return Err(MergeError::Differ { name: row.name, first: first.clone(), second: path });
                }
                _ => drop(rows.insert(row.name.clone(), (path, row))),
            }
        }
    }
    if rows.is_empty() {
        return Err(MergeError::Nothing(folders.first().cloned().unwrap_or_default()));
    }
    Ok(Merged::of(rows.into_values().map(|(_, row)| row).collect()))
}

/// The rows' files, in the order of their names.
fn files(folder: &Path) -> Option<Vec<PathBuf>> {
    let entries = fs::read_dir(folder.join(ROWS)).ok()?.flatten().map(|e| e.path());
    let hidden = |p: &PathBuf| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
    let mut files: Vec<PathBuf> =
        entries.filter(|p| p.extension().is_some_and(|e| e == "json") && !hidden(p)).collect();
    files.sort();
    Some(files)
}

/// A row from its file.
///
/// # Errors
/// [`MergeError::Row`].
pub fn read(path: &Path) -> Result<Row, MergeError> {
    let error = |reason: String| MergeError::Row { path: path.to_owned(), reason };
    let text = fs::read(path).map_err(|e| error(e.to_string()))?;
    serde_json::from_slice(&text).map_err(|e| error(format!("it is no row ({e})")))
}
