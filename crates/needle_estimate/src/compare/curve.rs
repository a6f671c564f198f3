//! Measured and predicted force over the depth since contact. Plots use it, and one recording is predicted from
//! another with it.

use serde::{Deserialize, Serialize};

/// Number of depths in a curve.
const PLACES: usize = 49;

/// Forces at equally spaced depths, from the contact to the deepest point of the insertion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Depth since contact, m.
    pub depth_m: Vec<f64>,
    /// Measured force minus the load cell's zero, N.
    pub measured_n: Vec<f64>,
    /// Predicted force, N.
    pub predicted_n: Vec<f64>,
}

impl Curve {
    /// Builds the curve from readings in order of time. Readings after the deepest one are left out.
    #[must_use]
    pub(crate) fn of(depth_m: &[f64], measured_n: &[f64], predicted_n: &[f64]) -> Self {
        let Some(deepest) = (0..depth_m.len()).max_by(|&a, &b| depth_m[a].total_cmp(&depth_m[b])) else {
            return Self::default();
        };
        // depth noise: a depth counts as reached once it has been exceeded
        let mut rising: Vec<usize> = Vec::new();
        for i in 0..=deepest {
            if rising.last().is_none_or(|&last| depth_m[i] > depth_m[last]) {
                rising.push(i);
            }
        }
        let Some(end) = rising.last().map(|&i| depth_m[i]).filter(|end| *end > 0.0) else { return Self::default() };
        let places: Vec<f64> = (0..PLACES).map(|k| end * k as f64 / (PLACES - 1) as f64).collect();
        let at =
            |values: &[f64]| places.iter().map(|&d| interpolated(&rising, depth_m, values, d)).collect::<Vec<f64>>();
        Self { measured_n: at(measured_n), predicted_n: at(predicted_n), depth_m: places }
    }

    /// Means of the measured force about equally spaced depths, up to the deepest reading; interpolated where there is none. Nothing is predicted.
    #[must_use]
    pub fn averaged(depth_m: &[f64], measured_n: &[f64]) -> Self {
        let mut curve = Self::of(depth_m, measured_n, measured_n);
        let Some(end) = curve.depth_m.last().copied() else { return curve };
        let mut sums = vec![[0.0; 3]; PLACES];
        let deepest = (0..depth_m.len()).max_by(|&a, &b| depth_m[a].total_cmp(&depth_m[b])).unwrap_or(0);
        for (d, n) in depth_m.iter().zip(measured_n).take(deepest + 1) {
            let place = (d / end * (PLACES - 1) as f64).round();
            if place >= 0.0 {
                let sum = &mut sums[place as usize];
                *sum = [sum[0] + 1.0, sum[1] + d, sum[2] + n];
            }
        }
        curve.predicted_n.clear();
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for [count, d, n] in sums.into_iter().filter(|sum| sum[0] > 0.0) {
            x.push(d / count);
            y.push(n / count);
        }
        // the deepest readings are about a depth above the end
        if let ([.., a, b], [.., m, n]) = (&x[..], &y[..]) {
            let slope = (n - m) / (b - a);
            let beyond = n + slope * (end - b);
            if end > *b && beyond.is_finite() {
                x.push(end);
                y.push(beyond);
            }
        }
        let order: Vec<usize> = (0..x.len()).collect();
        curve.measured_n = curve.depth_m.iter().map(|d| interpolated(&order, &x, &y, *d)).collect();
        curve
    }

    /// Interpolates one of the two force columns at a depth, N. Outside the range it returns the nearest end value.
    #[must_use]
    pub(crate) fn at(&self, forces: &[f64], depth_m: f64) -> f64 {
        let all: Vec<usize> = (0..self.depth_m.len()).collect();
        interpolated(&all, &self.depth_m, forces, depth_m)
    }
}

fn interpolated(order: &[usize], x: &[f64], y: &[f64], at: f64) -> f64 {
    let next = order.partition_point(|&i| x[i] < at).clamp(1, order.len().max(2) - 1);
    let (Some(&a), Some(&b)) = (order.get(next - 1), order.get(next)) else {
        return order.first().map_or(0.0, |&i| y[i]);
    };
    let share = ((at - x[a]) / (x[b] - x[a])).clamp(0.0, 1.0);
    y[a] + share * (y[b] - y[a])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_stays_a_line() {
        let depth: Vec<f64> = (0..100).map(|i| 1e-4 * f64::from(i) - 1e-3).chain([5e-3, 0.0]).collect();
        let force: Vec<f64> = depth.iter().map(|d| 7.0 * d).collect();
        let curve = Curve::of(&depth, &force, &force);
        assert!((curve.depth_m[48] - 8.9e-3).abs() < 1e-12);
        assert!(curve.depth_m.iter().zip(&curve.measured_n).all(|(d, f)| (f - 7.0 * d).abs() < 1e-12));
        assert!((curve.at(&curve.measured_n, 3.3e-3) - 7.0 * 3.3e-3).abs() < 1e-12);
        assert_eq!(Curve::of(&[], &[], &[]), Curve::default());
        let curve = Curve::averaged(&depth, &force);
        assert!(curve.depth_m.iter().zip(&curve.measured_n).all(|(d, f)| (f - 7.0 * d).abs() < 1e-12));
        assert_eq!(Curve::averaged(&[], &[]), Curve::default());
        // an end that is not a multiple of its 48th part
        for end in [7.00227e-3, 7.00252e-3, 7.003e-3] {
            let depth: Vec<f64> = (0..600).map(|i| end * f64::from(i) / 599.0).collect();
            let curve = Curve::averaged(&depth, &depth);
            let beyond_contact = curve.depth_m.iter().zip(&curve.measured_n).skip(1);
            assert!(beyond_contact.fold(0.0, |most: f64, (d, f)| most.max((f - d).abs())) < 1e-12, "{end}");
        }
    }
}
