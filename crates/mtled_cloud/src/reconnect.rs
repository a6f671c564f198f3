//! New connections between the same nodes: edge removal with the best triangulation of the ring round the edge
//! (Klincsek 1980; Shewchuk 2002), turning of surface edges within a face as its open form, and 2-3 flips.

use crate::improve::{GAIN, Mesh};

/// Largest ring of cells round an edge that is considered.
const MAX_RING: usize = 9;

/// A change: gain in lowest quality, cells to remove, cells to add.
type Change = (f64, Vec<u32>, Vec<[u32; 4]>);

/// Cells round an edge a-b: the polygon of their other nodes, counter-clockwise seen from b.
struct Ring {
    cells: Vec<u32>,
    polygon: Vec<u32>,
    closed: bool,
    worst: f64,
}

impl Mesh<'_> {
    fn ring(&self, a: u32, b: u32) -> Option<Ring> {
        let mut cells = Vec::with_capacity(8);
        let mut links: Vec<(u32, u32)> = Vec::with_capacity(8);
        let mut worst = f64::INFINITY;
        for &at in &self.star[a as usize] {
            let c = self.cells[at as usize];
            if let Some(link) = opposite(c, a, b) {
                cells.push(at);
                links.push(link);
                worst = worst.min(self.quality[at as usize]);
            }
        }
        if cells.is_empty() || cells.len() > MAX_RING {
            return None;
        }
        let open_start = links.iter().map(|l| l.0).find(|&s| !links.iter().any(|l| l.1 == s));
        let mut polygon = vec![open_start.unwrap_or(links[0].0)];
        let mut at = polygon[0];
        for _ in 0..links.len() {
            at = links.iter().find(|l| l.0 == at)?.1;
            polygon.push(at);
        }
        let closed = open_start.is_none();
        if closed && polygon.pop() != Some(polygon[0]) {
            return None;
        }
        Some(Ring { cells, polygon, closed, worst })
    }

    /// May this edge of the surface be turned? Only within one face, never a fixed line of a plane face.
    fn may_turn(&self, a: u32, b: u32, ring: &Ring) -> bool {
        let (first, last) = (ring.polygon[0], ring.polygon[ring.polygon.len() - 1]);
        let common = self.shared_faces(&[a, b, first, last]);
        let line = self.rules.fixed[a as usize] && self.rules.fixed[b as usize];
        common != 0 && !line && ring.polygon.len() > 2 && !self.joined(first, last)
    }

    fn joined(&self, a: u32, b: u32) -> bool {
        self.star[a as usize].iter().any(|&c| self.cells[c as usize].contains(&b))
    }

    /// Best cells without the edge a-b and their lowest quality, if better than `least`.
    fn without_edge(&self, a: u32, b: u32) -> Option<Change> {
        let ring = self.ring(a, b)?;
        if if ring.closed { ring.polygon.len() < 3 } else { !self.may_turn(a, b, &ring) } {
            return None;
        }
        let (worst, triangles) = self.best_triangulation(a, b, &ring.polygon, ring.worst + GAIN)?;
        let mut new = Vec::with_capacity(2 * triangles.len());
        for [x, y, z] in triangles {
            new.push([x, y, z, b]);
            new.push([x, z, y, a]);
        }
        Some((worst - ring.worst, ring.cells, new))
    }

    /// Dynamic programme over the polygon: maximises the lowest quality of the cells above and below its triangles.
    fn best_triangulation(&self, a: u32, b: u32, polygon: &[u32], least: f64) -> Option<(f64, Vec<[u32; 3]>)> {
        let n = polygon.len();
        let mut best = [[(f64::INFINITY, 0usize); MAX_RING + 1]; MAX_RING + 1];
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                best[i][j].0 = f64::NEG_INFINITY;
                for k in i + 1..j {
                    let limit = best[i][k].0.min(best[k][j].0);
                    if limit <= best[i][j].0 || limit <= least {
                        continue;
                    }
                    let [x, y, z] = [polygon[i], polygon[k], polygon[j]];
                    let q = limit.min(self.measure([x, y, z, b]));
                    if q <= best[i][j].0 || q <= least {
                        continue;
                    }
                    let q = q.min(self.measure([x, z, y, a]));
                    if q > best[i][j].0 {
                        best[i][j] = (q, k);
                    }
                }
            }
        }
        if n < 3 || best[0][n - 1].0 <= least {
            return None;
        }
        let mut triangles = Vec::with_capacity(n - 2);
        let mut stack = vec![(0, n - 1)];
        while let Some((i, j)) = stack.pop() {
            if j > i + 1 {
                let k = best[i][j].1;
                triangles.push([polygon[i], polygon[k], polygon[j]]);
                stack.push((i, k));
                stack.push((k, j));
            }
        }
        Some((best[0][n - 1].0, triangles))
    }

    /// Replaces two cells that share the face opposite `slot` by three round the edge between their apexes.
    fn without_face(&self, at: u32, slot: usize) -> Option<Change> {
        let c = self.cells[at as usize];
        let a = c[slot];
        let [x, y, z] = OPPOSITE[slot].map(|k| c[k]);
        let (other, b) = self.star[x as usize].iter().find_map(|&o| {
            let d = self.cells[o as usize];
            if o == at || !d.contains(&y) || !d.contains(&z) {
                return None;
            }
            d.iter().find(|v| **v != x && **v != y && **v != z).map(|&b| (o, b))
        })?;
        let old = self.quality[at as usize].min(self.quality[other as usize]);
        let new = [[a, b, x, y], [a, b, y, z], [a, b, z, x]];
        let worst = new.iter().map(|&c| self.measure(c)).fold(f64::INFINITY, f64::min);
        (worst > old + GAIN).then(|| (worst - old, vec![at, other], new.to_vec()))
    }

    fn apply(&mut self, old: &[u32], new: &[[u32; 4]]) {
        for &c in old {
            self.remove(c);
        }
        for &c in new {
            self.add(c);
        }
    }

    /// The best change of connections round one cell; true if one was made.
    pub(super) fn reconnect(&mut self, at: u32) -> bool {
        let c = self.cells[at as usize];
        let mut best: Option<Change> = None;
        let mut offer = |found: Option<Change>| {
            if let Some(f) = found
                && best.as_ref().is_none_or(|b| f.0 > b.0)
            {
                best = Some(f);
            }
        };
        for i in 0..4 {
            for j in i + 1..4 {
                offer(self.without_edge(c[i], c[j]));
            }
            offer(self.without_face(at, i));
        }
        match best {
            Some((_, old, new)) => {
                self.apply(&old, &new);
                true
            }
            None => false,
        }
    }
}

/// For each slot the other three, so that (slot, others) is positive if the cell is.
const OPPOSITE: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The other two nodes (c, d) of a cell with the edge a-b, so that (a, b, c, d) is positive.
fn opposite(cell: [u32; 4], a: u32, b: u32) -> Option<(u32, u32)> {
    let i = cell.iter().position(|&v| v == a)?;
    let others = OPPOSITE[i].map(|k| cell[k]);
    let j = others.iter().position(|&v| v == b)?;
    Some((others[(j + 1) % 3], others[(j + 2) % 3]))
}
