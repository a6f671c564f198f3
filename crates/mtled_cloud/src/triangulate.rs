//! Delaunay triangles of points in a rectangle of the r-z half plane, by Bowyer and Watson's insertion with exact
//! predicates (Shewchuk's, crate `robust`). The four corners are among the points, so the hull is the rectangle from the
//! start: a point on its edge splits that edge, and nothing needs to be closed by ghosts.

use crate::error::CloudError;
use crate::vector::Point;
use robust::Coord;

/// No triangle beyond this edge.
const NONE: u32 = u32::MAX;

#[inline]
fn coord(p: Point) -> Coord<f64> {
    Coord { x: p[0], y: p[2] }
}

/// Positive if a, b, c run counter-clockwise with r to the right and z up.
pub(crate) fn orient(a: Point, b: Point, c: Point) -> f64 {
    robust::orient2d(coord(a), coord(b), coord(c))
}

/// An edge of the cavity, with the cavity on its left, and the triangle beyond.
#[derive(Clone, Copy)]
struct Rim {
    from: u32,
    to: u32,
    beyond: u32,
}

struct Builder<'a> {
    points: &'a [Point],
    /// Corners, counter-clockwise; the k-th neighbour lies beyond the edge opposite the k-th corner.
    triangles: Vec<[u32; 3]>,
    neighbours: Vec<[u32; 3]>,
    /// Number of the insertion that found the triangle in its cavity.
    mark: Vec<u32>,
    free: Vec<u32>,
    last: u32,
    cavity: Vec<u32>,
    rim: Vec<Rim>,
    fresh: Vec<u32>,
}

/// Triangulates points in a rectangle whose corners are among them. Counter-clockwise, in the points' order.
///
/// # Errors
/// A corner is missing, or two points are at one place.
pub(crate) fn triangulate(points: &[Point]) -> Result<Vec<[u32; 3]>, CloudError> {
    let corners = corners(points)?;
    let [a, b, c, d] = corners;
    let mut builder = Builder {
        points,
        triangles: vec![[a, b, c], [a, c, d]],
        neighbours: vec![[NONE, 1, NONE], [NONE, NONE, 0]],
        mark: vec![NONE; 2],
        free: Vec::new(),
        last: 0,
        cavity: Vec::new(),
        rim: Vec::new(),
        fresh: Vec::new(),
    };
    for v in (0..points.len() as u32).filter(|v| !corners.contains(v)) {
        builder.insert(v)?;
    }
    let mut triangles: Vec<[u32; 3]> = builder.triangles;
    for t in &mut triangles {
        let least = (0..3).fold(0, |best, k| if t[k] < t[best] { k } else { best });
        t.rotate_left(least);
    }
    triangles.sort_unstable();
    Ok(triangles)
}

/// The rectangle's corners, counter-clockwise from the lowest on the axis.
fn corners(points: &[Point]) -> Result<[u32; 4], CloudError> {
    let extreme = |k: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[k]).fold(points[0][k], pick);
    let (r, z) = ([extreme(0, f64::min), extreme(0, f64::max)], [extreme(2, f64::min), extreme(2, f64::max)]);
    let at = |r: f64, z: f64| points.iter().position(|p| p[0] == r && p[2] == z);
    match [at(r[0], z[0]), at(r[1], z[0]), at(r[1], z[1]), at(r[0], z[1])] {
        [Some(a), Some(b), Some(c), Some(d)] => Ok([a, b, c, d].map(|v| v as u32)),
        _ => Err(CloudError::NotMeshable { reason: "a corner of the half plane has no node".to_owned() }),
    }
}

impl Builder<'_> {
    fn point(&self, v: u32) -> Point {
        self.points[v as usize]
    }

    fn insert(&mut self, v: u32) -> Result<(), CloudError> {
        let p = self.point(v);
        let start = self.locate(p)?;
        if self.triangles[start as usize].iter().any(|&c| self.point(c) == p) {
            return Err(CloudError::NotMeshable { reason: format!("two nodes at r = {} m, z = {} m", p[0], p[2]) });
        }
        self.carve(start, v);
        self.fill(v);
        Ok(())
    }

    /// Walks to the triangle that holds p.
    fn locate(&self, p: Point) -> Result<u32, CloudError> {
        let mut at = self.last;
        'walk: loop {
            let t = self.triangles[at as usize];
            for k in 0..3 {
                if orient(self.point(t[(k + 1) % 3]), self.point(t[(k + 2) % 3]), p) < 0.0 {
                    at = self.neighbours[at as usize][k];
                    if at == NONE {
                        let reason = format!("a node at r = {} m, z = {} m is outside the body", p[0], p[2]);
                        return Err(CloudError::NotMeshable { reason });
                    }
                    continue 'walk;
                }
            }
            return Ok(at);
        }
    }

    /// Finds the triangles whose circumcircles hold p, and the rim of that cavity.
    fn carve(&mut self, start: u32, v: u32) {
        let p = coord(self.point(v));
        self.cavity.clear();
        self.rim.clear();
        self.cavity.push(start);
        self.mark[start as usize] = v;
        let mut next = 0;
        while next < self.cavity.len() {
            let at = self.cavity[next];
            next += 1;
            let t = self.triangles[at as usize];
            for k in 0..3 {
                let beyond = self.neighbours[at as usize][k];
                if beyond != NONE && self.mark[beyond as usize] == v {
                    continue;
                }
                let inside = beyond != NONE && {
                    let [a, b, c] = self.triangles[beyond as usize].map(|c| coord(self.point(c)));
                    robust::incircle(a, b, c, p) > 0.0
                };
                if inside {
                    self.mark[beyond as usize] = v;
                    self.cavity.push(beyond);
                } else {
                    self.rim.push(Rim { from: t[(k + 1) % 3], to: t[(k + 2) % 3], beyond });
                }
            }
        }
    }

    /// Joins p to every edge of the rim but the one that it lies on.
    fn fill(&mut self, v: u32) {
        let p = self.point(v);
        let rim = std::mem::take(&mut self.rim);
        self.free.append(&mut self.cavity);
        self.fresh.clear();
        for edge in &rim {
            if orient(self.point(edge.from), self.point(edge.to), p) == 0.0 {
                continue;
            }
            let at = self.add([v, edge.from, edge.to], [edge.beyond, NONE, NONE]);
            self.fresh.push(at);
            if edge.beyond != NONE {
                let t = self.triangles[edge.beyond as usize];
                if let Some(k) = (0..3).find(|&k| t[k] != edge.from && t[k] != edge.to) {
                    self.neighbours[edge.beyond as usize][k] = at;
                }
            }
        }
        for i in 0..self.fresh.len() {
            let [_, from, to] = self.triangles[self.fresh[i] as usize];
            let with = |corner: usize, v: u32| {
                self.fresh.iter().copied().find(|&t| self.triangles[t as usize][corner] == v).unwrap_or(NONE)
            };
            let (after, before) = (with(1, to), with(2, from));
            let at = self.fresh[i] as usize;
            self.neighbours[at][1] = after;
            self.neighbours[at][2] = before;
        }
        self.last = self.fresh.last().copied().unwrap_or(self.last);
        self.rim = rim;
    }

    fn add(&mut self, t: [u32; 3], neighbours: [u32; 3]) -> u32 {
        match self.free.pop() {
            Some(at) => {
                self.triangles[at as usize] = t;
                self.neighbours[at as usize] = neighbours;
                self.mark[at as usize] = NONE;
                at
            }
            None => {
                self.triangles.push(t);
                self.neighbours.push(neighbours);
                self.mark.push(NONE);
                (self.triangles.len() - 1) as u32
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::hash01;

    #[test]
    fn triangles_fill_the_rectangle_and_are_delaunay() -> Result<(), CloudError> {
        let mut points: Vec<Point> = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]].map(|[x, z]| [x, 0.0, z]).into();
        // on the edges, on a lattice whose circles hold four points each, and anywhere
        points.extend((1..8).flat_map(|i| [[0.25 * f64::from(i), 0.0, 0.0], [0.0, 0.0, 0.125 * f64::from(i)]]));
        points.extend((1..8).flat_map(|i| (1..4).map(move |k| [0.25 * f64::from(i), 0.0, 0.25 * f64::from(k)])));
        points.extend((0..200).map(|i| [2.0 * hash01(i, 7), 0.0, hash01(i, 8)]));
        let triangles = triangulate(&points)?;
        let corner = |v: u32| points[v as usize];
        let area: f64 = triangles.iter().map(|t| 0.5 * orient(corner(t[0]), corner(t[1]), corner(t[2]))).sum();
        assert!((area - 2.0).abs() < 1e-12, "{area}");
        for t in &triangles {
            let [a, b, c] = t.map(|v| coord(corner(v)));
            assert!(robust::orient2d(a, b, c) > 0.0);
            assert!(points.iter().all(|&p| robust::incircle(a, b, c, coord(p)) <= 0.0), "{t:?}");
        }
        Ok(())
    }
}
