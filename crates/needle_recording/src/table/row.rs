//! What one row of a table holds.

use needle_core::twin::Pose;

/// Content of a row.
#[derive(Debug, Default)]
pub(super) struct Row {
    pub stamp: Option<i64>,
    pub depth_m: Option<f64>,
    pub force_n: Option<[f64; 3]>,
    pub pose: Option<Pose>,
    pub markers: Option<Vec<[f64; 3]>>,
    /// Whether a required cell is not a number, or the row ends before it.
    pub bad: bool,
}
