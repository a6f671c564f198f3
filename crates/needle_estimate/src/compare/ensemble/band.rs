//! Bands of the members' force and covariance of their target positions.

/// Half-width of a 95 % band, in standard deviations of a normal distribution.
const HALF: f64 = 1.959_963_984_540_054;

/// Distribution of the members' force at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Band {
    /// Mean, N.
    pub mean_n: f64,
    /// Standard deviation, N.
    pub standard_deviation_n: f64,
    /// 2.5 % quantile, N.
    pub low_n: f64,
    /// 97.5 % quantile, N.
    pub high_n: f64,
}

impl Band {
    /// Cumulative probabilities at the lower and the upper end of the band.
    pub const SHARES: [f64; 2] = [0.025, 0.975];

    /// The band of the finite forces; `None` if there are none.
    #[must_use]
    pub(crate) fn of(forces: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = forces.filter(|f| f.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let (mean_n, variance) = moments(&sorted)?;
        let [low_n, high_n] = Self::SHARES.map(|share| quantile(&sorted, share));
        Some(Self { mean_n, standard_deviation_n: variance.sqrt(), low_n, high_n })
    }

    /// The band of a normal distribution.
    #[must_use]
    pub(crate) fn normal(mean_n: f64, standard_deviation_n: f64) -> Self {
        let half = HALF * standard_deviation_n;
        Self { mean_n, standard_deviation_n, low_n: mean_n - half, high_n: mean_n + half }
    }

    /// Whether a force lies inside the band.
    #[must_use]
    pub fn holds(&self, force_n: f64) -> bool {
        (self.low_n..=self.high_n).contains(&force_n)
    }
}

/// Mean, and variance with n - 1; `None` without values.
fn moments(values: &[f64]) -> Option<(f64, f64)> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
    (n > 0.0).then_some((mean, squares / (n - 1.0).max(1.0)))
}

/// Quantile of sorted values, at least one. Each of n values is the quantile at the middle of its part of the
/// probability, (i + 1/2) / n (Hazen's rule). In between it is interpolated linearly; beyond the outermost values it
/// is constant.
#[must_use]
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = (share * sorted.len() as f64 - 0.5).clamp(0.0, (sorted.len() - 1) as f64);
    let (below, part) = (place.floor() as usize, place.fract());
    match sorted.get(below + 1) {
        Some(above) if part > 0.0 => sorted[below] + part * (above - sorted[below]),
        _ => sorted[below],
    }
}

/// Distribution of a target's position over the members.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Mean position, m.
    pub mean_m: [f64; 3],
    /// Covariance of the position, m^2.
    pub covariance_m2: [[f64; 3]; 3],
}

impl Spread {
    /// Mean and covariance (with n - 1) of positions; `None` without positions.
    #[must_use]
    pub(crate) fn of(positions: impl Iterator<Item = [f64; 3]>) -> Option<Self> {
        let all: Vec<[f64; 3]> = positions.filter(|p| p.iter().all(|x| x.is_finite())).collect();
        let n = all.len() as f64;
        if all.is_empty() {
            return None;
        }
        let mean: [f64; 3] = std::array::from_fn(|i| all.iter().map(|p| p[i]).sum::<f64>() / n);
        let product = |i: usize, j: usize| -> f64 { all.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum() };
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| product(i, j) / (n - 1.0).max(1.0)));
        Some(Self { mean_m: mean, covariance_m2: covariance })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_take_each_value_for_an_equal_part() {
        let sorted: Vec<f64> = (0..40).map(f64::from).collect();
        // the lowest of forty values lies in the middle of the lowest fortieth
        assert_eq!(quantile(&sorted, 0.0125), 0.0);
        assert!((quantile(&sorted, 0.025) - 0.5).abs() < 1e-12 && (quantile(&sorted, 0.975) - 38.5).abs() < 1e-12);
        assert_eq!(
            (quantile(&sorted[..3], 0.025), quantile(&sorted[..3], 0.975)),
            (0.0, 2.0),
            "no further than it was seen"
        );
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let band = Band::of([1.0, f64::NAN, 3.0].into_iter()).unwrap();
        assert_eq!((band.mean_n, band.standard_deviation_n), (2.0, 2f64.sqrt()));
        assert!(band.holds(1.0) && !band.holds(3.1) && Band::of([f64::NAN].into_iter()).is_none());
        let spread = Spread::of([[0.0, 1.0, 2.0], [2.0, 1.0, 0.0]].into_iter()).unwrap();
        assert_eq!((spread.mean_m, spread.covariance_m2[0]), ([1.0; 3], [2.0, 0.0, -2.0]));
    }
}
