//! Readings of two sources under one name: they jump to and fro between two courses.

/// A jump is larger than this many times the usual change over two readings, the smallest change, and this share of the whole range.
const LARGE: f64 = 5.0;
const COUNTS: f64 = 3.5;
const SHARE_OF_RANGE: f64 = 0.01;
/// Least number of jumps, and of them per reading.
const LEAST: usize = 10;
const OFTEN: f64 = 0.03;

/// Readings that jump to and fro.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Zigzag {
    /// Number of readings that differ from the one before and from the one behind, which are alike.
    pub jumps: usize,
    /// Middle one of their distances.
    pub apart: f64,
    /// The same over the range of all axes.
    pub share: f64,
}

impl Zigzag {
    /// One of the axes whose readings jump so; `least`: smaller jumps do not matter.
    pub(super) fn of_axes(axes: &[Vec<f64>], least: f64) -> Option<Self> {
        let range = |values: &Vec<f64>| {
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            most - values.iter().copied().fold(f64::INFINITY, f64::min)
        };
        let range = axes.iter().map(range).fold(0.0, f64::max);
        axes.iter().find_map(|values| Self::of(values, least.max(SHARE_OF_RANGE * range), range))
    }

    /// `None` if the readings have one course. Noise has none of such jumps: they are compared with the change over two readings.
    fn of(values: &[f64], least: f64, range: f64) -> Option<Self> {
        let mut over_two: Vec<f64> = values.windows(3).map(|w| (w[2] - w[0]).abs()).collect();
        let middle = over_two.len() / 2;
        if over_two.is_empty() {
            return None;
        }
        let usual = *over_two.select_nth_unstable_by(middle, f64::total_cmp).1;
        // a coarse sensor toggles between two of its counts
        let changes = values.windows(2).map(|w| (w[1] - w[0]).abs()).chain(over_two.iter().copied());
        let count = changes.filter(|change| *change > 0.0).fold(f64::INFINITY, f64::min);
        let large = (LARGE * usual).max(COUNTS * count).max(least);
        let jump = |w: &[f64]| {
            let (there, back) = (w[1] - w[0], w[2] - w[1]);
            let size = there.abs().min(back.abs());
            (there * back < 0.0 && size > large && size > LARGE * (w[2] - w[0]).abs()).then_some(size)
        };
        let mut jumps: Vec<f64> = values.windows(3).filter_map(jump).collect();
        if jumps.len() < LEAST || (jumps.len() as f64) < OFTEN * values.len() as f64 {
            return None;
        }
        let middle = jumps.len() / 2;
        let apart = *jumps.select_nth_unstable_by(middle, f64::total_cmp).1;
        Some(Self { jumps: jumps.len(), apart, share: apart / range })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A press to 2.5 mm and out again, 600 readings, with noise (m).
    fn press(i: u32, noise: f64) -> f64 {
        let t = f64::from(i) * 0.01;
        let random = f64::from(i * 7919 % 101) / 50.0 - 1.0;
        1e-3 * (if t < 3.0 { t - 0.5 } else { 5.5 - t }) + noise * random
    }

    #[test]
    fn noise_is_not_two_courses() {
        let of = |values: &[f64]| Zigzag::of_axes(&[values.to_vec()], 5e-6);
        let one = |noise: f64| (0..600).map(|i| press(i, noise)).collect::<Vec<_>>();
        for noise in [0.0, 1e-6, 1e-4, 1e-3] {
            assert_eq!(of(&one(noise)), None, "{noise}");
        }
        let steps: Vec<f64> = (0..600).map(|i| (press(i, 1e-6) / 2e-5).round() * 2e-5).collect();
        assert_eq!(of(&steps), None, "a coarse sensor");
        let vibrating: Vec<f64> = (0..600).map(|i| 1e-4 * (f64::from(i) * 2.5).sin()).collect();
        assert_eq!(of(&vibrating), None);
        let hold: Vec<f64> = (0..600).map(|i| press(0, if i % 2 == 0 { 1e-6 } else { -1e-6 })).collect();
        assert_eq!(of(&hold), None);
        for noise in [0.0, 1e-6, 1e-5] {
            let two: Vec<f64> = (0..600).flat_map(|i| [press(i, noise), press(i, noise) + 5e-4]).collect();
            let found = of(&two).unwrap();
            assert!(found.jumps > 900 && (found.apart - 5e-4).abs() < 4e-5, "{found:?}");
        }
        // one in ten is of another source
        let few = |i: u32| if i.is_multiple_of(10) { 4e-4 } else { 0.0 };
        let found = of(&(0..600).map(|i| press(i, 1e-6) + few(i)).collect::<Vec<_>>()).unwrap();
        assert!((55..=60).contains(&found.jumps), "{found:?}");
        let toggles: Vec<f64> = (0..600).map(|i| 1e-4 * f64::from(i / 60 + i % 2)).collect();
        assert_eq!(of(&toggles), None, "single counts of a coarse sensor");
        let round_off: Vec<f64> = (0..600).map(|i| 0.4 + f64::from(i % 2) * 1e-16).collect();
        assert_eq!(Zigzag::of_axes(&[round_off, one(0.0)], 0.0), None);
        assert_eq!(of(&[]), None);
    }
}
