//! Tracked points inside the sample (the scene's targets), from `measured_targets` to the members.

use std::collections::VecDeque;

use needle_core::instrument::reading::COORDINATE_M;
use needle_estimate::compare::ensemble::{Live, Told};
use ros2_messages::geometry_msgs::PoseArray;

/// Number of stored answers of the members for points to come: a quarter of a second at 1 kHz.
const KEPT: usize = 256;
/// Number of queued sets of points.
const WAITING: usize = 64;
/// Largest number of points taken from a message.
const MOST: usize = 4096;

/// Positions of points in frame `sample`, m; not a number if one was not seen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seen {
    pub stamp_nanos: i64,
    pub places: Vec<[f64; 3]>,
}

impl Seen {
    /// The points in a message; the error states why it can't be used.
    pub(crate) fn of(message: &PoseArray, stamp_nanos: i64, frame_id: &str) -> Result<Self, String> {
        let frame = &message.header.frame_id;
        if !frame.is_empty() && frame != frame_id {
            return Err(format!("it is in frame `{frame}`: publish it in `{frame_id}`"));
        }
        let place = |x: [f64; 3]| if x.iter().all(|x| COORDINATE_M.contains(*x)) { x } else { [f64::NAN; 3] };
        let places = message.poses.iter().take(MOST).map(|pose| place(pose.position.into())).collect();
        Ok(Self { stamp_nanos, places })
    }
}

/// The members' predictions at the latest poses, and the queued points.
#[derive(Debug, Default)]
pub(super) struct Tracks {
    /// Whether points have come since the start.
    wanted: bool,
    /// Stamp, whether measurements at it are used, and the members' predictions.
    told: VecDeque<(i64, bool, Told)>,
    waiting: VecDeque<Seen>,
}

impl Tracks {
    /// Queues the points seen since the last pose.
    pub(crate) fn seen(&mut self, points: VecDeque<Seen>) {
        self.wanted |= !points.is_empty();
        self.waiting.extend(points);
        let surplus = self.waiting.len().saturating_sub(WAITING);
        self.waiting.drain(..surplus);
    }

    /// Stores the members' answer to a pose; `counts`: false while the tissue oscillates after separating from the
    /// instrument.
    pub(crate) fn answered(&mut self, stamp_nanos: i64, counts: bool, live: &Live) {
        if self.wanted {
            if self.told.len() == KEPT {
                self.told.pop_front();
            }
            self.told.push_back((stamp_nanos, counts, live.told(true)));
        }
    }

    /// Assimilates the points between two of the members' answers. Returns the numbers of points of a message and of
    /// a member, if these differ.
    #[allow(clippy::cast_precision_loss)] // a fraction of the time between two poses
    pub(crate) fn learn(&mut self, live: &mut Live) -> Option<[usize; 2]> {
        let mut other = None;
        while let Some(seen) = self.waiting.front() {
            let next = self.told.partition_point(|(stamp, ..)| *stamp < seen.stamp_nanos);
            let Some((after_ns, counts, after)) = self.told.get(next) else { return other };
            if let Some((before_ns, _, before)) = next.checked_sub(1).and_then(|i| self.told.get(i)) {
                let count = after.targets_m.iter().map(Vec::len).max().unwrap_or(0);
                if count != seen.places.len() {
                    other = Some([seen.places.len(), count]);
                } else if *counts {
                    let share = (seen.stamp_nanos - before_ns) as f64 / (after_ns - before_ns) as f64;
                    live.tracked(&seen.places, before, after, share);
                }
            }
            self.waiting.pop_front();
        }
        other
    }

    /// The members were reset.
    pub(crate) fn reset(&mut self) {
        self.told.clear();
        self.waiting.clear();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use ros2_messages::geometry_msgs::{Point, Pose};

    fn message(frame: &str, x: &[f64]) -> PoseArray {
        let pose = |x: &f64| Pose { position: Point { x: *x, y: 0.0, z: 0.01 }, ..Pose::default() };
        let mut message = PoseArray { poses: x.iter().map(pose).collect(), ..PoseArray::default() };
        frame.clone_into(&mut message.header.frame_id);
        message
    }

    #[test]
    fn what_cannot_be_a_place_was_not_seen_and_another_frame_is_refused() {
        let seen = Seen::of(&message("", &[0.001, f64::NAN, 1e300]), 7, "sample").unwrap();
        assert_eq!((seen.stamp_nanos, seen.places[0]), (7, [0.001, 0.0, 0.01]));
        assert!(seen.places[1..].iter().flatten().all(|x| x.is_nan()));
        let refused = Seen::of(&message("camera", &[0.0]), 7, "sample").unwrap_err();
        assert!(refused.contains("`camera`") && refused.contains("`sample`"), "{refused}");
    }
}
