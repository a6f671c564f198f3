//! How many points a cell is integrated with, and where they are.

use super::{Approximation, Settings, Share, tetrahedron};
use crate::approximation::join;
use crate::vector::Point;

/// Points (m) and volumes (m^3) that the caller brings, by the cell that they belong to.
#[derive(Clone, Debug, Default)]
pub(super) struct GivenPoints {
    /// Offsets, one more than cells.
    start: Vec<u32>,
    points: Vec<(Point, f64)>,
}

impl GivenPoints {
    fn new(cells: usize, points: &[(u32, Point, f64)]) -> Self {
        let start = (0..=cells as u32).map(|c| points.partition_point(|(cell, ..)| *cell < c) as u32).collect();
        Self { start, points: points.iter().map(|&(_, at, volume)| (at, volume)).collect() }
    }

    /// Those of a cell.
    pub(super) fn of(&self, cell: usize) -> &[(Point, f64)] {
        match self.start.get(cell..cell + 2) {
            Some(&[from, to]) => &self.points[from as usize..to as usize],
            _ => &[],
        }
    }
}

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

    /// Integrates `cells` with points that the caller brings and no others: the cell that a point belongs to, its place (m) and its volume
    /// (m^3), by cell. The cells beside them are joined among themselves. To be called last.
    #[must_use]
    pub fn with_points(mut self, cells: &[u32], points: &[(u32, Point, f64)]) -> Self {
        if self.settings.basis.is_none() || cells.is_empty() {
            return self;
        }
        // no pair reaches from these cells to what lies beside them
        let mut part: Vec<u8> = (0..self.cells.len()).map(|cell| 2 * self.regions.of_cell(cell)).collect();
        cells.iter().for_each(|&cell| part[cell as usize] |= 1);
        self.share = shares(&self.points, &self.cells, &part, &self.settings);
        let four = std::mem::take(&mut self.four);
        self = self.with_four_points(&four);
        cells.iter().for_each(|&cell| self.share[cell as usize] = Share::Given);
        self.given = GivenPoints::new(self.cells.len(), points);
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

    /// Places and volumes of the points of a cell of its own.
    pub(super) fn gauss(&self, c: &[u32; 4], region: u8) -> Vec<([f64; 3], f64)> {
        let x = self.corners(c);
        let (volume, _) = tetrahedron(&x);
        let place = |bary: &[f64; 4]| std::array::from_fn(|k| (0..4).map(|a| bary[a] * x[a][k]).sum());
        self.gauss_points(region).iter().map(|(bary, weight)| (place(bary), weight * volume)).collect()
    }

    /// The point at the centroid of two cells.
    pub(super) fn pair(&self, cells: [&[u32; 4]; 2]) -> ([f64; 3], f64) {
        let corners = cells.map(|c| self.corners(c));
        let volumes = [tetrahedron(&corners[0]).0, tetrahedron(&corners[1]).0];
        let volume = volumes[0] + volumes[1];
        let share = [0.25 * volumes[0] / volume, 0.25 * volumes[1] / volume];
        let at = std::array::from_fn(|k| (0..2).map(|c| share[c] * corners[c].iter().map(|x| x[k]).sum::<f64>()).sum());
        (at, volume)
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

/// What each cell is integrated with: pairs lie in one region.
pub(super) fn shares(points: &[[f64; 3]], cells: &[[u32; 4]], region: &[u8], settings: &Settings) -> Vec<Share> {
    if settings.cells_per_point == 1 || settings.points_per_cell > 1 || settings.basis.is_none() {
        return vec![Share::Own; cells.len()];
    }
    let corners = |c: &[u32; 4]| c.map(|n| points[n as usize]);
    let volume: Vec<f64> = cells.iter().map(|c| tetrahedron(&corners(c)).0).collect();
    join::pairs(points, cells, &volume, region)
}
