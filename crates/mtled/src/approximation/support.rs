//! Support domains: a point x uses node j if |x - x_j| < 0.95 r_j, the radius r_j of the weight belonging to the node
//! (ExplicitSim's rule, but for the `REACH`).

use super::mls::Neighbour;
use super::weight;
use crate::vector::bounds;
pub use crate::vector::distance;

/// r_j = alpha * mean length of the cell edges at node j, each edge counted once per incident cell, m. Cells are
/// tetrahedra or triangles.
#[must_use]
pub fn radii<const K: usize>(points: &[[f64; 3]], cells: &[[u32; K]], alpha: f64) -> Vec<f64> {
    let mut sum = vec![0.0; points.len()];
    let mut count = vec![0u32; points.len()];
    for c in cells {
        for a in 0..K {
            for b in a + 1..K {
                let (i, j) = (c[a] as usize, c[b] as usize);
                let length = distance(points[i], points[j]);
                for n in [i, j] {
                    sum[n] += length;
                    count[n] += 1;
                }
            }
        }
    }
    sum.iter().zip(&count).map(|(s, &n)| if n == 0 { 0.0 } else { alpha * s / f64::from(n) }).collect()
}

/// Share of its radius within which a node counts: beyond it the quartic weight is below 0.05 %, for a seventh of the nodes
/// that a ball holds.
pub(crate) const REACH: f64 = 0.95;

/// Leaves out the nodes that are farther from the point than [`REACH`] of their radius.
pub(crate) fn within_reach(neighbours: &mut Vec<Neighbour>) {
    neighbours.retain(|n| n.offset.iter().map(|c| c * c).sum::<f64>() < (REACH * n.radius).powi(2));
}

/// Node cloud with support radii, searchable by point. Each node is entered in every grid box that its support
/// touches, so that a query reads one box.
#[derive(Clone, Debug)]
pub struct Supports {
    points: Vec<[f64; 3]>,
    radii: Vec<f64>,
    interpolating: Vec<bool>,
    low: [f64; 3],
    inv_box: f64,
    boxes: [usize; 3],
    start: Vec<u32>,
    entries: Vec<u32>,
}

impl Supports {
    /// Indexes a cloud. `interpolating` marks the nodes that get the almost singular weight.
    #[must_use]
    pub fn new(points: &[[f64; 3]], radii: Vec<f64>, interpolating: Vec<bool>) -> Self {
        let [low, high] = bounds(points);
        // The median radius balances boxes per support against candidates per query on a graded cloud.
        let mut sorted = radii.clone();
        sorted.sort_by(f64::total_cmp);
        let widest = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let size = (0.6 * sorted.get(sorted.len() / 2).copied().unwrap_or(1.0)).max(widest / 200.0);
        let inv_box = 1.0 / size;
        let boxes = std::array::from_fn(|k| ((high[k] - low[k]) * inv_box) as usize + 1);
        let mut grid = Self {
            points: points.to_vec(),
            radii,
            interpolating,
            low,
            inv_box,
            boxes,
            start: Vec::new(),
            entries: Vec::new(),
        };
        grid.fill();
        grid
    }

    fn fill(&mut self) {
        let total = self.boxes.iter().product::<usize>();
        let mut count = vec![0u32; total + 1];
        for j in 0..self.points.len() {
            self.for_boxes(j, |b| count[b + 1] += 1);
        }
        for b in 0..total {
            count[b + 1] += count[b];
        }
        let mut entries = vec![0u32; count[total] as usize];
        let mut next = count.clone();
        for j in 0..self.points.len() {
            self.for_boxes(j, |b| {
                entries[next[b] as usize] = j as u32;
                next[b] += 1;
            });
        }
        self.start = count;
        self.entries = entries;
    }

    fn for_boxes(&self, j: usize, mut visit: impl FnMut(usize)) {
        let (p, r) = (self.points[j], self.radii[j]);
        let range = |k: usize| {
            let a = ((p[k] - r - self.low[k]) * self.inv_box).max(0.0) as usize;
            let b = ((p[k] + r - self.low[k]) * self.inv_box).max(0.0) as usize;
            a..=b.min(self.boxes[k] - 1)
        };
        let size = 1.0 / self.inv_box;
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    // skip boxes of the bounding cube that the ball does not reach
                    let gap: f64 = [x, y, z]
                        .iter()
                        .enumerate()
                        .map(|(k, &i)| {
                            let a = self.low[k] + i as f64 * size;
                            let d = (a - p[k]).max(p[k] - a - size).max(0.0);
                            d * d
                        })
                        .sum();
                    if gap < r * r {
                        visit((z * self.boxes[1] + y) * self.boxes[0] + x);
                    }
                }
            }
        }
    }

    /// Nodes whose support holds x, in node order, with their weights there. Overwrites `out`.
    pub fn at(&self, x: [f64; 3], out: &mut Vec<Neighbour>) {
        out.clear();
        let b: [usize; 3] =
            std::array::from_fn(|k| (((x[k] - self.low[k]) * self.inv_box).max(0.0) as usize).min(self.boxes[k] - 1));
        let b = (b[2] * self.boxes[1] + b[1]) * self.boxes[0] + b[0];
        for &j in &self.entries[self.start[b] as usize..self.start[b + 1] as usize] {
            let (p, r) = (self.points[j as usize], self.radii[j as usize]);
            let offset: [f64; 3] = std::array::from_fn(|k| p[k] - x[k]);
            let d2: f64 = offset.iter().map(|c| c * c).sum();
            if d2 < r * r {
                let s = d2.sqrt() / r;
                let weight = if self.interpolating[j as usize] { weight::interpolating(s) } else { weight::quartic(s) };
                out.push(Neighbour { node: j, offset, radius: r, weight });
            }
        }
    }

    /// Support radii, m.
    #[must_use]
    pub fn radii(&self) -> &[f64] {
        &self.radii
    }

    /// Nodes, m.
    #[must_use]
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// Which nodes have the almost singular weight.
    #[must_use]
    pub fn interpolating(&self) -> &[bool] {
        &self.interpolating
    }
}
