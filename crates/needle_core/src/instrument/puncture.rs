//! When the surface is punctured, and whether a needle is being withdrawn, independent of the pose rate and of sensor noise.

/// Difference of depth from which a needle counts as being withdrawn, m: ten times the resolution of a magnetostrictive sensor, so
/// that its noise at rest doesn't change the phase. Half of it ends that again.
const WITHDRAWN_M: f64 = 2e-5;

/// Strain of the surface over the depth, as far as it has been pressed.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Strained {
    /// (depth in m, strain): the last three poses, the latest first; the undeformed surface before them.
    last: [(f64, f64); 3],
    /// Depth of the pose whose strain is not known yet, m.
    pressed: Option<f64>,
}

impl Strained {
    /// The surface is pressed to a depth, m; the strain is seen at the next pose.
    pub(crate) fn pressed(&mut self, depth: f64) {
        self.pressed = Some(depth);
    }

    /// The strain that the last depth has brought.
    pub(crate) fn reached(&mut self, strain: f64) {
        let Some(depth) = self.pressed.take() else { return };
        if depth > self.last[0].0 {
            self.last = [(depth, strain), self.last[0], self.last[1]];
        } else {
            self.last[0] = (depth, strain);
        }
    }

    /// Depth at which the strain passed a limit, m: the parabola depth over strain through the last three poses, within the last interval;
    /// a straight line where there are only two.
    pub(crate) fn passed(&self, limit: f64) -> f64 {
        let [(d2, e2), (d1, e1), (d0, e0)] = self.last;
        let line = if e2 > e1 { d1 + (limit - e1) / (e2 - e1) * (d2 - d1) } else { d2 };
        let (a, b, c) = (limit - e0, limit - e1, limit - e2);
        let parabola = d0 * b * c / ((e0 - e1) * (e0 - e2))
            + d1 * a * c / ((e1 - e0) * (e1 - e2))
            + d2 * a * b / ((e2 - e0) * (e2 - e1));
        let curved = e2 > e1 && e1 > e0 && parabola.is_finite();
        (if curved { parabola } else { line }).clamp(d1.min(d2), d2)
    }
}

/// Whether a needle is being withdrawn, `missing` metres from its deepest point.
pub(crate) fn is_withdrawn(before: bool, missing: f64) -> bool {
    missing > if before { 0.5 * WITHDRAWN_M } else { WITHDRAWN_M }
}

/// Largest eigenvalue of E = (F^T F - I)/2, F row-major.
pub(crate) fn largest_strain(f: &[f64; 9]) -> f64 {
    let f = nalgebra::Matrix3::from_row_slice(f);
    let e = 0.5 * (f.transpose() * f - nalgebra::Matrix3::identity());
    e.symmetric_eigenvalues().max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_depth_of_a_passed_strain_does_not_depend_on_how_often_one_looks() {
        let strain = |d: f64| 120.0 * d + 9e4 * d * d;
        let truth = (-120.0 + (120.0_f64.powi(2) + 4.0 * 9e4 * 0.1).sqrt()) / (2.0 * 9e4);
        for step in [1e-7, 3e-6, 1e-5, 1.1e-4] {
            let mut seen = Strained::default();
            let mut depth = 0.3 * step;
            while strain(depth) < 0.1 {
                seen.pressed(depth);
                seen.reached(strain(depth));
                depth += step;
            }
            seen.pressed(depth);
            seen.reached(strain(depth));
            let found = seen.passed(0.1);
            assert!((found - truth).abs() < 1e-6, "{step}: {found} {truth}");
        }
        let mut first = Strained::default();
        first.pressed(1e-4);
        first.reached(0.2);
        assert!((first.passed(1e-6) - 5e-10).abs() < 1e-12, "a surface that gives way at once does so at the surface");
    }

    #[test]
    fn a_trembling_sensor_is_no_withdrawal() {
        let mut withdrawn = false;
        for k in 0..100 {
            withdrawn = is_withdrawn(withdrawn, if k % 2 == 0 { 0.0 } else { 9e-6 });
            assert!(!withdrawn);
        }
        assert!(is_withdrawn(false, 3e-5) && is_withdrawn(true, 1.5e-5) && !is_withdrawn(true, 5e-6));
    }
}
