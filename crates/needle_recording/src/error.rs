//! Why a recording can't be read.

use std::path::PathBuf;

use super::foreign::ForeignError;
use super::frame::FrameError;
use super::selection::{NotHere, UnknownUnit};
use super::table::TableError;
use rosbag2_mcap::BagError;

/// Why a recording can't be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The bag can't be read, or lacks a topic.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A topic can't be used as the user requests.
    #[error(transparent)]
    Foreign(#[from] ForeignError),
    /// An unknown unit.
    #[error(transparent)]
    Unit(#[from] UnknownUnit),
    /// An invalid frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// An option does not apply to this input.
    #[error(transparent)]
    NotHere(#[from] NotHere),
    /// The table can't be read, or lacks a column.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Bags can't be combined.
    #[error("{} is a bag: one bag is a whole recording, and only tables can be several files", .0.display())]
    SeveralBags(PathBuf),
}
