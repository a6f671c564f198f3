//! Why a report can't be written.

use std::{io, path::PathBuf};

/// Why a report can't be written: which file, what, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The output folder can't be made.
    #[error("output folder {}: can't be made ({source}); give another folder with --out", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file can't be written.
    #[error("{}: can't be written ({source}); check the folder's permissions and free space, or give another with --out", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A field of the run doesn't fit its mesh.
    #[error(
        "{file}: {field} has {found} values for {expected} points; the run was put together wrongly, please report it"
    )]
    Length {
        /// File that was being made.
        file: &'static str,
        /// Field of the run.
        field: &'static str,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// An index of the mesh points nowhere.
    #[error("{file}: a cell refers to point {index} of {points}; the run was put together wrongly, please report it")]
    Index {
        /// File that was being made.
        file: &'static str,
        /// Index found.
        index: u32,
        /// Number of points.
        points: usize,
    },
    /// A picture can't be drawn.
    #[error("{file}: can't be drawn ({reason}); please report it")]
    Picture {
        /// File that was being made.
        file: &'static str,
        /// What failed.
        reason: String,
    },
}
