//! Regions of different materials: where supports end.
//!
//! The gradient of the displacement jumps where the modulus does, and a moving-least-squares fit through both sides smears
//! the jump over a support. So each region has a fit of its own, through the nodes of its own cells. Nodes on an interface
//! belong to both fits and have the almost interpolating weight, so that both take the nodal value there: the field is
//! continuous at the nodes of an interface, and its gradient is free to jump.

use std::collections::BTreeMap;

use super::mls::Neighbour;

/// Which region cells and nodes belong to; none: one region.
#[derive(Clone, Debug, Default)]
pub struct Regions {
    of_cell: Vec<u8>,
    /// One bit for each region that a node has a cell in.
    of_node: Vec<u64>,
    /// Node at a place, by the bits of its coordinates.
    at: BTreeMap<[u64; 3], u32>,
}

impl Regions {
    /// Regions of a cloud, `region` below 64 being that of each cell.
    #[must_use]
    pub fn new<const K: usize>(points: &[[f64; 3]], cells: &[[u32; K]], region: &[u8]) -> Self {
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

    /// Nodes that lie in several regions.
    pub fn interface(&self) -> impl Iterator<Item = usize> + '_ {
        self.of_node.iter().enumerate().filter(|(_, bits)| bits.count_ones() > 1).map(|(n, _)| n)
    }

    /// Region of a cell.
    #[must_use]
    pub fn of_cell(&self, cell: usize) -> u8 {
        self.of_cell.get(cell).copied().unwrap_or(0)
    }

    /// Region of each cell; empty: one region.
    #[must_use]
    pub fn of_cells(&self) -> &[u8] {
        &self.of_cell
    }

    /// Leaves out the neighbours that are not of a region; `node` of a neighbour's index.
    pub fn keep(&self, region: u8, neighbours: &mut Vec<Neighbour>, node: impl Fn(u32) -> u32) {
        if !self.of_node.is_empty() {
            neighbours.retain(|n| self.of_node[node(n.node) as usize] >> region & 1 == 1);
        }
    }

    /// Region of a place: the lowest of a node's, or that of the cell that is `inside` of most, its least barycentric
    /// coordinate.
    #[must_use]
    pub fn at(&self, x: [f64; 3], inside: impl Fn(usize) -> f64) -> u8 {
        if self.of_node.is_empty() {
            return self.of_cell(0);
        }
        if let Some(&node) = self.at.get(&x.map(f64::to_bits)) {
            return self.of_node[node as usize].trailing_zeros() as u8;
        }
        let mut best = (f64::NEG_INFINITY, 0);
        for (cell, &region) in self.of_cell.iter().enumerate() {
            let least = inside(cell);
            if least > best.0 {
                best = (least, region);
            }
        }
        best.1
    }
}
