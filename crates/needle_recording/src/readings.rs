//! Converts a recording to the twin's input: readings of the instrument's position, and the measured force over time.

use super::{At, ForceSample, ForceSeries, Reading, Recording};

/// Most readings of a selection.
const SOME: usize = 100_000;

impl Recording {
    /// Positions of the instrument, in order of time: the depths, unless there are none or poses are requested.
    #[must_use]
    pub fn readings(&self, pose_wanted: bool) -> Vec<Reading> {
        self.each_reading(pose_wanted).collect()
    }

    /// The same one by one: a list of them takes four times the memory of the depths.
    pub fn each_reading(&self, pose_wanted: bool) -> impl ExactSizeIterator<Item = Reading> + DoubleEndedIterator {
        let by_pose = self.depths.is_empty() || pose_wanted;
        let count = if by_pose { self.poses.len() } else { self.depths.len() };
        (0..count).map(move |i| {
            if by_pose {
                let sample = &self.poses[i];
                Reading { time_s: sample.time_s, at: At::Pose(sample.pose()) }
            } else {
                let sample = &self.depths[i];
                Reading { time_s: sample.time_s, at: At::Depth(sample.depth_m) }
            }
        })
    }

    /// Some of them, evenly distributed: enough to look for a mistake in unit, sign or scene.
    #[must_use]
    pub fn some_readings(&self, pose_wanted: bool) -> Vec<Reading> {
        let all = self.each_reading(pose_wanted);
        let step = all.len().div_ceil(SOME).max(1);
        all.step_by(step).collect()
    }

    /// Time from the first reading to the last, s.
    #[must_use]
    pub fn duration_s(&self, pose_wanted: bool) -> Option<f64> {
        let mut readings = self.each_reading(pose_wanted);
        let first = readings.next()?.time_s;
        Some(readings.next_back().map_or(0.0, |last| last.time_s - first))
    }

    /// The measured force over time.
    #[must_use]
    pub fn measured(&self) -> ForceSeries {
        self.series(self.forces.clone())
    }

    /// The same, moved out of the recording.
    #[must_use]
    pub fn take_measured(&mut self) -> ForceSeries {
        let forces = std::mem::take(&mut self.forces);
        self.series(forces)
    }

    fn series(&self, forces: Vec<ForceSample>) -> ForceSeries {
        let series = ForceSeries::new(forces.into_iter().map(|s| (s.time_s, s.force_n)).collect());
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
