//! Detects the puncture of membranes by a needle from the measured force alone. Neither a model nor the depth of a
//! layer is needed.
//!
//! Over a short part of an insertion the force is a smooth function of the depth x. The rupture of a membrane makes
//! it drop. The detector is a generalised likelihood ratio test (Willsky and Jones, IEEE Trans. Autom. Control 21
//! (1976) 108) over a sliding window:
//!
//! ```text
//! none     F = a + b x + c x^2 + e max(x - x0, 0) + noise        one bend anywhere: slip that begins, a tip that comes to a membrane
//! drop     the same, less J from the k-th last reading on           k = 1 to a quarter of the window
//!
//! t = J / s(J),  s^2 = residual of the drop's fit / (n - 5) times (1 + r) / (1 - r)      r: correlation of neighbouring residuals
//! ```
//!
//! A drop is reported when the largest t exceeds the quantile of Student's distribution that `FALSE_ALARMS` leaves to
//! each of `TESTS`. No memory is allocated per reading.

use std::collections::VecDeque;

use nalgebra::Vector4;

use super::Run;

/// Allowed false alarms per insertion.
const FALSE_ALARMS: f64 = 0.01;
/// Number of tests in an insertion, taken as independent: readings in 10 s at 1 kHz times the positions of a drop (a
/// quarter of the window).
const TESTS: f64 = 1e4 * 32.0;
/// Length of the window in diameters of the needle. Within it the curvature of the force is that of a parabola.
const WINDOW: f64 = 1.0;
/// Fewest and most readings in it.
const FEWEST: usize = 24;
const MOST: usize = 256;
/// Retraction that ends an insertion, m: ten times the resolution of a magnetostrictive sensor.
const BACK_M: f64 = 2e-5;
/// The same where readings are far apart, in mean distances of the window's readings: rows that were read off a figure
/// lie that far beside their place.
const BACK_ROWS: f64 = 1.5;
/// Time without progress after which the needle counts as resting, s; the tissue then relaxes.
const REST_S: f64 = 0.1;
/// Where readings are further apart than that: a rest takes this multiple of their mean distance in time, and is
/// slower than this share of the window's speed.
const PAUSE: f64 = 3.0;
const SLOW: f64 = 0.2;

/// A drop of the measured force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// When it began, s.
    pub time_s: f64,
    /// When it was detected, s.
    pub seen_s: f64,
    /// Depth of the tip when it began, m.
    pub depth_m: f64,
    /// Force against the insertion just before it, N.
    pub force_before_n: f64,
    /// Force against the insertion after it, at the time of detection, N.
    pub force_after_n: f64,
}

#[derive(Clone, Copy, Debug)]
struct Reading {
    time_s: f64,
    depth_m: f64,
    force_n: f64,
    /// Components of the reading in the orthonormal basis of the smooth force (parabola and bend), and the residual,
    /// N.
    part: Vector4<f64>,
    left_n: f64,
}

/// Drops of the measured force in a run with a needle.
#[must_use]
pub fn in_run(run: &Run) -> Vec<Crossing> {
    let Some(diameter_m) = run.instrument.and_then(|i| i.needle_diameter_m()) else { return Vec::new() };
    let mut crossings = Crossings::new(diameter_m);
    let measured = run.answers.iter().filter_map(|a| Some((a, a.measured_n?)));
    measured.filter_map(|(a, force_n)| crossings.take(a.time_s, a.depth_m, force_n)).collect()
}

/// A change that applies from the k-th last reading on.
#[derive(Clone, Copy, Debug, Default)]
struct Change {
    k: usize,
    /// Drop or change of slope, N or N/m.
    size: f64,
    /// Reduction of the sum of squares, N^2.
    explains: f64,
    /// Components of its regressor in the basis of the smooth force.
    part: Vector4<f64>,
    /// Squared norm of its regressor orthogonal to the smooth force.
    square: f64,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Crossings {
    window_m: f64,
    readings: VecDeque<Reading>,
}

impl Crossings {
    /// For a needle of a diameter, m.
    #[must_use]
    pub fn new(diameter_m: f64) -> Self {
        Self { window_m: WINDOW * diameter_m, readings: VecDeque::with_capacity(MOST + 1) }
    }

    /// Discards all readings.
    pub fn reset(&mut self) {
        self.readings.clear();
    }

    /// Takes a reading of depth (m) and force against the insertion (N). Returns a drop once it is detected.
    pub fn take(&mut self, time_s: f64, depth_m: f64, force_n: f64) -> Option<Crossing> {
        if let (Some(first), Some(last)) = (self.readings.front(), self.readings.back()) {
            let (way, time) = (last.depth_m - first.depth_m, last.time_s - first.time_s);
            let (on, after) = (depth_m - last.depth_m, time_s - last.time_s);
            let parts = (self.readings.len() as f64 - 1.0).max(1.0);
            let rests = after > REST_S.max(PAUSE * time / parts) && time > 0.0 && on * time <= SLOW * after * way;
            if on < -BACK_M.max(BACK_ROWS * way / parts) || after < 0.0 || (rests && on > 0.0) {
                self.readings.clear();
            } else if on <= 0.0 {
                return None;
            }
        }
        self.readings.push_back(Reading { time_s, depth_m, force_n, part: Vector4::zeros(), left_n: 0.0 });
        let beyond = |first: &Reading| depth_m - first.depth_m > self.window_m;
        while self.readings.len() > MOST || (self.readings.len() > FEWEST && self.readings.front().is_some_and(beyond))
        {
            self.readings.pop_front();
        }
        let found = if self.readings.len() < FEWEST { None } else { self.test() };
        if found.is_some() {
            self.readings.clear();
        }
        found
    }

    #[allow(clippy::cast_precision_loss)]
    fn test(&mut self) -> Option<Crossing> {
        self.smooth();
        self.bend();
        let drop = self.drop();
        let all: f64 = self.readings.iter().map(|r| r.left_n * r.left_n).sum();
        let freedom = self.readings.len() as f64 - 5.0;
        let correlation = self.correlation(&drop);
        let variance = (all - drop.explains) / freedom * (1.0 + correlation) / (1.0 - correlation);
        let t = -drop.size * (drop.square / variance).sqrt();
        if t.is_nan() || t <= quantile(FALSE_ALARMS / TESTS, freedom) {
            return None;
        }
        let start = self.readings.len() - drop.k;
        let first = self.readings.get(start)?;
        let last = self.readings.back()?;
        // the fitted force at that reading without the drop, which is extrapolated: no more than was read
        let smooth = first.force_n - first.left_n - drop.size * drop.beside(first);
        let (before, after) = (self.readings.range(..start), self.readings.range(start..));
        let largest = before.map(|r| r.force_n).fold(f64::NEG_INFINITY, f64::max);
        let smallest = after.map(|r| r.force_n).fold(f64::INFINITY, f64::min);
        Some(Crossing {
            time_s: first.time_s,
            seen_s: last.time_s,
            depth_m: first.depth_m,
            force_before_n: smooth.min(largest),
            force_after_n: (smooth + drop.size).max(smallest).min(largest),
        })
    }

    /// Fits the parabola to the window: orthonormal components (Gram-Schmidt) and residual.
    #[allow(clippy::cast_precision_loss)]
    fn smooth(&mut self) {
        let (Some(first), Some(last)) = (self.readings.front(), self.readings.back()) else { return };
        let (middle, half) = (0.5 * (first.depth_m + last.depth_m), 0.5 * (last.depth_m - first.depth_m));
        for r in &mut self.readings {
            let x = (r.depth_m - middle) / half;
            (r.part, r.left_n) = (Vector4::new(1.0, x, x * x, 0.0), r.force_n);
        }
        for k in 0..3 {
            for before in 0..k {
                let along: f64 = self.readings.iter().map(|r| r.part[before] * r.part[k]).sum();
                self.readings.iter_mut().for_each(|r| r.part[k] -= along * r.part[before]);
            }
            let length = self.readings.iter().map(|r| r.part[k] * r.part[k]).sum::<f64>().sqrt();
            self.readings.iter_mut().for_each(|r| r.part[k] /= length);
            let along: f64 = self.readings.iter().map(|r| r.part[k] * r.left_n).sum();
            self.readings.iter_mut().for_each(|r| r.left_n -= along * r.part[k]);
        }
    }

    /// Fits the bend that explains most of the parabola's residual, and adds its regressor to the orthonormal basis.
    #[allow(clippy::cast_precision_loss)]
    fn bend(&mut self) {
        let Some(end) = self.readings.back().map(|r| r.depth_m) else { return };
        let (mut best, mut from) = (Change::default(), 0.0);
        let (mut parts, mut parts_x) = (Vector4::zeros(), Vector4::zeros());
        let (mut left, mut left_x, mut x1, mut x2) = (0.0, 0.0, 0.0, 0.0);
        for (k, r) in (1..self.readings.len()).zip(self.readings.iter().rev()) {
            let x = r.depth_m - end;
            parts += r.part;
            parts_x += x * r.part;
            left += r.left_n;
            left_x += x * r.left_n;
            x1 += x;
            x2 += x * x;
            let square = x2 - 2.0 * x * x1 + k as f64 * x * x;
            let ramp = Change::of(k, left_x - x * left, square, parts_x - x * parts);
            if ramp.explains > best.explains {
                (best, from) = (ramp, r.depth_m);
            }
        }
        if best.k == 0 {
            return;
        }
        for r in &mut self.readings {
            let beside = (r.depth_m - from).max(0.0) - best.beside(r);
            r.part[3] = beside / best.square.sqrt();
            r.left_n -= best.size * beside;
        }
    }

    /// The drop among the last readings that explains most of the residual.
    #[allow(clippy::cast_precision_loss)]
    fn drop(&self) -> Change {
        let (mut best, mut parts, mut left) = (Change::default(), Vector4::zeros(), 0.0);
        for (k, r) in (1..=self.readings.len() / 4).zip(self.readings.iter().rev()) {
            parts += r.part;
            left += r.left_n;
            let step = Change::of(k, left, k as f64, parts);
            if step.size < 0.0 && step.explains > best.explains {
                best = step;
            }
        }
        best
    }

    /// Correlation of neighbouring residuals of a drop's fit, if it is positive.
    fn correlation(&self, drop: &Change) -> f64 {
        let start = self.readings.len() - drop.k;
        let residual = |(i, r): (usize, &Reading)| {
            let step = if i >= start { 1.0 } else { 0.0 };
            r.left_n - drop.size * (step - drop.beside(r))
        };
        let (mut both, mut own, mut before) = (0.0, 0.0, 0.0);
        for e in self.readings.iter().enumerate().map(residual) {
            both += e * before;
            own += e * e;
            before = e;
        }
        (both / own).clamp(0.0, 0.9)
    }
}

impl Change {
    /// From the product of a regressor with the residual, its square, and its components in the basis of the smooth
    /// force.
    fn of(k: usize, product: f64, square: f64, part: Vector4<f64>) -> Self {
        let beside = square - part.norm_squared();
        // a regressor that is smooth except for round-off explains nothing
        let (size, square) = if beside > 1e-6 * square { (product / beside, beside) } else { (0.0, square) };
        Self { k, size, explains: size * product, part, square }
    }

    /// Projection of its regressor on the smooth force at a reading.
    fn beside(&self, r: &Reading) -> f64 {
        self.part.dot(&r.part)
    }
}

/// Student's quantile for a small upper-tail probability: that of the normal distribution (Abramowitz and Stegun
/// 26.2.23) with Fisher's series in the degrees of freedom (26.7.5).
fn quantile(above: f64, freedom: f64) -> f64 {
    let t = (-2.0 * above.ln()).sqrt();
    let (up, down) =
        (2.515_517 + t * (0.802_853 + t * 0.010_328), 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)));
    let z = t - up / down;
    let w = z * z;
    let first = z * (w + 1.0) / 4.0;
    let second = z * (5.0 * w * w + 16.0 * w + 3.0) / 96.0;
    let third = z * (3.0 * w * w * w + 19.0 * w * w + 17.0 * w - 15.0) / 384.0;
    z + (first + (second + third / freedom) / freedom) / freedom
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quantile_is_students() {
        // scipy.stats.t.isf
        for (p, freedom, right) in [(1e-3, 20.0, 3.5518), (1e-5, 60.0, 4.6313), (1e-7, 200.0, 5.3872)] {
            assert!((quantile(p, freedom) / right - 1.0).abs() < 0.01, "{p} {freedom}: {}", quantile(p, freedom));
        }
    }
}
