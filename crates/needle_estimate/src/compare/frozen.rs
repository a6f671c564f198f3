//! Detects a sensor whose reading is frozen: a broken cable, or a driver that repeats its last value.
//!
//! A reading that repeats to the last bit is not a fault in itself: a coarse or noiseless sensor repeats readings
//! too. Two criteria indicate a fault:
//!
//! - **Noise.** A noisy sensor repeats a value n times in a row with a probability that falls like p^n. So the
//!   longest run of equal readings so far bounds the next one. A run of `RUN` times that bound plus `SPARE` readings
//!   is not explained by noise. The criterion applies once the sensor has proved to be noisy, by sign changes between
//!   successive differences. The force of a needle that moves steadily changes without them.
//! - **Motion** (load cells). The prediction has changed by more than the cell's resolution, and the reading has not.
//!   After `SUSPECTED` this is a suspicion, which is reason enough to stop. After `FOUND` it is a detection, and
//!   readings are left out.
//!
//! - **Velocity** (positions). The velocity in the message says that the needle has moved by more than the sensor's
//!   resolution, and the position has not. This finds a position that noise does not: one that stood still in the
//!   middle of a step of its sensor before.
//!
//! A detection stands until a reading differs. It is not revoked when the prediction passes the value by chance.

use std::time::Duration;

/// A run of equal readings is not noise if it is this many times longer than any before ...
const RUN: u32 = 4;
/// ... plus this many readings: for noise that repeats no value the longest run is 1.
const SPARE: u32 = 4;
/// Shortest duration of a frozen reading. Below it, readings at a kilohertz that arrive in bursts would count.
const SHORTEST: Duration = Duration::from_millis(15);
/// Times after which a reading that does not follow a changing prediction is suspected, and detected as frozen.
const SUSPECTED: Duration = Duration::from_millis(100);
const FOUND: Duration = Duration::from_secs(1);
/// A sensor is noisy if its reading has reversed direction this often, and in at least one of `SHARE` changes. White
/// noise at rest reverses in two of three changes. The position of a needle that moves by more than the noise between
/// readings never reverses.
const SCATTERS: u32 = 10;
const SHARE: u32 = 50;
/// A prediction has changed if it differs by more than this, N ...
const MOVES_N: f64 = 2e-3;
/// ... this share of its peak ...
const MOVES_OF_PEAK: f64 = 0.05;
/// ... and this many of the cell's smallest changes.
const MOVES_OF_STEP: f64 = 3.0;

/// By its velocity a needle has moved if that, over the last [`WINDOW_S`], makes more than this, m, and more than so many of
/// the sensor's smallest changes. A velocity that scatters about zero does not add up.
const MOVES_M: f64 = 5e-5;
const WINDOW_S: f64 = 0.1;

/// See the module.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frozen {
    last: Option<[f64; 3]>,
    /// Time of the first of the present equal readings, and the prediction then.
    since: Duration,
    predicted_n: f64,
    run: u32,
    longest: u32,
    changes: u32,
    turns: u32,
    difference: [f64; 3],
    /// Smallest change of a reading, N, or of a position, m.
    step_n: f64,
    /// Time of the last position, and displacement by its velocity while the position has stood still, m.
    seen: Duration,
    moved_m: f64,
    suspected: bool,
    found: bool,
}

impl Frozen {
    /// Takes the position of a sensor at a time, m, and the velocity that came with it, m/s (0: none).
    pub fn place(&mut self, time: Duration, place_m: [f64; 3], velocity_m_per_s: f64) {
        self.take(time, place_m, 0.0, 0.0, 0.0);
        let dt_s = time.saturating_sub(self.seen).as_secs_f64();
        self.seen = time;
        if self.run == 1 {
            self.moved_m = 0.0;
            return;
        }
        self.moved_m = self.moved_m * (-dt_s / WINDOW_S).exp() + velocity_m_per_s * dt_s;
        // the resolution is known once the position has changed
        let moves = self.changes > 0 && self.moved_m.abs() > MOVES_M.max(MOVES_OF_STEP * self.step_n);
        self.found |= moves;
        self.suspected |= moves;
    }

    /// Takes a reading in N at a time, with the present prediction and the largest so far, N. `band_n`: tolerated
    /// disagreement.
    pub fn take(&mut self, time: Duration, force_n: [f64; 3], predicted_n: f64, peak_n: f64, band_n: f64) {
        if self.last.is_none_or(|last| last != force_n) {
            self.differs(time, force_n, predicted_n);
            return;
        }
        self.run += 1;
        let stands = time.saturating_sub(self.since);
        let scatters = self.turns >= SCATTERS && self.turns * SHARE >= self.changes;
        let by_noise = scatters && self.run > RUN * self.longest + SPARE;
        let least_n = MOVES_N.max(MOVES_OF_PEAK * peak_n).max(MOVES_OF_STEP * self.step_n).max(0.5 * band_n);
        let by_motion = (predicted_n - self.predicted_n).abs() > least_n;
        self.found |= (by_noise && stands >= SHORTEST) || (by_motion && stands > FOUND);
        self.suspected |= self.found || (by_motion && stands > SUSPECTED);
    }

    /// Whether the reading is frozen.
    #[must_use]
    pub const fn is_found(&self) -> bool {
        self.found
    }

    /// Whether the reading is suspected to be frozen.
    #[must_use]
    pub const fn is_suspected(&self) -> bool {
        self.suspected
    }

    fn differs(&mut self, time: Duration, force_n: [f64; 3], predicted_n: f64) {
        if let Some(last) = self.last {
            let difference: [f64; 3] = std::array::from_fn(|k| force_n[k] - last[k]);
            let product: f64 = (0..3).map(|k| difference[k] * self.difference[k]).sum();
            let step_n = difference.iter().map(|d| d.abs()).fold(0.0, f64::max);
            self.step_n = if self.changes == 0 { step_n } else { self.step_n.min(step_n) };
            self.changes = self.changes.saturating_add(1);
            self.turns = self.turns.saturating_add(u32::from(product < 0.0));
            self.difference = difference;
            if !self.suspected {
                self.longest = self.longest.max(self.run);
            }
        }
        (self.last, self.since, self.predicted_n, self.run) = (Some(force_n), time, predicted_n, 1);
        (self.suspected, self.found) = (false, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings at a rate; the time of the detection, s.
    fn found_s(hz: f64, readings: impl Fn(usize) -> (f64, f64), n: usize) -> Option<f64> {
        let (mut frozen, mut peak) = (Frozen::default(), 0.0_f64);
        (0..n).find_map(|i| {
            let (force, predicted) = readings(i);
            peak = peak.max(predicted.abs());
            let time_s = i as f64 / hz;
            frozen.take(Duration::from_secs_f64(time_s), [0.0, 0.0, force], predicted, peak, 0.02);
            frozen.is_suspected().then_some(time_s)
        })
    }

    /// Noise of a cell, in steps of its resolution.
    fn noise(i: usize) -> f64 {
        let x = (i as u64).wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mixed = (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((mixed >> 40) % 5) as f64 * 1e-3
    }

    #[test]
    fn a_cell_that_scatters_is_found_within_a_fifth_of_a_second_with_the_needle_at_rest() {
        for hz in [100.0, 500.0, 1000.0] {
            let stands = 1000;
            let at = found_s(hz, |i| (0.05 + noise(i.min(stands)), 0.05), 3000);
            let after_s = at.map(|at| at - stands as f64 / hz);
            assert!(after_s.is_some_and(|s| s > 0.0 && s <= 0.2), "{hz} Hz: {after_s:?}");
        }
    }

    #[test]
    fn neither_noise_nor_a_noiseless_cell_at_rest_is_a_fault() {
        assert_eq!(found_s(500.0, |i| (noise(i), 0.0), 100_000), None);
        // in air, in motion, at rest, and in motion again: every value is exact
        let depth = |i: usize| if i % 4000 < 1000 { (i % 1000) as f64 * 1e-4 } else { 0.1 };
        assert_eq!(found_s(1000.0, |i| (depth(i), depth(i)), 20_000), None);
        // a cell with a resolution of 10 mN at a force of 15 mN
        let coarse = |i: usize| (i as f64 * 3e-5, (i as f64 * 3e-5 / 0.01).round() * 0.01);
        assert_eq!(found_s(100.0, |i| (coarse(i).1, coarse(i).0), 500), None);
    }

    /// A position in steps of a resolution, m, of a needle that goes 2 mm/s after a second at rest, and is frozen at 3 s; the time of
    /// the detection after that, s.
    fn found_by_velocity_s(step_m: f64, says: impl Fn(f64) -> f64) -> Option<f64> {
        let mut frozen = Frozen::default();
        (0..2500).find_map(|i| {
            let time_s = i as f64 * 2e-3;
            let depth_m = 0.4 * step_m + 2e-3 * (time_s.min(3.0) - 1.0).max(0.0);
            let shown_m = (depth_m / step_m).round() * step_m;
            frozen.place(Duration::from_secs_f64(time_s), [shown_m, 0.0, 0.0], says(time_s));
            frozen.is_suspected().then_some(time_s - 3.0)
        })
    }

    #[test]
    fn a_position_that_does_not_go_where_its_velocity_says_is_found() {
        let true_until_it_is_frozen = |t: f64| if t < 1.0 { 0.0 } else { 2e-3 };
        for (step_m, most_s) in [(2e-6, 0.04), (1e-5, 0.04), (1e-4, 0.25)] {
            let after_s = found_by_velocity_s(step_m, true_until_it_is_frozen);
            // three of the coarsest steps are more than a tenth of a second makes at this speed
            let expected = step_m < 5e-5;
            assert_eq!(after_s.is_some_and(|s| s > 0.0 && s < most_s), expected, "{step_m} m: {after_s:?}");
        }
        // at rest, without a velocity, and with one that scatters by 1 mm/s
        assert_eq!(found_by_velocity_s(2e-6, |_| 0.0), None);
        let scatters =
            |t: f64| if !(1.0..=3.0).contains(&t) { 4e-4 * (noise((t * 500.0) as usize) * 1e3 - 2.0) } else { 2e-3 };
        assert_eq!(found_by_velocity_s(2e-6, scatters), None);
    }

    #[test]
    fn what_was_found_stands_until_a_reading_differs() {
        let mut frozen = Frozen::default();
        let mut take = |ms: u64, force: f64, predicted: f64| {
            frozen.take(Duration::from_millis(ms), [0.0, 0.0, force], predicted, 0.2, 0.0);
            (frozen.is_suspected(), frozen.is_found())
        };
        assert_eq!(
            [take(0, 0.10, 0.10), take(60, 0.10, 0.15), take(101, 0.10, 0.15)].map(|t| t.0),
            [false, false, true]
        );
        assert_eq!(take(150, 0.10, 0.10), (true, false), "the prediction passes the value");
        assert_eq!(take(1010, 0.10, 0.16), (true, true));
        assert_eq!(take(1020, 0.10, 0.10), (true, true));
        assert_eq!(take(1030, 0.11, 0.10), (false, false));
    }
}
