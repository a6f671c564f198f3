//! Predicted force along a recorded motion, as a function of time and, for insertion and retraction separately, of
//! depth.
//!
//! A shift in time of force against position needs no new run of the twin: it is the same curve, evaluated at another
//! time. A shift of the contact's depth, c, changes every depth of the run by the same amount. For a quasi-static
//! force this gives approximately
//!
//! ```text
//! F(t; c) = F(t) + G(d(t) - c) - G(d(t))      dF/dc = -G'(d),   dF/dtau = -F'(t)
//! ```
//!
//! with G the run's own force over depth, for insertion and retraction separately. It is exact if the force is a
//! function of the depth alone. A search uses it for its steps and runs the twin where they lead.

/// Number of depths of a curve.
const BINS: usize = 128;
/// Fewest depths of a curve, the surface included.
const LEAST_DEPTHS: usize = 4;
/// Half of the time over which the slope of the force is taken, s: long enough to suppress a displacement sensor's
/// noise.
const SLOPE_S: f64 = 0.05;
/// Share of the largest depth within which the instrument is reversing.
const TURN: f64 = 0.002;

/// Force over depth in one direction; 0 above the surface, extrapolated linearly beyond the deepest point.
#[derive(Clone, Debug)]
struct Curve {
    bin_m: f64,
    force_n: Vec<f64>,
}

impl Curve {
    fn of(points: impl Iterator<Item = (f64, f64)>, deepest_m: f64) -> Option<Self> {
        let bin_m = deepest_m / BINS as f64;
        let (mut sums, mut counts, mut places) = (vec![0.0; BINS + 1], vec![0.0; BINS + 1], vec![0.0; BINS + 1]);
        for (depth, force) in points.filter(|(d, _)| *d > 0.0) {
            let bin = ((depth / bin_m).round() as usize).min(BINS);
            sums[bin] += force;
            places[bin] += depth / bin_m;
            counts[bin] += 1.0;
        }
        // (depth in bins, force), the surface first
        let filled = (1..=BINS).filter(|&b| counts[b] > 0.0);
        let known: Vec<(f64, f64)> =
            std::iter::once((0.0, 0.0)).chain(filled.map(|b| (places[b] / counts[b], sums[b] / counts[b]))).collect();
        (known.len() >= LEAST_DEPTHS)
            .then(|| Self { bin_m, force_n: (0..=BINS).map(|b| line(&known, b as f64)).collect() })
    }

    /// The same from changes of the force with the depth alone, without the effect of lateral motion at constant
    /// depth. The slope in each bin is a least-squares fit over neighbouring answers.
    fn of_changes(points: &[(f64, f64)], deepest_m: f64) -> Option<Self> {
        let bin_m = deepest_m / BINS as f64;
        let (mut products, mut squares) = (vec![0.0; BINS], vec![0.0; BINS]);
        for pair in points.windows(2).filter(|pair| pair[0].0 > 0.0 || pair[1].0 > 0.0) {
            let (by, change) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
            let bin = ((0.5 * (pair[0].0 + pair[1].0) / bin_m).max(0.0) as usize).min(BINS - 1);
            products[bin] += by * change;
            squares[bin] += by * by;
        }
        let filled = (0..BINS).filter(|&b| squares[b] > 0.0);
        let slopes: Vec<(f64, f64)> = filled.map(|b| (b as f64, products[b] / squares[b])).collect();
        if slopes.len() < LEAST_DEPTHS {
            return None;
        }
        let mut force_n = vec![0.0];
        force_n.extend((0..BINS).scan(0.0, |force, b| {
            *force += bin_m * line(&slopes, b as f64);
            Some(*force)
        }));
        Some(Self { bin_m, force_n })
    }

    fn at(&self, depth_m: f64) -> f64 {
        let x = depth_m / self.bin_m;
        if x <= 0.0 {
            return 0.0;
        }
        let bin = (x as usize).min(BINS - 1);
        self.force_n[bin] + (x - bin as f64) * (self.force_n[bin + 1] - self.force_n[bin])
    }

    fn slope(&self, depth_m: f64) -> f64 {
        if depth_m <= 0.0 {
            0.0
        } else {
            (self.at(depth_m + self.bin_m) - self.at(depth_m - self.bin_m)) / (2.0 * self.bin_m)
        }
    }
}

/// Linear interpolation between known points, and linear extrapolation beyond the last.
fn line(known: &[(f64, f64)], x: f64) -> f64 {
    let after = known.partition_point(|p| p.0 < x).clamp(1, known.len() - 1);
    let ((x0, y0), (x1, y1)) = (known[after - 1], known[after]);
    y0 + (x - x0) / (x1 - x0) * (y1 - y0)
}

/// See the module.
#[derive(Clone, Debug)]
pub struct ForcePath {
    time_s: Vec<f64>,
    depth_m: Vec<f64>,
    force_n: Vec<f64>,
    /// Index from which the instrument is being retracted.
    turn: usize,
    curves: [Curve; 2],
}

impl ForcePath {
    /// From times (s, rising), depths (m) and predicted forces (N); `None` if the instrument does not enter the
    /// sample.
    #[must_use]
    pub fn new(time_s: Vec<f64>, depth_m: Vec<f64>, force_n: Vec<f64>) -> Option<Self> {
        Self::with(time_s, depth_m, force_n, |points, deepest_m| Curve::of(points.iter().copied(), deepest_m))
    }

    /// The same for a force across the axis, which lateral motion changes as well.
    #[must_use]
    pub(crate) fn across(time_s: Vec<f64>, depth_m: Vec<f64>, force_n: Vec<f64>) -> Option<Self> {
        Self::with(time_s, depth_m, force_n, Curve::of_changes)
    }

    fn with(
        time_s: Vec<f64>,
        depth_m: Vec<f64>,
        force_n: Vec<f64>,
        curve: impl Fn(&[(f64, f64)], f64) -> Option<Curve>,
    ) -> Option<Self> {
        let deepest = depth_m.iter().copied().fold(0.0, f64::max);
        let turn = depth_m.iter().rposition(|d| *d >= (1.0 - TURN) * deepest)? + 1;
        if deepest <= 0.0 || time_s.len() < 2 {
            return None;
        }
        let points: Vec<(f64, f64)> = depth_m.iter().copied().zip(force_n.iter().copied()).collect();
        let way = |range: std::ops::Range<usize>| curve(&points[range], deepest);
        let within = way(0..turn)?;
        let out = way(turn..depth_m.len()).unwrap_or_else(|| within.clone());
        Some(Self { time_s, depth_m, force_n, turn, curves: [within, out] })
    }

    /// Whether the run has an answer at a time.
    #[must_use]
    pub(crate) fn covers(&self, time_s: f64) -> bool {
        let (first, last) = (self.time_s.first(), self.time_s.last());
        first.is_some_and(|t| *t <= time_s) && last.is_some_and(|t| *t >= time_s)
    }

    /// Position of a time between two samples: index of the later one and fraction of the interval.
    fn place(&self, time_s: f64) -> (usize, f64) {
        let after = self.time_s.partition_point(|t| *t < time_s).clamp(1, self.time_s.len() - 1);
        let (t0, t1) = (self.time_s[after - 1], self.time_s[after]);
        (after, if t1 > t0 { ((time_s - t0) / (t1 - t0)).clamp(0.0, 1.0) } else { 1.0 })
    }

    fn between(values: &[f64], (after, share): (usize, f64)) -> f64 {
        values[after - 1] + share * (values[after] - values[after - 1])
    }

    /// Depth at a time, m.
    #[must_use]
    pub(crate) fn depth_m(&self, time_s: f64) -> f64 {
        Self::between(&self.depth_m, self.place(time_s))
    }

    /// Force at a time, N, with every depth reduced by `shallower_m`.
    #[must_use]
    pub(crate) fn force_n(&self, time_s: f64, shallower_m: f64) -> f64 {
        let place = self.place(time_s);
        let force = Self::between(&self.force_n, place);
        if shallower_m == 0.0 {
            return force;
        }
        let (curve, depth) = (self.curve(place.0), Self::between(&self.depth_m, place));
        if depth <= shallower_m {
            return 0.0;
        }
        force + curve.at(depth - shallower_m) - curve.at(depth)
    }

    fn curve(&self, after: usize) -> &Curve {
        &self.curves[usize::from(after >= self.turn)]
    }

    /// Derivative of the force by the depth at a time, N/m.
    #[must_use]
    pub(crate) fn stiffness(&self, time_s: f64, shallower_m: f64) -> f64 {
        let place = self.place(time_s);
        self.curve(place.0).slope(Self::between(&self.depth_m, place) - shallower_m)
    }

    /// Derivative of the force by the time, N/s.
    #[must_use]
    pub(crate) fn rate(&self, time_s: f64, shallower_m: f64) -> f64 {
        let (a, b) = (time_s - SLOPE_S, time_s + SLOPE_S);
        (self.force_n(b, shallower_m) - self.force_n(a, shallower_m)) / (b - a)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Insertion at 1 mm/s to 8 mm, retraction at 4 mm/s.
    fn depth(t: f64) -> f64 {
        if t < 9.0 { 1e-3 * (t - 1.0) } else { 8e-3 - 4e-3 * (t - 9.0) }
    }

    fn force(d: f64) -> f64 {
        700.0 * d.max(0.0).powf(1.6)
    }

    #[test]
    fn a_shift_of_the_contact_needs_no_other_run() {
        let time: Vec<f64> = (0..2200).map(|i| 5e-3 * f64::from(i)).collect();
        let of = |shift: f64| {
            ForcePath::new(
                time.clone(),
                time.iter().map(|t| depth(*t)).collect(),
                time.iter().map(|t| force(depth(*t) - shift)).collect(),
            )
        };
        let path = of(0.0).unwrap();
        for shift in [-4e-4, 3e-4, 1e-3] {
            for t in [0.5, 3.0, 6.0, 9.5, 10.4] {
                let (found, truth) = (path.force_n(t, shift), force(depth(t) - shift));
                assert!((found - truth).abs() < 2e-3 * force(8e-3), "{shift} {t}: {found} {truth}");
            }
        }
        let (t, h) = (5.0, 1e-4);
        let slope = (force(depth(t) + h) - force(depth(t) - h)) / (2.0 * h);
        assert!((path.stiffness(t, 0.0) / slope - 1.0).abs() < 0.01);
        assert!((path.rate(t, 0.0) / (1e-3 * slope) - 1.0).abs() < 0.01);
        assert!(ForcePath::new(vec![0.0, 1.0], vec![-1.0, -2.0], vec![0.0; 2]).is_none());
    }
}
