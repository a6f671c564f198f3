//! Where the instrument was, as a driver or a sensor says it.

use needle_core::twin::Pose;

/// Where the instrument was at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time, s.
    pub time_s: f64,
    /// Place.
    pub at: At,
}

/// Where the instrument was: what a displacement sensor says, or a whole pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum At {
    /// Depth along the scene's own instrument axis, m.
    Depth(f64),
    /// Tip and direction.
    Pose(Pose),
}
