//! Regions of different materials: where supports end.
//!
//! The gradient of the displacement jumps where the modulus does, and a moving-least-squares fit through both sides smears
//! the jump over a support. So each region has a fit of its own, through the nodes of its own cells: those on an interface
//! belong to the fits of both sides, which tie the sides together. Linear fields are met exactly on both, so the patch test
//! holds; in general the two fits differ at the interface by what either is off, and the field there is their mean.
//!
//! A support that ends at an interface has lost up to half of its nodes, and the fit there is another one. The radii of the nodes near
//! it are such that regions of one modulus have the force of no regions. What else was tried stands in docs/lab/interfaces.md.

use std::collections::BTreeMap;

use super::mls::Neighbour;
use crate::vector::{Point, dot, sub};

/// Radii of nodes near an interface over others', in a half plane and in space. In a half plane points there then have as many nodes as
/// those within a region. In space, where one point stands for two cells, a one-sided fit is softer than the tissue, and the softer the
/// wider: with 0.9 an interface between equals costs at most 0.4 % of the force, 1 % where a needle's tip is at it (docs/lab/interfaces.md).
const RADII: [f64; 2] = [1.2, 0.9];

/// Which region cells and nodes belong to; none: one region.
#[derive(Clone, Debug, Default)]
pub(super) struct Regions {
    /// Empty: one region.
    pub(super) of_cell: Vec<u8>,
    /// One bit for each region that a node has a cell in.
    of_node: Vec<u64>,
    /// Node at a place, by the bits of its coordinates.
    at: BTreeMap<[u64; 3], u32>,
}

impl Regions {
    /// Regions of a cloud, `region` below 64 being that of each cell.
    pub(super) fn new<const K: usize>(points: &[[f64; 3]], cells: &[[u32; K]], region: &[u8]) -> Self {
        if region.iter().all(|r| *r == region[0]) {
            return Self { of_cell: region.to_vec(), ..Self::default() };
        }
        let mut of_node = vec![0; points.len()];
        for (c, r) in cells.iter().zip(region) {
            c.iter().for_each(|&n| of_node[n as usize] |= 1 << r);
        }
        let at = points.iter().zip(0..).map(|(p, n)| (p.map(f64::to_bits), n)).collect();
        Self { of_cell: region.to_vec(), of_node, at }
    }

    /// Scales the radii near interfaces: of the nodes of all cells that have a node in several regions.
    pub(super) fn scale<const K: usize>(&self, cells: &[[u32; K]], radii: &mut [f64]) {
        let mut near = vec![false; radii.len()];
        let several = |n: &u32| self.of_node.get(*n as usize).is_some_and(|bits| bits.count_ones() > 1);
        for c in cells.iter().filter(|c| c.iter().any(several)) {
            c.iter().for_each(|&n| near[n as usize] = true);
        }
        let factor = RADII[usize::from(K > 3)];
        radii.iter_mut().zip(near).filter(|(_, near)| *near).for_each(|(r, _)| *r *= factor);
    }

    pub(super) fn of_cell(&self, cell: usize) -> u8 {
        self.of_cell.get(cell).copied().unwrap_or(0)
    }

    /// Leaves out the neighbours that are not of a region; `node` of a neighbour's index.
    pub(super) fn keep(&self, region: u8, neighbours: &mut Vec<Neighbour>, node: impl Fn(u32) -> u32) {
        if !self.of_node.is_empty() {
            neighbours.retain(|n| self.of_node[node(n.node) as usize] >> region & 1 == 1);
        }
    }

    /// Regions of a place: those of a node, or that of the cell that is `inside` of most, its least barycentric coordinate.
    pub(super) fn at(&self, x: [f64; 3], inside: impl Fn(usize) -> f64) -> Vec<u8> {
        if self.of_node.is_empty() {
            return vec![self.of_cell(0)];
        }
        if let Some(&node) = self.at.get(&x.map(f64::to_bits)) {
            let bits = self.of_node[node as usize];
            return (0..64).filter(|r| bits >> r & 1 == 1).collect();
        }
        let mut best = (f64::NEG_INFINITY, 0);
        for (cell, &region) in self.of_cell.iter().enumerate() {
            let least = inside(cell);
            if least > best.0 {
                best = (least, region);
            }
        }
        vec![best.1]
    }
}

/// Least barycentric coordinate of a place in a cell with these corners, by the slopes of the coordinates: 0 or more inside.
pub(super) fn least_barycentric<const K: usize>(corners: &[Point; K], slope: &[Point; K], at: Point) -> f64 {
    let value = |a: usize| dot(slope[a], sub(at, corners[(a + 1) % K]));
    (0..K).map(value).fold(f64::INFINITY, f64::min)
}
