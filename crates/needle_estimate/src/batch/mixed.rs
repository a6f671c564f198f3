//! Spread of a key within samples and between them: y_ij = m + b_i + e_ij for recording j of sample i, b_i and e_ij
//! normal.
//!
//! Restricted maximum likelihood (Patterson and Thompson, Biometrika 58, 1971). The likelihood depends on one ratio
//! l:
//!
//! ```text
//! l = s_b^2 / s_w^2,   w_i = n_i / (1 + l n_i),   m = sum w_i y_i / sum w_i      y_i: mean of sample i
//! R = sum_ij (y_ij - y_i)^2 + sum w_i (y_i - m)^2,   s_w^2 = R / (N - 1)
//! -2 log L = (N - 1) log(R / (N - 1)) + sum log(1 + l n_i) + log(sum w_i) + constant
//! ```
//!
//! The samples may have different numbers of recordings. For equal numbers it is the analysis of variance: s_w^2 =
//! MS_w and s_b^2 = (MS_b - MS_w) / n, if that is not negative (Searle, Casella and McCulloch, Variance Components,
//! 1992, 3.8).

/// Grid points of the share s_b^2 / (s_b^2 + s_w^2), before the refinement.
const GRID: usize = 200;
/// Golden-section steps of the refinement.
const REFINED: usize = 60;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// See the module. For a single sample, or for one recording per sample, the component that can't be estimated is
/// `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Components {
    /// m
    pub mean: f64,
    /// Its standard error, from both variance components.
    pub mean_error: Option<f64>,
    /// s_w, standard deviation of recordings on one sample.
    pub within: Option<f64>,
    /// s_b, standard deviation of samples.
    pub between: Option<f64>,
}

/// Number of recordings of one sample, their mean, and the sum of squares about it.
struct Sample {
    n: f64,
    mean: f64,
    squares: f64,
}

/// All estimates for a ratio l.
struct Fitted {
    deviance: f64,
    mean: f64,
    mean_error: f64,
    within: f64,
}

fn fitted(samples: &[Sample], ratio: f64) -> Fitted {
    let weight = |s: &Sample| s.n / (1.0 + ratio * s.n);
    let whole: f64 = samples.iter().map(weight).sum();
    let mean = samples.iter().map(|s| weight(s) * s.mean).sum::<f64>() / whole;
    let squares: f64 = samples.iter().map(|s| s.squares + weight(s) * (s.mean - mean).powi(2)).sum();
    let free = samples.iter().map(|s| s.n).sum::<f64>() - 1.0;
    let variance = squares / free;
    let logarithms: f64 = samples.iter().map(|s| (1.0 + ratio * s.n).ln()).sum();
    let deviance = free * variance.ln() + logarithms + whole.ln();
    Fitted { deviance, mean, mean_error: (variance / whole).sqrt(), within: variance.sqrt() }
}

impl Components {
    /// Estimates the components from the values of each sample; `None` without values.
    #[must_use]
    pub(crate) fn of(samples: &[Vec<f64>]) -> Option<Self> {
        let of = |values: &Vec<f64>| {
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            Sample { n, mean, squares: values.iter().map(|y| (y - mean) * (y - mean)).sum() }
        };
        let samples: Vec<Sample> = samples.iter().filter(|values| !values.is_empty()).map(of).collect();
        let all: f64 = samples.iter().map(|s| s.n).sum();
        let k = samples.len() as f64;
        if samples.is_empty() {
            return None;
        }
        let alone = fitted(&samples, 0.0);
        let squares: f64 = samples.iter().map(|s| s.squares).sum();
        if samples.len() == 1 || all <= k || squares == 0.0 {
            // the two components can't be separated without repeats, or with a single sample
            let spread = (all > k).then(|| (squares / (all - k)).sqrt());
            let mean_error = (all > 1.0).then_some(alone.mean_error);
            return Some(Self { mean: alone.mean, mean_error, within: spread, between: None });
        }
        let ratio = least(|share| fitted(&samples, share / (1.0 - share)).deviance);
        let best = fitted(&samples, ratio);
        let between = Some(ratio.sqrt() * best.within);
        Some(Self { mean: best.mean, mean_error: Some(best.mean_error), within: Some(best.within), between })
    }
}

/// The ratio that minimises a function of the share.
fn least(deviance: impl Fn(f64) -> f64) -> f64 {
    // dense towards 1, where samples differ by far more than the recordings of one sample
    let share = |k: usize| 1.0 - (1.0 - k as f64 / GRID as f64).powi(4);
    let best = (0..GRID).min_by(|&a, &b| deviance(share(a)).total_cmp(&deviance(share(b)))).unwrap_or(0);
    let (mut low, mut high) = (share(best.saturating_sub(1)), share((best + 1).min(GRID - 1)));
    for _ in 0..REFINED {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if deviance(a) <= deviance(b) { high = b } else { low = a }
    }
    let found = if deviance(0.0) <= deviance(low) { 0.0 } else { 0.5 * (low + high) };
    found / (1.0 - found)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng as _;
    use rand_distr::{Distribution, StandardNormal};

    /// Searle's balanced case by hand: MS_w = 1, MS_b = 2 * 8 = 16 with two recordings of each of two samples.
    #[test]
    fn of_as_many_each_it_is_the_analysis_of_variance() {
        let half = 0.5f64.sqrt();
        let found = Components::of(&[vec![0.0 - half, 0.0 + half], vec![4.0 - half, 4.0 + half]]).unwrap();
        assert!((found.mean - 2.0).abs() < 1e-12 && (found.within.unwrap() - 1.0).abs() < 1e-6, "{found:?}");
        assert!((found.between.unwrap() - 7.5f64.sqrt()).abs() < 1e-6, "{found:?}");
        assert!((found.mean_error.unwrap() - 2.0).abs() < 1e-6, "sqrt(MS_b / N): {found:?}");
        // samples that differ by less than their recordings
        let alike = Components::of(&[vec![-1.0, 1.0], vec![-1.1, 0.9]]).unwrap();
        assert_eq!(alike.between, Some(0.0));
        assert_eq!(Components::of(&[vec![1.0]]).unwrap().within, None);
        assert_eq!(Components::of(&[vec![1.0], vec![2.0]]).unwrap().between, None);
        assert_eq!(Components::of(&[]), None);
    }

    /// Compared with statsmodels 0.15.0, MixedLM(y, 1, groups).fit(reml=True), recorded in docs/lab/calibration.md.
    #[test]
    fn of_unequal_numbers_it_is_what_an_independent_program_finds() {
        let samples =
            [vec![9.1, 9.4, 8.8, 9.0], vec![10.2, 10.6], vec![9.7, 9.9, 10.1, 9.6, 9.8], vec![11.0, 11.3, 10.9]];
        let found = Components::of(&samples).unwrap();
        for (value, by_statsmodels) in [
            (found.mean, STATSMODELS[0]),
            (found.within.unwrap(), STATSMODELS[1]),
            (found.between.unwrap(), STATSMODELS[2]),
        ] {
            assert!((value / by_statsmodels - 1.0).abs() < 1e-4, "{found:?}");
        }
    }
    const STATSMODELS: [f64; 3] = [10.087_416_16, 0.224_034_915, 0.839_061_36];

    #[test]
    fn what_made_the_data_comes_back_without_bias() {
        // a modulus of 10 kPa, 8 % between samples and 2 % within, unequal numbers
        let (truth, within, between, seeds) = (10.0, 0.2, 0.8, 400);
        let mut sums = [[0.0; 2]; 3];
        for seed in 0..seeds {
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            let mut normal = |s: f64| -> f64 { s * Distribution::<f64>::sample(&StandardNormal, &mut generator) };
            let samples: Vec<Vec<f64>> = (0..8)
                .map(|i| {
                    let of_sample = truth + normal(between);
                    (0..2 + i % 4).map(|_| of_sample + normal(within)).collect()
                })
                .collect();
            let found = Components::of(&samples).unwrap();
            let errors = [
                found.mean - truth,
                found.within.unwrap().powi(2) - within * within,
                found.between.unwrap().powi(2) - between * between,
            ];
            for (sum, e) in sums.iter_mut().zip(errors) {
                *sum = [sum[0] + e, sum[1] + e * e];
            }
        }
        let n = seeds as f64;
        for (sum, what) in sums.iter().zip(["mean", "within", "between"]) {
            let (bias, variance) = (sum[0] / n, sum[1] / n - (sum[0] / n).powi(2));
            let error = (variance / n).sqrt();
            println!("{what}: bias {bias:.5}, standard error {error:.5}");
            assert!(bias.abs() < 3.0 * error, "{what}: {bias} ± {error}");
        }
    }
}
