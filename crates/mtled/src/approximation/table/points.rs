//! How many points a cell is integrated with.

use super::{Approximation, Share};

impl Approximation {
    /// Integrates the cells of some regions with four points each, `four` by region: one point a cell does not see how a soft layer folds
    /// that is crushed between stiff ones.
    #[must_use]
    pub fn with_four_points(mut self, four: &[bool]) -> Self {
        self.four = four.to_vec();
        for cell in 0..self.cells.len() {
            if self.has_four(self.regions.of_cell(cell)) {
                self.share[cell] = Share::Own;
            }
        }
        self
    }

    fn has_four(&self, region: u8) -> bool {
        self.four.get(usize::from(region)) == Some(&true)
    }

    /// Points of a cell of this region, with their weights.
    pub(super) fn gauss_points(&self, region: u8) -> Vec<([f64; 4], f64)> {
        let own = self.settings.points_per_cell;
        gauss_points(if self.has_four(region) { own.max(4) } else { own })
    }
}

/// Barycentric points and weights of degree 1, 2 and 3 (the last with one negative weight: Keast).
fn gauss_points(n: u32) -> Vec<([f64; 4], f64)> {
    let vertex = |a: f64| (0..4).map(move |i| std::array::from_fn(|k| if k == i { a } else { (1.0 - a) / 3.0 }));
    match n {
        4 => vertex(0.585_410_196_624_968_5).map(|p| (p, 0.25)).collect(),
        5 => std::iter::once(([0.25; 4], -0.8)).chain(vertex(0.5).map(|p| (p, 0.45))).collect(),
        _ => vec![([0.25; 4], 1.0)],
    }
}
