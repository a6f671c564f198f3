//! Better cells from the same nodes: thin cells on the side are peeled, bad edges and faces are replaced (edge removal
//! with the best triangulation of the ring round the edge; Klincsek 1980, Shewchuk 2002), movable nodes are shifted.
//! Every step raises the lowest quality of the cells that it touches, so no cell is ever inverted.

use crate::quality::volume_length;
use crate::vector::Point;

/// Cells below this quality are worked on.
const WANTED: f64 = 0.45;
/// Quality of a cell that reaches across an interface over that of its shape: such a cell is worked on, and rarely made.
const ACROSS: f64 = 0.3;
/// Least gain worth a change.
pub(super) const GAIN: f64 = 1e-6;

/// The nodes of a triangulation and what may be done to them.
pub(crate) struct Rules<'a> {
    /// Bits of the faces that each node lies on.
    pub(crate) faces: &'a [u8],
    /// Nodes that may not move.
    pub(crate) fixed: &'a [bool],
    /// Bits of the curved faces.
    pub(crate) curved: u8,
    /// One bit for each region that a node touches; empty without regions.
    pub(crate) regions: &'a [u64],
    /// Puts a node back on its face; None where it may not be.
    pub(crate) place: &'a dyn Fn(u8, Point) -> Option<Point>,
}

pub(crate) struct Mesh<'a> {
    pub(crate) points: Vec<Point>,
    pub(super) rules: Rules<'a>,
    pub(super) cells: Vec<[u32; 4]>,
    pub(super) quality: Vec<f64>,
    alive: Vec<bool>,
    free: Vec<u32>,
    pub(super) star: Vec<Vec<u32>>,
}

impl<'a> Mesh<'a> {
    pub(crate) fn new(points: Vec<Point>, cells: Vec<[u32; 4]>, rules: Rules<'a>) -> Self {
        let star = vec![Vec::with_capacity(28); points.len()];
        let mut mesh =
            Self { points, rules, cells: Vec::new(), quality: Vec::new(), alive: Vec::new(), free: Vec::new(), star };
        for c in cells {
            mesh.add(c);
        }
        mesh
    }

    /// Cells that are left, and the nodes' new places.
    pub(crate) fn finish(self) -> (Vec<Point>, Vec<[u32; 4]>) {
        let alive = self.alive;
        (self.points, self.cells.into_iter().enumerate().filter(|(i, _)| alive[*i]).map(|(_, c)| c).collect())
    }

    fn corners(&self, c: [u32; 4]) -> [Point; 4] {
        c.map(|v| self.points[v as usize])
    }

    pub(super) fn measure(&self, c: [u32; 4]) -> f64 {
        let quality = volume_length(&self.corners(c));
        if self.reaches_across(c) { ACROSS * quality } else { quality }
    }

    /// Whether a cell has nodes on both sides of an interface.
    fn reaches_across(&self, c: [u32; 4]) -> bool {
        let regions = self.rules.regions;
        !regions.is_empty() && c.iter().fold(u64::MAX, |bits, &v| bits & regions[v as usize]) == 0
    }

    pub(super) fn add(&mut self, c: [u32; 4]) {
        let q = self.measure(c);
        let at = match self.free.pop() {
            Some(at) => {
                self.cells[at as usize] = c;
                self.quality[at as usize] = q;
                self.alive[at as usize] = true;
                at
            }
            None => {
                self.cells.push(c);
                self.quality.push(q);
                self.alive.push(true);
                (self.cells.len() - 1) as u32
            }
        };
        for v in c {
            self.star[v as usize].push(at);
        }
    }

    pub(super) fn remove(&mut self, at: u32) {
        for v in self.cells[at as usize] {
            let star = &mut self.star[v as usize];
            if let Some(k) = star.iter().position(|&c| c == at) {
                star.swap_remove(k);
            }
        }
        self.alive[at as usize] = false;
        self.free.push(at);
    }

    pub(super) fn shared_faces(&self, nodes: &[u32]) -> u8 {
        nodes.iter().fold(u8::MAX, |bits, &v| bits & self.rules.faces[v as usize])
    }

    /// Drops the cells between a curved face and the surface triangles just under it: all four nodes on the face.
    pub(crate) fn peel(&mut self) {
        for at in 0..self.cells.len() as u32 {
            if self.alive[at as usize] && self.shared_faces(&self.cells[at as usize]) & self.rules.curved != 0 {
                self.remove(at);
            }
        }
    }

    /// Works on all cells below [`WANTED`], the worst first, until a pass changes nothing or `passes` are done.
    pub(crate) fn improve(&mut self, passes: usize) {
        for _ in 0..passes {
            let mut bad: Vec<(f64, u32)> = (0..self.cells.len() as u32)
                .filter(|&c| self.alive[c as usize] && self.quality[c as usize] < WANTED)
                .map(|c| (self.quality[c as usize], c))
                .collect();
            bad.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut changed = 0;
            for (was, at) in bad {
                if !self.alive[at as usize] || self.quality[at as usize] != was {
                    continue;
                }
                if self.reconnect(at) {
                    changed += 1;
                    continue;
                }
                for v in self.cells[at as usize] {
                    changed += usize::from(self.shift(v));
                }
            }
            if changed == 0 {
                break;
            }
        }
    }
}
