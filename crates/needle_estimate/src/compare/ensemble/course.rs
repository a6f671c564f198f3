//! Input and result of the members' runs.

use crate::compare::{Cancel, TargetRow};
use needle_core::twin::{Pose, Prediction, StampedPose};
use needle_recording::{At, Reading};

/// The error of a run that was cancelled.
pub(super) const INTERRUPTED: &str = "interrupted";

/// The answers of a member.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MemberPath {
    /// Expected reading of the load cell at each reading, N, positive against the insertion; not a number without an
    /// answer.
    pub force_n: Vec<f64>,
    /// Position of each target at the deepest reading, m.
    pub targets: Vec<[f64; 3]>,
    /// The same at each requested time; `None` before the first answer and after the last.
    pub tracked: Vec<Option<Vec<[f64; 3]>>>,
}

/// The input of the members' runs.
pub(super) struct Course<'a> {
    pub readings: &'a [Reading],
    /// Times at which the targets are requested, s.
    pub times_s: &'a [f64],
    pub cancel: Cancel,
}

impl Course<'_> {
    /// Whether the run was cancelled.
    pub(crate) fn is_stopped(&self) -> bool {
        self.cancel.is_cancelled()
    }

    /// The path of a run, from its forces, the readings that it answered, and the targets at each answer.
    pub(crate) fn path(&self, force_n: Vec<f64>, at: &[usize], targets: &[TargetRow]) -> MemberPath {
        let deepest = targets.iter().rev().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
        let begin_s = at.first().map_or(0.0, |i| self.readings[*i].time_s);
        MemberPath {
            force_n,
            targets: deepest.map_or_else(Vec::new, |row| row.positions.clone()),
            tracked: self.times_s.iter().map(|time_s| targets_at(targets, time_s - begin_s)).collect(),
        }
    }
}

/// Positions of the targets at a time of the run, interpolated linearly between rows; `None` outside.
fn targets_at(rows: &[TargetRow], time_s: f64) -> Option<Vec<[f64; 3]>> {
    let next = rows.partition_point(|row| row.time_s < time_s);
    let after = rows.get(next)?;
    if after.time_s == time_s {
        return Some(after.positions.clone());
    }
    let before = rows.get(next.checked_sub(1)?)?;
    let share = (time_s - before.time_s) / (after.time_s - before.time_s);
    Some(between(&before.positions, &after.positions, share))
}

/// Linear interpolation between two sets of positions at the fraction `share`.
pub(super) fn between(from: &[[f64; 3]], to: &[[f64; 3]], share: f64) -> Vec<[f64; 3]> {
    from.iter().zip(to).map(|(a, b)| std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))).collect()
}

/// A reading with the instrument advanced along its axis by a distance, m.
pub(super) fn deeper(reading: &Reading, by_m: f64) -> Reading {
    let at = match reading.at {
        At::Depth(depth_m) => At::Depth(depth_m + by_m),
        At::Pose(pose) => At::Pose(Pose { tip: std::array::from_fn(|k| pose.tip[k] + by_m * pose.axis[k]), ..pose }),
    };
    Reading { at, ..*reading }
}

/// Force against the insertion, N.
pub(super) fn against(prediction: &Prediction, pose: &StampedPose) -> f64 {
    0.0 - (0..3).map(|i| prediction.force_n[i] * pose.pose.axis[i]).sum::<f64>()
}
