//! Better cells from the same nodes: thin cells on the side are peeled, bad edges and faces are replaced (edge removal
//! with the best triangulation of the ring round the edge; Klincsek 1980, Shewchuk 2002), movable nodes are shifted.
//! Every step raises the lowest quality of the cells that it touches, so no cell is ever inverted.

use super::quality::volume_length;
use super::vector::{Point, add, hash01, norm, scale, sub};

/// Cells below this quality are worked on.
const WANTED: f64 = 0.45;
/// Largest ring of cells round an edge that is considered.
const MAX_RING: usize = 9;
/// Least gain worth a change.
const GAIN: f64 = 1e-6;

/// The nodes of a triangulation and what may be done to them.
pub(crate) struct Rules<'a> {
    /// Bits of the faces that each node lies on.
    pub(crate) faces: &'a [u8],
    /// Nodes that may not move.
    pub(crate) fixed: &'a [bool],
    /// Bits of the curved faces.
    pub(crate) curved: u8,
    /// Puts a node back on its face; None where it may not be.
    pub(crate) place: &'a dyn Fn(u8, Point) -> Option<Point>,
}

pub(crate) struct Mesh<'a> {
    pub(crate) points: Vec<Point>,
    rules: Rules<'a>,
    cells: Vec<[u32; 4]>,
    quality: Vec<f64>,
    alive: Vec<bool>,
    free: Vec<u32>,
    star: Vec<Vec<u32>>,
}

/// Cells round an edge a-b: the polygon of their other nodes, counter-clockwise seen from b.
struct Ring {
    cells: Vec<u32>,
    polygon: Vec<u32>,
    closed: bool,
    worst: f64,
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

    fn measure(&self, c: [u32; 4]) -> f64 {
        volume_length(&self.corners(c))
    }

    fn add(&mut self, c: [u32; 4]) {
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

    fn remove(&mut self, at: u32) {
        for v in self.cells[at as usize] {
            let star = &mut self.star[v as usize];
            if let Some(k) = star.iter().position(|&c| c == at) {
                star.swap_remove(k);
            }
        }
        self.alive[at as usize] = false;
        self.free.push(at);
    }

    fn shared_faces(&self, nodes: &[u32]) -> u8 {
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
    fn without_edge(&self, a: u32, b: u32) -> Option<(f64, Vec<u32>, Vec<[u32; 4]>)> {
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
    fn without_face(&self, at: u32, slot: usize) -> Option<(f64, Vec<u32>, Vec<[u32; 4]>)> {
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
    fn reconnect(&mut self, at: u32) -> bool {
        let c = self.cells[at as usize];
        let mut best: Option<(f64, Vec<u32>, Vec<[u32; 4]>)> = None;
        let mut offer = |found: Option<(f64, Vec<u32>, Vec<[u32; 4]>)>| {
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

    fn star_quality(&self, v: u32, stop: f64) -> f64 {
        let mut worst = f64::INFINITY;
        for &c in &self.star[v as usize] {
            worst = worst.min(self.measure(self.cells[c as usize]));
            if worst <= stop {
                break;
            }
        }
        worst
    }

    /// Climbs with one node: towards a better worst cell of its star; true if it moved.
    fn shift(&mut self, v: u32) -> bool {
        if self.rules.fixed[v as usize] || self.rules.faces[v as usize].count_ones() > 1 {
            return false;
        }
        let face = self.rules.faces[v as usize];
        let mut worst = self.star[v as usize].iter().map(|&c| self.quality[c as usize]).fold(f64::INFINITY, f64::min);
        let size = self.star_size(v);
        let mut reach = 0.2 * size;
        let mut moved = false;
        for round in 0..12u64 {
            let home = self.points[v as usize];
            let mut best = (worst + GAIN, home);
            for k in 0..8u64 {
                let way = if k == 0 {
                    self.uphill(v)
                } else {
                    let h = |salt| hash01(u64::from(v) * 64 + round * 8 + k, salt) - 0.5;
                    [h(5), h(6), h(7)]
                };
                let step = reach / norm(way).max(f64::MIN_POSITIVE);
                let Some(q) = (self.rules.place)(face, add(home, scale(way, step))) else { continue };
                self.points[v as usize] = q;
                let reached = self.star_quality(v, best.0);
                if reached > best.0 {
                    best = (reached, q);
                }
            }
            self.points[v as usize] = best.1;
            if best.1 == home {
                reach *= 0.5;
            } else {
                worst = best.0;
                moved = true;
            }
        }
        if moved {
            for k in 0..self.star[v as usize].len() {
                let c = self.star[v as usize][k];
                self.quality[c as usize] = self.measure(self.cells[c as usize]);
            }
        }
        moved
    }

    /// Gradient of the worst cell's quality at this node, by differences.
    fn uphill(&mut self, v: u32) -> Point {
        let star = &self.star[v as usize];
        let Some(worst) =
            star.iter().map(|&c| self.cells[c as usize]).min_by(|a, b| self.measure(*a).total_cmp(&self.measure(*b)))
        else {
            return [0.0; 3];
        };
        let home = self.points[v as usize];
        let d = 1e-5 * self.star_size(v);
        let mut gradient = [0.0; 3];
        for k in 0..3 {
            for (sign, value) in [(1.0, d), (-1.0, -d)] {
                self.points[v as usize][k] = home[k] + value;
                gradient[k] += sign * self.measure(worst);
            }
            self.points[v as usize] = home;
        }
        gradient
    }

    fn star_size(&self, v: u32) -> f64 {
        let p = self.points[v as usize];
        let (mut sum, mut n) = (0.0, 0.0);
        for &c in &self.star[v as usize] {
            for w in self.cells[c as usize] {
                sum += norm(sub(self.points[w as usize], p));
            }
            n += 3.0;
        }
        sum / f64::max(n, 1.0)
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

/// For each slot the other three, so that (slot, others) is positive if the cell is.
const OPPOSITE: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The other two nodes (c, d) of a cell with the edge a-b, so that (a, b, c, d) is positive.
fn opposite(cell: [u32; 4], a: u32, b: u32) -> Option<(u32, u32)> {
    let i = cell.iter().position(|&v| v == a)?;
    let others = OPPOSITE[i].map(|k| cell[k]);
    let j = others.iter().position(|&v| v == b)?;
    Some((others[(j + 1) % 3], others[(j + 2) % 3]))
}
