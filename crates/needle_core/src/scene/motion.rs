//! `[motion]`: the scene's own motion as a stream of depths.

use super::section::section;
use super::{Hertz, Key, Metres, MetresPerSecond, Range, Seconds};

section! {
    /// A scene's own motion: approach is at zero depth, then insertion, hold and retraction.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Motion when |values| values.has_section("motion") => {
        /// Depth to reach, positive into the sample.
        depth: Metres = Key::real("motion.depth_m", Range::closed(0.0, 10.0), "m"),
        /// Speed of insertion and retraction.
        speed: MetresPerSecond = Key::real("motion.speed_m_per_s", Range::above(0.0, 100.0), "m/s").or("1e-3"),
        /// Rate of the pose stream.
        pose_rate: Hertz = Key::real("motion.pose_hz", Range::above(0.0, 1e6), "Hz").or("1000.0"),
        /// Depth at which a frictional needle is in place before the first pose, with the tissue at rest.
        start_depth: Metres = Key::real("motion.start_depth_m", Range::closed(0.0, 10.0), "m").or("0.0"),
        /// Time to stay at depth.
        hold: Seconds = Key::real("motion.hold_s", Range::closed(0.0, 1e6), "s").or("0.0"),
        /// Whether the instrument then goes back to where it started.
        retract: bool = Key::boolean("motion.retract").or("false"),
        /// How often it goes to depth; between two times it goes back to where it started.
        insertions: u32 = Key::integer("motion.insertions", 1, 10).or("1"),
    }
}

impl Motion {
    /// Pose intervals of one insertion and of its hold; a retraction takes as many as an insertion. The last pose of the insertion is at full depth, so the
    /// insertion takes the time of a whole number of intervals.
    fn intervals(&self) -> [f64; 2] {
        let rate = self.pose_rate.get();
        // A hair less, so that 0.01 m / 0.001 m/s * 1000 Hz is 10,000 intervals and not 10,001.
        let insertion = ((self.depth.get() - self.start_depth.get()) / self.speed.get() * rate * (1.0 - 1e-12)).ceil();
        [insertion, (self.hold.get() * rate).round()]
    }

    /// Number of poses, the one at the start and time 0 included. A float, since nonsense can exceed every integer.
    #[must_use]
    pub fn pose_count(&self) -> f64 {
        let [insertion, hold] = self.intervals();
        let last = insertion + hold + if self.retract { insertion } else { 0.0 };
        f64::from(self.insertions - 1) * (2.0 * insertion + hold) + last + 1.0
    }

    /// Time in s and depth in m of every pose: from the start to depth at speed, hold, and back if it retracts or goes again.
    pub fn poses(&self) -> impl Iterator<Item = (f64, f64)> + use<> {
        let motion = *self;
        let [insertion, hold] = self.intervals();
        let (cycle, last) = (2.0 * insertion + hold, f64::from(self.insertions - 1));
        let (rate, start, depth) = (self.pose_rate.get(), self.start_depth.get(), self.depth.get());
        (0..self.pose_count() as u64).map(move |k| {
            let pose = k as f64;
            let k = if cycle > 0.0 { pose - (pose / cycle).floor().min(last) * cycle } else { 0.0 };
            let down = |intervals: f64| (start + motion.speed.get() * intervals / rate).min(depth);
            let at = if k < insertion {
                down(k)
            } else if k <= insertion + hold {
                depth
            } else {
                // The mirror image of the insertion, so that the last pose is at the first one's depth exactly.
                down(2.0 * insertion + hold - k)
            };
            (pose / rate, at)
        })
    }
}
