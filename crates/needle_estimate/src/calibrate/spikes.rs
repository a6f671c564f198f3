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
        let components: Vec<&[f64]> = residuals.chunks_exact(self.fitted.len()).collect();
        let most = |residuals: &&[f64]| {
            let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            SPIKE * sizes[sizes.len() / 2]
        };
        let most: Vec<f64> = components.iter().map(most).collect();
        let near = |row: &usize| components.iter().zip(&most).all(|(r, most)| r[*row].abs() <= *most);
        let kept: Vec<usize> = (0..self.fitted.len()).filter(near).map(|row| self.fitted[row]).collect();
        let left = self.fitted.len() - kept.len();
        if left as f64 > MOST_LEFT_OUT * self.fitted.len() as f64 {
            return 0;
        }
        self.fitted = kept;
        left
    }
}
