//! Converts a recording to the twin's input: readings of the instrument's position, and the measured force over time.

use super::Recording;
use super::{At, ForceSeries, Reading};

impl Recording {
    /// Positions of the instrument, in order of time: the depths, unless there are none or poses are requested.
    #[must_use]
    pub fn readings(&self, pose_wanted: bool) -> Vec<Reading> {
        if self.depths.is_empty() || pose_wanted {
            self.poses.iter().map(|s| Reading { time_s: s.time_s, at: At::Pose(s.pose()) }).collect()
        } else {
            self.depths.iter().map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect()
        }
    }

    /// The measured force over time.
    #[must_use]
    pub fn measured(&self) -> ForceSeries {
        let series = ForceSeries::new(self.forces.iter().map(|s| (s.time_s, s.force_n)).collect());
        series.on_one_clock(self.one_clock).with_holes(self.holes.clone())
    }

    /// Message for forces that are recorded in another frame. A replay has no transforms to convert them.
    #[must_use]
    pub fn foreign_frame(&self) -> Option<String> {
        let (found, wanted) = (self.force_frame.trim_start_matches('/'), &self.topics.frame_id);
        (!found.is_empty() && found != wanted).then(|| {
            format!("the forces are recorded in frame `{found}`, taken as if its axes were those of `{wanted}`: rotate them if they are not")
        })
    }
}
