//! Moves the free nodes of a half plane: apart while it is filled, and to where their triangles are well shaped.

use super::{CLEARANCE, Nodes, Plane, REFRESH, RELAXATIONS};
use crate::packing::pushed;
use crate::triangulate::orient;
use crate::vector::{Point, add, scale};

impl Plane<'_> {
    /// Short-range forces between neighbours, as in [`crate::packing`].
    pub(super) fn relax(&self, nodes: &mut Nodes) {
        let mut near: Vec<Vec<u32>> = Vec::new();
        for iteration in 0..RELAXATIONS {
            let spacings: Vec<f64> = nodes.points.iter().map(|&p| self.h(p)).collect();
            if iteration % REFRESH == 0 {
                let grid = self.grid(&nodes.points);
                near = (nodes.fixed..nodes.points.len())
                    .map(|i| {
                        let mut found = Vec::new();
                        grid.any(&nodes.points, nodes.points[i], 1.7 * spacings[i], |j, _| {
                            if j as usize != i {
                                found.push(j);
                            }
                            false
                        });
                        found
                    })
                    .collect();
            }
            let moved: Vec<Point> = (nodes.fixed..nodes.points.len())
                .map(|i| self.relaxed(&nodes.points, &spacings, i, &near[i - nodes.fixed]))
                .collect();
            nodes.points[nodes.fixed..].copy_from_slice(&moved);
        }
    }

    fn relaxed(&self, points: &[Point], spacings: &[f64], i: usize, near: &[u32]) -> Point {
        let (p, h) = (points[i], spacings[i]);
        let q = pushed(p, h, near.iter().map(|&j| (points[j as usize], spacings[j as usize])));
        if self.room(q) < CLEARANCE * self.h(q) || self.reserved(q) { p } else { q }
    }

    /// One sweep of centroidal-patch smoothing (Chen 2004), graded: each free node goes to the mean of its triangles'
    /// centroids, weighted by area over h².
    pub(super) fn smooth(&self, points: &mut [Point], fixed: &[bool], triangles: &[[u32; 3]]) {
        let mut sums = vec![([0.0; 3], 0.0); points.len()];
        for t in triangles {
            let p = t.map(|v| points[v as usize]);
            let middle = scale(add(add(p[0], p[1]), p[2]), 1.0 / 3.0);
            let weight = orient(p[0], p[1], p[2]) / self.h(middle).powi(2);
            for &v in t {
                let (sum, total) = &mut sums[v as usize];
                *sum = add(*sum, scale(middle, weight));
                *total += weight;
            }
        }
        for (i, (sum, total)) in sums.into_iter().enumerate() {
            if fixed[i] || total <= 0.0 {
                continue;
            }
            let q = scale(sum, 1.0 / total);
            if self.room(q) > 0.5 * CLEARANCE * self.h(q) && !self.reserved(q) {
                points[i] = q;
            }
        }
    }
}
