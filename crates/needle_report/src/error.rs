//! Why a report can't be written.

use std::{io, path::PathBuf};

/// Why a report can't be written: the file, the reason, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The output folder can't be created.
    #[error("output folder {}: can't be made ({source}); give another folder with --out", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A file can't be written.
    #[error("{}: can't be written ({source}); check the folder's permissions and free space, or give another with --out", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A field of the run doesn't match its mesh.
    #[error(
        "{file}: {field} has {found} values for {expected} points; the run was put together wrongly, please report it"
    )]
    Length {
        /// The file being written.
        file: &'static str,
        /// Field of the run.
        field: &'static str,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// An index of the mesh is out of range.
    #[error("{file}: a cell refers to point {index} of {points}; the run was put together wrongly, please report it")]
    Index {
        /// The file being written.
        file: &'static str,
        /// Index found.
        index: u32,
        /// Number of points.
        points: usize,
    },
    /// The program was built without raster images.
    #[error("{}: this program was built without the feature plots and draws no PNG; give a name that ends in .svg", .path.display())]
    NoPng {
        /// The file.
        path: PathBuf,
    },
    /// A picture can't be drawn.
    #[error("{file}: can't be drawn ({reason}); please report it")]
    Picture {
        /// The file being written.
        file: &'static str,
        /// The reason.
        reason: String,
    },
}
