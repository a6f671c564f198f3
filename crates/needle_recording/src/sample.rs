//! Samples of a recording.

use needle_core::twin::Pose;

/// A depth and the time of its measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthSample {
    /// Time, s since [`origin_ns`](crate::Recording::origin_ns).
    pub time_s: f64,
    /// Depth of the tip below the undeformed top surface, m; negative above it.
    pub depth_m: f64,
}

/// A tip pose and the time of its measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// Time, s since [`origin_ns`](crate::Recording::origin_ns).
    pub time_s: f64,
    /// Position of the tip in the frame of the topic, m.
    pub tip: [f64; 3],
    /// Unit vector along the instrument into the sample: the z axis of the tip's frame.
    pub axis: [f64; 3],
    /// How far it is turned about that, rad ([`Pose::roll_rad`]).
    pub roll_rad: f64,
}

impl PoseSample {
    /// The pose in the twin's format.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { tip: self.tip, axis: self.axis, roll_rad: self.roll_rad }
    }
}

/// Tracked points inside the sample and the time of their measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerSample {
    /// Time, s since [`origin_ns`](crate::Recording::origin_ns).
    pub time_s: f64,
    /// Position of each marker in frame `sample`, m; NaN where it was not seen.
    pub positions: Vec<[f64; 3]>,
}

/// A force and the time of its measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceSample {
    /// Time, s since [`origin_ns`](crate::Recording::origin_ns).
    pub time_s: f64,
    /// Force of the tissue on the instrument as recorded, N.
    pub force_n: [f64; 3],
}

/// The next sample to be written.
pub(super) enum Sample<'a> {
    Depth(DepthSample),
    Pose(PoseSample),
    Force(ForceSample),
    Markers(&'a MarkerSample),
}

/// Which of four series comes next by the time of its first sample; for equal times the motion's.
pub(super) fn first(times: [Option<f64>; 4]) -> Option<usize> {
    (0..4)
        .filter(|&k| times[k].is_some())
        .min_by(|&a, &b| times[a].partial_cmp(&times[b]).unwrap_or(std::cmp::Ordering::Equal))
}
