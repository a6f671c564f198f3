//! The rows of one file of a recording, once they are read.

use std::collections::VecDeque;

use super::columns::Columns;
use super::row::Row;
use super::survey::Survey;
use crate::thin::Thin;
use needle_core::twin::Pose;

/// The rows of one file that were read.
#[derive(Debug, Default)]
pub struct Table {
    /// Its name.
    pub file: String,
    /// Description of the layout.
    pub layout: String,
    /// The columns that are used.
    pub columns: Columns,
    /// Description of all columns.
    pub all_columns: String,
    /// Number of data rows.
    pub rows: u64,
    /// Number of rows with a cell that is not a number.
    pub bad: u64,
    /// The first of these rows with its line number.
    pub first_bad: Option<String>,
    /// Irregularities without a loss of data.
    pub warnings: Vec<String>,
    /// Rows per second, if they have no time.
    pub rate_hz: Option<f64>,
    /// Columns that the user named, by their options, and that are not in this file.
    pub(super) absent: Vec<(&'static str, String)>,
    /// First and last line, from 1.
    pub(super) lines: [usize; 2],
    /// Whether a row had a sample.
    pub(super) usable: bool,
    /// Rows with samples that may be in disorder, by their stamps; `None`: they are kept in the order of the file.
    pub(super) waiting: Option<VecDeque<(i64, Row)>>,
    /// What is known of the samples where they are not kept.
    pub(in super::super) survey: Option<Survey>,
    pub(in super::super) depths: Vec<(i64, f64)>,
    pub(in super::super) forces: Vec<(i64, [f64; 3])>,
    pub(in super::super) poses: Vec<(i64, Pose)>,
    pub(in super::super) markers: Vec<(i64, Vec<[f64; 3]>)>,
    /// Which depths, forces, poses and markers are kept.
    pub(super) thin: [Thin; 4],
}
