//! Speed of the tip along its axis, over a physical time: what a cutting force that grows with the speed is computed from.
//!
//! Stamps are not when the instrument was there. A driver that hands over ten poses at once stamps them microseconds apart, and way over time
//! between two of them is anything. So the speed is that between two poses which
//!
//! ```text
//! came after a usual interval: half of the longest of late or more      a burst counts from its first pose to that of a later one
//! are WINDOW to 2 WINDOW apart                                          less after the first pose, or a break of WINDOW
//! ```
//!
//! and stays the same in between. At a constant speed that is the speed, whatever the stamps do between; a speed that changes is followed
//! within [`WINDOW_S`].

/// Least time between the two poses, s: several of the batches that drivers hand over, and the readings' noise is no speed any more (2 um in
/// it are 0.04 mm/s).
const WINDOW_S: f64 = 0.05;
/// Least time after the first pose from which there is a speed, s: half of a pose at a kilohertz. Within a batch there is none.
const LEAST_S: f64 = 5e-4;
/// The same after a break, s: a batch that comes that seldom may be longer.
const LEAST_AFTER_BREAK_S: f64 = 5e-3;
/// Share of the longest interval of late from which one is usual.
const USUAL: f64 = 0.5;

/// Where the tip was, and when.
#[derive(Clone, Copy, Debug)]
struct Mark {
    time_s: f64,
    depth_m: f64,
}

/// See the module.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Speed {
    last: Option<Mark>,
    /// Poses that a speed may be measured from, the older first.
    from: Option<[Mark; 2]>,
    /// Time after the older of them from which there is a speed, s.
    least_s: f64,
    /// The longest interval of late, s: it fades within [`WINDOW_S`].
    longest_s: f64,
    m_per_s: Option<f64>,
}

impl Speed {
    /// Takes a pose, and says how long its way takes, s: `None` where that is not known, or goes no deeper.
    pub(crate) fn time_to(&mut self, time_s: f64, depth_m: f64) -> Option<f64> {
        let here = Mark { time_s, depth_m };
        let (Some(last), Some([old, new])) = (self.last.replace(here), self.from) else {
            self.begin(time_s, depth_m);
            return None;
        };
        let interval_s = time_s - last.time_s;
        if interval_s < 0.0 {
            self.begin(time_s, depth_m);
            return None;
        }
        let broken = interval_s >= WINDOW_S;
        if broken || (interval_s > 0.0 && interval_s >= USUAL * self.longest_s) {
            let elapsed_s = time_s - old.time_s;
            if elapsed_s >= self.least_s {
                self.m_per_s = Some((depth_m - old.depth_m) / elapsed_s);
            }
            if broken {
                (self.from, self.least_s, self.longest_s) = (Some([here; 2]), LEAST_AFTER_BREAK_S, 0.0);
            } else if time_s - new.time_s >= WINDOW_S {
                self.from = Some([new, here]);
            }
        }
        if !broken {
            self.longest_s = interval_s.max(self.longest_s * (-interval_s / WINDOW_S).exp());
        }
        // what was above the surface has taken no way in the tissue
        let way_m = depth_m - last.depth_m.max(0.0);
        self.m_per_s.filter(|speed| *speed > 0.0 && way_m > 0.0).map(|speed| way_m / speed)
    }

    /// Measures from a pose on; what was before says nothing.
    pub(crate) fn begin(&mut self, time_s: f64, depth_m: f64) {
        let here = Mark { time_s, depth_m };
        *self = Self { last: Some(here), from: Some([here; 2]), least_s: LEAST_S, ..Self::default() };
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const SPEED: f64 = 4e-3;

    /// Times that ways of a path at [`SPEED`] are said to take, over what they take, from the poses' own times and stamps.
    fn shares(poses: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
        let (mut speed, mut before) = (Speed::default(), None);
        let mut all = Vec::new();
        for (own_s, stamp_s) in poses {
            let told = speed.time_to(stamp_s, SPEED * own_s + 1e-3);
            if let Some(before) = before.replace(own_s) {
                all.push((own_s, told.map_or(f64::INFINITY, |told| told / (own_s - before))));
            }
        }
        all
    }

    fn at(i: u32) -> f64 {
        1e-3 * f64::from(i)
    }

    #[test]
    fn even_stamps_are_taken_as_they_are_from_the_first_on() {
        for origin in [0.0, 1.7e4] {
            let shares = shares((0..300).map(|i| (at(i), origin + at(i))));
            assert!(shares.iter().all(|(_, share)| (share - 1.0).abs() < 1e-6), "{shares:?}");
        }
    }

    #[test]
    fn bursts_have_the_speed_of_the_whole() {
        for size in [2, 10, 100, 400] {
            // handed over together, after the last of them was taken
            let stamp = |i: u32| at(i - i % size + size) + 1e-6 * f64::from(i % size);
            let shares = shares((0..2000).map(|i| (at(i), stamp(i))));
            let (first, later): (Vec<_>, Vec<_>) = shares.into_iter().partition(|(own, _)| *own < at(size));
            assert!(first.iter().all(|(_, share)| share.is_infinite()), "{size}: slow until a time is known");
            let wrong = later.iter().find(|(_, share)| (share - 1.0).abs() > 2e-3);
            assert_eq!(wrong, None, "{size}");
        }
    }

    #[test]
    fn late_stamps_repeated_ones_and_skipped_poses_change_little() {
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        let late: Vec<(f64, f64)> = (0..2000).map(|i| (at(i), at(i) + 9e-4 * random())).collect();
        let same: Vec<(f64, f64)> = (0..2000).map(|i| (at(i), at(i.div_ceil(10) * 10))).collect();
        let some: Vec<(f64, f64)> = (0..2000).filter(|_| random() < 0.4).map(|i| (at(i), at(i))).collect();
        for (what, poses, within) in [("late", late, 0.03), ("repeated", same, 1e-6), ("skipped", some, 1e-6)] {
            let shares = shares(poses.into_iter());
            let worst = shares.iter().filter(|(own, _)| *own > 0.1).map(|(_, s)| (s - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst < within, "{what}: {worst}");
        }
    }

    #[test]
    fn a_speed_that_changes_is_followed_and_a_break_forgets() {
        let mut speed = Speed::default();
        let mut depth = 1e-3;
        let mut go = |speed: &mut Speed, from: u32, to: u32, by: f64| {
            let mut told = None;
            for i in from..to {
                depth += 1e-3 * by;
                told = speed.time_to(at(i), depth);
            }
            told.unwrap_or(f64::INFINITY)
        };
        assert!((go(&mut speed, 0, 500, 2e-3) - 1e-3).abs() < 1e-9);
        assert!((go(&mut speed, 500, 602, 8e-3) - 1e-3).abs() < 1e-9, "within two windows");
        assert!((go(&mut speed, 9000, 9006, 4e-3) - 1e-3).abs() < 1e-9, "5 ms after a break");
        assert!(go(&mut speed, 9006, 9200, -4e-3).is_infinite(), "on the way out nothing is cut");
        assert!(go(&mut speed, 9000, 9001, 4e-3).is_infinite(), "a clock that was set back says nothing");
    }
}
