//! Outliers that no model explains.

/// A residual whose size exceeds this multiple of the median size is a spike (for normal noise: six standard
/// deviations).
const SPIKE: f64 = 9.0;
/// Largest share of the readings that may be spikes.
const MOST_LEFT_OUT: f64 = 0.02;

/// The largest size that is no outlier; infinite if most values are zero.
pub(super) fn largest(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|d| d.abs()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    Some(SPIKE * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0)).filter(|most| *most > 0.0).unwrap_or(f64::INFINITY)
}

/// Limits the outliers of residuals or of a derivative, for a needle whose puncture makes the force fall at once.
///
/// With a trial value the puncture is at another reading than the measured one, and in the second run of a finite
/// difference at yet another. The fall between them would outweigh all other readings. It says where the puncture is,
/// but its derivative over the small change of a key does not.
pub(super) fn limit(values: &mut [f64]) {
    let most = largest(values);
    values.iter_mut().for_each(|value| *value = value.clamp(-most, most));
}

/// The rows that remain of the fitted ones without those whose residuals are outliers. A spike of a few readings (a bond that
/// releases, a knock) is not part of the model and would bias every value. If many readings are outliers the model is
/// wrong, and all rows remain.
pub(super) fn without(fitted: &[usize], residuals: &[f64]) -> Vec<usize> {
    let components: Vec<&[f64]> = residuals.chunks_exact(fitted.len()).collect();
    let most = |residuals: &&[f64]| {
        let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        SPIKE * sizes[sizes.len() / 2]
    };
    let most: Vec<f64> = components.iter().map(most).collect();
    let near = |row: &usize| components.iter().zip(&most).all(|(r, most)| r[*row].abs() <= *most);
    let kept: Vec<usize> = (0..fitted.len()).filter(near).map(|row| fitted[row]).collect();
    let left = (fitted.len() - kept.len()) as f64;
    if left > MOST_LEFT_OUT * fitted.len() as f64 { fitted.to_vec() } else { kept }
}
