//! Merges the rows of one or several folders into one result.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::xxh3_128;

use super::pool::pool;
use super::{Fit, Group, Row, Sample, SampleRow};
use crate::baseline::Against;

/// Subfolder of the rows in the output folder.
pub const ROWS: &str = "recordings";
/// Subfolder of the samples' rows.
pub const SAMPLES: &str = "samples";

/// Why rows can't be merged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// A file does not contain a row.
    #[error("{}: {reason}; remove it and run its shard again", .path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// There are no rows.
    #[error("no rows in {}: run `needle_twin batch MANIFEST --out` it first", .0.display())]
    Nothing(PathBuf),
    /// Two rows with the same name belong to different recordings.
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

/// All rows in the manifest's order, and the results derived from them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Merged {
    /// The rows.
    pub rows: Vec<Row>,
    /// Number of recordings in the manifest that have no row.
    pub missing: usize,
    /// Kinds of samples.
    pub groups: Vec<Group>,
    /// Samples.
    pub samples: Vec<Sample>,
    /// Samples whose recordings were fitted jointly.
    pub joint: Vec<SampleRow>,
}

impl Merged {
    /// Merges rows given in any order.
    #[must_use]
    pub fn of(mut rows: Vec<Row>, mut joint: Vec<SampleRow>) -> Self {
        rows.sort_by(|a, b| (a.number, &a.name).cmp(&(b.number, &b.name)));
        let all = rows.iter().map(|row| row.of).max().unwrap_or(0);
        joint.sort_by(|a, b| a.name.cmp(&b.name));
        let (groups, samples) = pool(&rows, &joint);
        Self { missing: all.saturating_sub(rows.len()), rows, groups, samples, joint }
    }

    /// The fit of a row with the candidate that was chosen for its kind.
    #[must_use]
    pub fn chosen<'a>(&self, row: &'a Row) -> Option<&'a Fit> {
        let group = self.groups.iter().find(|group| group.name == row.group)?;
        row.fit(&group.candidate)
    }

    /// Number of recordings whose chosen model stands so against the best baseline.
    #[must_use]
    pub fn standing(&self, against: Against) -> usize {
        let of =
            |row: &&Row| self.chosen(row).and_then(|fit| fit.standing.as_ref()).is_some_and(|s| s.against() == against);
        self.rows.iter().filter(of).count()
    }

    /// Number of recordings that failed.
    #[must_use]
    pub fn failed(&self) -> usize {
        self.rows.iter().filter(|row| row.failed.is_some()).count()
    }
}

/// Reads the rows of folders. A row that is in two of them counts once.
///
/// # Errors
/// [`MergeError`].
pub fn merge(folders: &[PathBuf]) -> Result<Merged, MergeError> {
    let mut rows: BTreeMap<String, (PathBuf, Row)> = BTreeMap::new();
    for folder in folders {
        let files = files(folder, ROWS).ok_or_else(|| MergeError::Nothing(folder.clone()))?;
        for path in files {
            let row = read(&path)?;
            match rows.get(&row.name) {
                // a recording that failed in one folder may have succeeded in another
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
    let mut joint: BTreeMap<String, (PathBuf, SampleRow)> = BTreeMap::new();
    for path in folders.iter().flat_map(|folder| files(folder, SAMPLES).unwrap_or_default()) {
        let row = read_sample(&path)?;
        match joint.get(&row.name) {
            Some((first, known)) if *known != row => {
                return Err(MergeError::Differ { name: row.name, first: first.clone(), second: path });
            }
            _ => drop(joint.insert(row.name.clone(), (path, row))),
        }
    }
    let joint = joint.into_values().map(|(_, row)| row).collect();
    Ok(Merged::of(rows.into_values().map(|(_, row)| row).collect(), joint))
}

/// The files of the rows, sorted by name.
fn files(folder: &Path, kind: &str) -> Option<Vec<PathBuf>> {
    let entries = fs::read_dir(folder.join(kind)).ok()?.flatten().map(|e| e.path());
    let hidden = |p: &PathBuf| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
    let mut files: Vec<PathBuf> =
        entries.filter(|p| p.extension().is_some_and(|e| e == "json") && !hidden(p)).collect();
    files.sort();
    Some(files)
}

/// Reads a row from its file.
///
/// # Errors
/// [`MergeError::Row`].
pub fn read(path: &Path) -> Result<Row, MergeError> {
    of_json(path)
}

/// Reads a sample's row from its file.
///
/// # Errors
/// [`MergeError::Row`].
pub fn read_sample(path: &Path) -> Result<SampleRow, MergeError> {
    of_json(path)
}

/// Separates the content of a row from its checksum at the end of the file.
const SEAL: &str = ",\n  \"checksum\": \"";

/// The text of a row's file: the row as JSON, with a checksum of the text before that.
#[must_use]
pub fn sealed<T: serde::Serialize>(row: &T) -> String {
    let text = serde_json::to_string_pretty(row).unwrap_or_default();
    let content = text.strip_suffix("\n}").unwrap_or(&text);
    format!("{content}{SEAL}{}\"\n}}\n", checksum(content))
}

fn checksum(content: &str) -> String {
    format!("{:032x}", xxh3_128(content.as_bytes()))
}

fn of_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, MergeError> {
    let error = |reason: String| MergeError::Row { path: path.to_owned(), reason };
    let text = fs::read_to_string(path).map_err(|e| error(e.to_string()))?;
    let row = serde_json::from_str(&text).map_err(|e| error(format!("it is no row ({e})")))?;
    let whole = text.rsplit_once(SEAL).is_some_and(|(content, seal)| seal == format!("{}\"\n}}\n", checksum(content)));
    if whole {
        Ok(row)
    } else {
        Err(error("its checksum is absent or not that of its content: it was changed or damaged".to_owned()))
    }
}
