//! Readings that are no part of any model.

use super::problem::Recorded;

/// A residual of more than so many medians of all residuals' sizes is a spike (for normal noise: six standard deviations).
const SPIKE: f64 = 9.0;
/// Largest share of the readings that may be spikes.
const MOST_LEFT_OUT: f64 = 0.02;

impl Recorded<'_> {
    /// Leaves out the rows whose residuals are far from all others; gives how many. A spike of a few readings (a bond that lets
    /// go, a knock) is no part of the model and would pull at every value. Where many are far off the model is wrong, and
    /// nothing is left out.
    pub fn leave_out(&mut self, residuals: &[f64]) -> usize {
        let residuals = &residuals[..self.fitted.len()]; // those along the axis
        let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        let most = SPIKE * sizes[sizes.len() / 2];
        let kept: Vec<usize> =
            self.fitted.iter().zip(residuals).filter(|(_, r)| r.abs() <= most).map(|(i, _)| *i).collect();
        let left = self.fitted.len() - kept.len();
        if left as f64 > MOST_LEFT_OUT * self.fitted.len() as f64 {
            return 0;
        }
        self.fitted = kept;
        left
    }
}
