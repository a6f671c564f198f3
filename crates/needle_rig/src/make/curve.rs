//! Force over depth from the reference solutions in `bags/reference/`.

/// A curve through the origin and the points of a table, monotone wherever they are.
#[derive(Clone, Debug)]
pub struct Curve {
    /// (depth in m, force in N), the origin first.
    points: Vec<(f64, f64)>,
    /// Slope at each point, N/m.
    slopes: Vec<f64>,
}

impl Curve {
    /// From the first two columns (depth in m, force in N) of a table with one line of headings.
    pub(super) fn from_table(table: &str) -> Self {
        let mut points = vec![(0.0, 0.0)];
        for line in table.lines().skip(1) {
            let mut columns = line.split(',').filter_map(|c| c.trim().parse::<f64>().ok());
            points.extend(columns.next().zip(columns.next()));
        }
        let slopes = slopes(&points);
        Self { points, slopes }
    }

    /// Largest depth of the table, m.
    pub(super) fn max_depth_m(&self) -> f64 {
        self.points.last().map_or(0.0, |p| p.0)
    }

    /// Force at a depth, N: 0 above the surface, constant beyond the last point. Piecewise cubic (Hermite).
    #[must_use]
    pub fn force_n(&self, depth_m: f64) -> f64 {
        let after = self.points.partition_point(|p| p.0 <= depth_m);
        if after == 0 {
            return 0.0;
        }
        let i = after - 1;
        let Some(&(x1, y1)) = self.points.get(after) else { return self.points[i].1 };
        let (x0, y0) = self.points[i];
        let h = x1 - x0;
        let t = (depth_m - x0) / h;
        let (a, b) = (self.slopes[i] * h, self.slopes[i + 1] * h);
        y0 + t * (a + t * ((3.0 * (y1 - y0) - 2.0 * a - b) + t * (a + b - 2.0 * (y1 - y0))))
    }
}

/// Slopes that keep the cubic monotone: the weighted harmonic mean of the neighbouring secants (Fritsch and Butland,
/// SIAM J. Sci. Stat. Comput. 5(2), 1984), one-sided three-point estimates at the ends.
fn slopes(points: &[(f64, f64)]) -> Vec<f64> {
    let n = points.len();
    let h: Vec<f64> = points.windows(2).map(|p| p[1].0 - p[0].0).collect();
    let d: Vec<f64> = points.windows(2).map(|p| (p[1].1 - p[0].1) / (p[1].0 - p[0].0)).collect();
    if n < 3 {
        return vec![d.first().copied().unwrap_or(0.0); n];
    }
    let end = |h0: f64, h1: f64, d0: f64, d1: f64| (((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)).clamp(0.0, 3.0 * d0);
    let mut slopes = vec![end(h[0], h[1], d[0], d[1])];
    for i in 1..n - 1 {
        let (a, b) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
        let rising = d[i - 1] > 0.0 && d[i] > 0.0;
        slopes.push(if rising { (a + b) / (a / d[i - 1] + b / d[i]) } else { 0.0 });
    }
    slopes.push(end(h[n - 2], h[n - 3], d[n - 2], d[n - 3]));
    slopes
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_through_its_points_and_rises_between_them() {
        let table = include_str!("../../bags/reference/needle_force_capture_radius_0.50mm.csv");
        let curve = Curve::from_table(table);
        assert_eq!(curve.points.len(), 11);
        assert!((curve.force_n(0.005) - 0.0179524).abs() < 1e-12);
        assert!((curve.force_n(0.010) - 0.0674753).abs() < 1e-12);
        assert_eq!((curve.force_n(-1e-3), curve.force_n(0.0), curve.max_depth_m()), (0.0, 0.0, 0.01));
        let forces: Vec<f64> = (0..=1000).map(|i| curve.force_n(1e-5 * f64::from(i))).collect();
        assert!(forces.is_sorted());
    }

    #[test]
    fn a_smooth_function_comes_back() {
        let line = |i: i32| format!("{},{},0\n", f64::from(i) * 1e-3, (f64::from(i) * 1e-3).powi(2) * 700.0);
        let table: String =
            std::iter::once("depth_m,force_N,uncertainty_N\n".to_owned()).chain((1..=10).map(line)).collect();
        let curve = Curve::from_table(&table);
        // exclude the first interval: its slope is estimated from a single neighbour
        for i in 20..100 {
            let d = f64::from(i) * 1e-4;
            assert!((curve.force_n(d) / (700.0 * d * d) - 1.0).abs() < 0.02, "{d}");
        }
    }
}
