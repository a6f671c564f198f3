//! Why a table can't be read.

use std::path::PathBuf;

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
    /// A file that is no text can't be taken as it is.
    #[error("{}: {reason}", .path.display())]
    Contents {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// An option has no meaning for the files.
    #[error("{option} says nothing of {}: {remedy}", .path.display())]
    NotHere {
        /// The option.
        option: &'static str,
        /// The first of the files.
        path: PathBuf,
        /// What to do.
        remedy: &'static str,
    },
}
