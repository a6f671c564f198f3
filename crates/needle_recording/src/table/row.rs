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

impl Row {
    /// Whether it has a depth, a pose, a force or a place.
    pub(super) fn has_sample(&self) -> bool {
        let force = self.force_n.is_some_and(|force| force.iter().any(|f| f.is_finite()));
        let markers = self.markers.iter().flatten().flatten().any(|x| x.is_finite());
        self.depth_m.is_some() || self.pose.is_some() || force || markers
    }
}
