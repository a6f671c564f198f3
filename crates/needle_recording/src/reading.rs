//! Position of the instrument as reported by a driver or a sensor.

use needle_core::twin::Pose;

/// Position of the instrument at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time, s.
    pub time_s: f64,
    /// Position.
    pub at: At,
}

/// Position of the instrument: a depth from a displacement sensor, or a complete pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum At {
    /// Depth along the scene's own instrument axis, m.
    Depth(f64),
    /// Tip and direction.
    Pose(Pose),
}
