//! Delaunay tetrahedra by Bowyer and Watson's insertion, with exact predicates.
//!
//! The convex hull is closed by ghost cells that share one vertex at infinity, so that points exactly on a plane face
//! need no perturbation: a point coplanar with a hull triangle is in conflict with its ghost exactly if it is inside
//! the triangle's circumcircle, hence no flat cell is ever made. (Shewchuk's predicates, crate `robust`.)

use crate::error::CloudError;
use crate::vector::Point;
use robust::Coord3D;

/// The vertex at infinity.
const GHOST: u32 = u32::MAX;

#[inline]
fn coord(p: Point) -> Coord3D<f64> {
    Coord3D { x: p[0], y: p[1], z: p[2] }
}

/// Positive if d lies below the plane a, b, c (seen counter-clockwise from above).
#[inline]
pub(crate) fn orient(a: Point, b: Point, c: Point, d: Point) -> f64 {
    robust::orient3d(coord(a), coord(b), coord(c), coord(d))
}

struct Builder<'a> {
    points: &'a [Point],
    vertices: Vec<[u32; 4]>,
    neighbours: Vec<[u32; 4]>,
    /// 2s: in the cavity of insertion s; 2s + 1: tested and outside it.
    mark: Vec<u32>,
    stamp: u32,
    free: Vec<u32>,
    last: u32,
    cavity: Vec<u32>,
    shell: Vec<(u32, u8)>,
    fresh: Vec<u32>,
    edges: EdgeTable,
}

/// Open-addressed table from an edge to the one new cell face seen there so far.
struct EdgeTable {
    slots: Vec<(u64, u32, u32)>,
    stamp: u32,
}

impl EdgeTable {
    fn begin(&mut self, edges: usize) {
        self.stamp += 1;
        if self.slots.len() < 4 * edges {
            self.slots = vec![(0, 0, 0); (4 * edges).next_power_of_two()];
            self.stamp = 1;
        }
    }

    /// Returns the face stored under the edge and forgets nothing; stores `face` if there was none.
    fn pair(&mut self, a: u32, b: u32, face: u32) -> Option<u32> {
        let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
        let mask = self.slots.len() - 1;
        let mut at = (key.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as usize & mask;
        loop {
            let slot = &mut self.slots[at];
            if slot.1 != self.stamp {
                *slot = (key, self.stamp, face);
                return None;
            }
            if slot.0 == key {
                return Some(slot.2);
            }
            at = (at + 1) & mask;
        }
    }
}

impl Builder<'_> {
    fn point(&self, v: u32) -> Point {
        self.points[v as usize]
    }

    fn orient_with(&self, cell: u32, slot: usize, p: Point) -> f64 {
        let v = self.vertices[cell as usize];
        let q = |i: usize| if i == slot { p } else { self.point(v[i]) };
        orient(q(0), q(1), q(2), q(3))
    }

    fn ghost_slot(&self, cell: u32) -> Option<usize> {
        self.vertices[cell as usize].iter().position(|&v| v == GHOST)
    }

    /// Is p strictly inside the circumsphere (for a ghost: beyond its hull triangle)?
    fn conflict(&self, cell: u32, p: Point) -> bool {
        match self.ghost_slot(cell) {
            Some(slot) => {
                let side = self.orient_with(cell, slot, p);
                side > 0.0 || (side == 0.0 && self.conflict(self.neighbours[cell as usize][slot], p))
            }
            None => {
                let v = self.vertices[cell as usize].map(|v| coord(self.point(v)));
                robust::insphere(v[0], v[1], v[2], v[3], coord(p)) > 0.0
            }
        }
    }

    /// Walks from the last cell towards p; returns a cell in conflict with p.
    fn locate(&self, p: Point) -> u32 {
        let mut cell = self.last;
        if let Some(slot) = self.ghost_slot(cell) {
            cell = self.neighbours[cell as usize][slot];
        }
        let mut from = GHOST;
        loop {
            let mut next = GHOST;
            for slot in 0..4 {
                let n = self.neighbours[cell as usize][slot];
                if n != from && self.orient_with(cell, slot, p) < 0.0 {
                    next = n;
                    break;
                }
            }
            if next == GHOST {
                return cell;
            }
            if self.ghost_slot(next).is_some() {
                return next;
            }
            from = cell;
            cell = next;
        }
    }

    fn new_cell(&mut self, vertices: [u32; 4]) -> u32 {
        if let Some(cell) = self.free.pop() {
            self.vertices[cell as usize] = vertices;
            self.mark[cell as usize] = 0;
            return cell;
        }
        self.vertices.push(vertices);
        self.neighbours.push([GHOST; 4]);
        self.mark.push(0);
        (self.vertices.len() - 1) as u32
    }

    /// Cells in conflict with p, and the faces round them as (cell inside, slot).
    fn carve(&mut self, p: Point, start: u32) {
        self.stamp += 1;
        let (inside, outside) = (2 * self.stamp, 2 * self.stamp + 1);
        self.cavity.clear();
        self.shell.clear();
        self.cavity.push(start);
        self.mark[start as usize] = inside;
        let mut next = 0;
        while next < self.cavity.len() {
            let cell = self.cavity[next];
            next += 1;
            for slot in 0..4 {
                let n = self.neighbours[cell as usize][slot];
                if self.mark[n as usize] < inside {
                    let hit = self.conflict(n, p);
                    self.mark[n as usize] = if hit { inside } else { outside };
                    if hit {
                        self.cavity.push(n);
                    }
                }
                if self.mark[n as usize] == outside {
                    self.shell.push((cell, slot as u8));
                }
            }
        }
    }

    fn insert(&mut self, v: u32) -> Result<(), CloudError> {
        let p = self.point(v);
        let start = self.locate(p);
        if !self.conflict(start, p) {
            return Err(CloudError::NotMeshable { reason: format!("two nodes coincide at {p:?} m") });
        }
        self.carve(p, start);
        self.fresh.clear();
        for k in 0..self.shell.len() {
            let (cell, slot) = (self.shell[k].0, self.shell[k].1 as usize);
            let outer = self.neighbours[cell as usize][slot];
            let mut vertices = self.vertices[cell as usize];
            vertices[slot] = v;
            let new = self.new_cell(vertices);
            self.neighbours[new as usize] = [GHOST; 4];
            self.neighbours[new as usize][slot] = outer;
            if let Some(back) = self.neighbours[outer as usize].iter().position(|&n| n == cell) {
                self.neighbours[outer as usize][back] = new;
            }
            self.fresh.push(new);
        }
        self.join(v);
        self.free.append(&mut self.cavity);
        self.last = self.fresh[0];
        Ok(())
    }

    /// Links the new cells to each other: each edge of the cavity's shell belongs to two of them.
    fn join(&mut self, v: u32) {
        self.edges.begin(3 * self.fresh.len());
        for k in 0..self.fresh.len() {
            let cell = self.fresh[k];
            let vertices = self.vertices[cell as usize];
            for slot in 0..4 {
                if vertices[slot] == v {
                    continue;
                }
                let mut ends = [0u32; 2];
                let mut n = 0;
                for other in 0..4 {
                    if other != slot && vertices[other] != v {
                        ends[n] = vertices[other];
                        n += 1;
                    }
                }
                let face = cell * 4 + slot as u32;
                if let Some(other) = self.edges.pair(ends[0], ends[1], face) {
                    self.neighbours[cell as usize][slot] = other / 4;
                    self.neighbours[(other / 4) as usize][(other % 4) as usize] = cell;
                }
            }
        }
    }
}

/// Four points that span a volume, far apart.
fn first_cell(points: &[Point]) -> Result<[u32; 4], CloudError> {
    let flat = || CloudError::NotMeshable { reason: "all points lie in one plane".into() };
    // the first of several
    let farther = |measure: &dyn Fn(Point) -> f64, a: usize, b: usize| {
        if measure(points[b]) > measure(points[a]) { b } else { a }
    };
    let farthest = |measure: &dyn Fn(Point) -> f64| (1..points.len()).fold(0, |best, i| farther(measure, best, i));
    use crate::vector::{cross, dot, norm, sub};
    let a = points[0];
    let b = points[farthest(&|p| norm(sub(p, a)))];
    let c = points[farthest(&|p| norm(cross(sub(p, a), sub(b, a))))];
    let normal = cross(sub(b, a), sub(c, a));
    let d = points[farthest(&|p| dot(normal, sub(p, a)).abs())];
    let find = |q: Point| points.iter().position(|&p| p == q).unwrap_or(0) as u32;
    let mut cell = [0, find(b), find(c), find(d)];
    let side = orient(a, b, c, d);
    if side == 0.0 {
        return Err(flat());
    }
    if side < 0.0 {
        cell.swap(0, 1);
    }
    Ok(cell)
}

/// Delaunay cells of `points` (any unit), each with positive volume (v1-v0)·((v2-v0)×(v3-v0)).
/// Insertion follows the given order, which should follow a space-filling curve.
///
/// # Errors
/// Two equal points, or all points in one plane.
pub(crate) fn triangulate(points: &[Point]) -> Result<Vec<[u32; 4]>, CloudError> {
    if points.len() < 4 {
        return Err(CloudError::NotMeshable { reason: format!("{} points are fewer than four", points.len()) });
    }
    let first = first_cell(points)?;
    let cells = 8 * points.len();
    let mut b = Builder {
        points,
        vertices: Vec::with_capacity(cells),
        neighbours: Vec::with_capacity(cells),
        mark: Vec::with_capacity(cells),
        stamp: 0,
        free: Vec::new(),
        last: 0,
        cavity: Vec::new(),
        shell: Vec::new(),
        fresh: Vec::new(),
        edges: EdgeTable { slots: vec![(0, 0, 0); 1024], stamp: 0 },
    };
    b.new_cell(first);
    for slot in 0..4 {
        let mut ghost = first;
        ghost[slot] = GHOST;
        // Seen from the ghost the triangle is turned round.
        let others: [usize; 2] = if slot < 2 { [2, 3] } else { [0, 1] };
        ghost.swap(others[0], others[1]);
        b.new_cell(ghost);
    }
    link_all(&mut b);
    for v in rounds(points.len()) {
        if !first.contains(&v) {
            b.insert(v)?;
        }
    }
    let mut dead = vec![false; b.vertices.len()];
    for &f in &b.free {
        dead[f as usize] = true;
    }
    let alive = b.vertices.iter().zip(&dead).filter(|(v, dead)| !**dead && !v.contains(&GHOST));
    // orient(v0..v3) > 0 is the left-handed order; one swap makes the volume positive.
    Ok(alive.map(|(v, _)| [v[1], v[0], v[2], v[3]]).collect())
}

/// Order of insertion: rounds that double in size, each along the given order (Amenta, Choi, Rote 2003). Walks stay
/// short and cavities small.
fn rounds(n: usize) -> Vec<u32> {
    let last = (usize::BITS - n.leading_zeros()).saturating_sub(6);
    let round = |v: u32| {
        let halvings = (-crate::vector::hash01(u64::from(v), 8).max(1e-12).log2()) as u32;
        last - halvings.min(last)
    };
    let mut order: Vec<(u32, u32)> = (0..n as u32).map(|v| (round(v), v)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, v)| v).collect()
}

/// Links the first five cells by comparing faces.
fn link_all(b: &mut Builder) {
    let face = |v: [u32; 4], slot: usize| {
        let mut f: Vec<u32> = (0..4).filter(|&i| i != slot).map(|i| v[i]).collect();
        f.sort_unstable();
        f
    };
    let n = b.vertices.len();
    for c in 0..n {
        for slot in 0..4 {
            let wanted = face(b.vertices[c], slot);
            for other in (0..n).filter(|&o| o != c) {
                if (0..4).any(|s| face(b.vertices[other], s) == wanted) {
                    b.neighbours[c][slot] = other as u32;
                }
            }
        }
    }
}
