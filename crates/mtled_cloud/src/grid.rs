//! Points in a uniform grid of linked lists: which lie within a distance of a place? For points that come one by one, as
//! clouds are packed and coarse nodes chosen. (Supports of different size that hold a place are another question, see
//! `approximation::support` of `mtled`.)

use crate::vector::{Point, dot, sub};

const NONE: u32 = u32::MAX;

/// Where points lie, by cells; the points themselves are the caller's.
pub struct Grid {
    low: Point,
    inverse: f64,
    counts: [usize; 3],
    heads: Vec<u32>,
    next: Vec<u32>,
}

impl Grid {
    /// A grid over the box `low`..`high` with about one cell for each of `expected` points.
    pub(crate) fn new(low: Point, high: Point, expected: usize) -> Self {
        let size = [0, 1, 2].map(|k| high[k] - low[k]);
        Self::of_cells(low, high, (size[0] * size[1] * size[2] / (2.0 * expected as f64).max(1.0)).cbrt())
    }

    /// A grid over the box `low`..`high`, which may be flat, with cells of this width.
    #[must_use]
    pub fn of_cells(low: Point, high: Point, cell: f64) -> Self {
        let counts = [0, 1, 2].map(|k| ((high[k] - low[k]) / cell).ceil().max(1.0) as usize);
        Self { low, inverse: 1.0 / cell, counts, heads: vec![NONE; counts.iter().product()], next: Vec::new() }
    }

    fn index(&self, axis: usize, x: f64) -> usize {
        (((x - self.low[axis]) * self.inverse).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    /// Adds the next point: points must come in order of their index, from 0.
    pub fn push(&mut self, p: Point) {
        let at = (self.index(2, p[2]) * self.counts[1] + self.index(1, p[1])) * self.counts[0] + self.index(0, p[0]);
        self.next.push(self.heads[at]);
        self.heads[at] = (self.next.len() - 1) as u32;
    }

    /// Holds these points and no others.
    pub(crate) fn refill(&mut self, points: &[Point]) {
        self.heads.fill(NONE);
        self.next.clear();
        points.iter().for_each(|&p| self.push(p));
    }

    /// Whether any point is nearer to p than `gap` times the mean of their spacings, `h` being that at p and `spacings` those at the points,
    /// which grow by `growth` per length at most.
    pub(crate) fn crowded(
        &self,
        points: &[Point],
        spacings: &[f64],
        p: Point,
        h: f64,
        [gap, growth]: [f64; 2],
    ) -> bool {
        self.any(points, p, gap * h / (1.0 - 0.5 * gap * growth), |j, squared| {
            let least = 0.5 * gap * (h + spacings[j as usize]);
            squared < least * least
        })
    }

    /// Calls `f(index, squared distance)` for every point within r of p until it returns true; returns whether it did.
    #[inline]
    pub fn any(&self, points: &[Point], p: Point, r: f64, mut f: impl FnMut(u32, f64) -> bool) -> bool {
        let range = [0, 1, 2].map(|k| (self.index(k, p[k] - r), self.index(k, p[k] + r)));
        for k in range[2].0..=range[2].1 {
            for j in range[1].0..=range[1].1 {
                for i in range[0].0..=range[0].1 {
                    let mut at = self.heads[(k * self.counts[1] + j) * self.counts[0] + i];
                    while at != NONE {
                        let d = sub(points[at as usize], p);
                        let squared = dot(d, d);
                        if squared < r * r && f(at, squared) {
                            return true;
                        }
                        at = self.next[at as usize];
                    }
                }
            }
        }
        false
    }
}
