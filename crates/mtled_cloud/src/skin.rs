//! Nodes on the surface of a body that a mesh outlines, and on the interfaces within: on creases first, then over each face by an
//! advancing front.

use crate::domain::Domain;
use crate::faces::INTERFACE;
use crate::grid::Grid;
use crate::nodes::{Nodes, equidistribute};
use crate::outline::Outline;
use crate::packing::Packing;
use crate::spacing::Spacing;
use crate::vector::{Point, add, distance, dot, hash01, scale, sub, tangents};
use std::f64::consts::PI;

/// Nearest accepted distance over the spacing, between nodes of different creases and on faces.
const APART: f64 = 0.6;
const GAP: f64 = 0.86;
const TRIES: usize = 10;
/// Largest way of a node off a curved interface, over the spacing.
const MOST_OFF: f64 = 0.2;
/// Distance of interfaces' nodes from the surface, over the spacing.
const CLEARANCE: f64 = 0.55;

/// Nodes along the creases, evenly spaced between where they end or branch.
pub(crate) fn place_creases(outline: &Outline, spacing: &Spacing, nodes: &mut Nodes) {
    let domain = &Domain::Outline(outline);
    let packing = Packing::new(domain, spacing);
    let (low, high) = outline.bounds;
    let mut grid = Grid::new(low, high, 4096);
    grid.refill(&nodes.points);
    let mut push = |p: Point, faces: u8| {
        let near = APART * spacing.at(domain, p);
        if !packing.reserved(p) && !grid.any(&nodes.points, p, near, |_, _| true) {
            nodes.push(p, faces, true);
            grid.push(p);
        }
    };
    let chains = chains(outline);
    for (chain, faces) in &chains {
        [chain[0], chain[chain.len() - 1]].into_iter().for_each(|p| push(p, *faces));
    }
    for (chain, faces) in &chains {
        let curve = along(chain);
        equidistribute(domain, spacing, &curve, false, 1).into_iter().for_each(|t| push(curve(t), *faces));
    }
}

/// A polyline by its length from 0 to 1.
fn along(chain: &[Point]) -> impl Fn(f64) -> Point {
    let mut ways = vec![0.0];
    chain.windows(2).for_each(|w| ways.push(ways[ways.len() - 1] + distance(w[0], w[1])));
    move |t| {
        let way = t * ways[ways.len() - 1];
        let k = ways.partition_point(|w| *w <= way).clamp(1, ways.len() - 1);
        let share = (way - ways[k - 1]) / (ways[k] - ways[k - 1]);
        add(chain[k - 1], scale(sub(chain[k], chain[k - 1]), share.clamp(0.0, 1.0)))
    }
}

/// Creases joined at their ends to polylines of the same faces.
fn chains(outline: &Outline) -> Vec<(Vec<Point>, u8)> {
    use std::collections::BTreeMap;
    let key = |p: Point| p.map(f64::to_bits);
    let mut at: BTreeMap<[u64; 3], Vec<usize>> = BTreeMap::new();
    for (i, c) in outline.creases.iter().enumerate() {
        c.ends.iter().for_each(|&p| at.entry(key(p)).or_default().push(i));
    }
    let mut used = vec![false; outline.creases.len()];
    let mut all = Vec::new();
    let mut walk = |start: Point, first: usize| {
        let faces = outline.creases[first].faces;
        let (mut chain, mut next) = (vec![start], Some(first));
        while let Some(i) = next.filter(|&i| !used[i]) {
            used[i] = true;
            let [a, b] = outline.creases[i].ends;
            let end = if chain.last() == Some(&a) { b } else { a };
            chain.push(end);
            let on = &at[&key(end)];
            next = if on.len() == 2 {
                on.iter().copied().find(|&j| j != i && outline.creases[j].faces == faces)
            } else {
                None
            };
        }
        if chain.len() > 1 {
            all.push((chain, faces));
        }
    };
    // open chains first, then rings
    for open in [true, false] {
        for (i, c) in outline.creases.iter().enumerate() {
            for p in c.ends {
                if !open || at[&key(p)].len() != 2 {
                    walk(p, i);
                }
            }
        }
    }
    all
}

impl Packing<'_> {
    pub(crate) fn fill_skin(&self, outline: &Outline, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>) {
        for face in outline.faces() {
            let first = nodes.points.len();
            let mut front: Vec<u32> =
                (0..nodes.points.len() as u32).filter(|&i| nodes.faces[i as usize] & face != 0).collect();
            self.advance(outline, face, &mut front, nodes, grid, spacings);
            // what no front has reached
            let corners: Vec<Point> = outline.corners(face).collect();
            for p in corners {
                if self.accepts_on_skin(outline, face, p, nodes, grid, spacings) {
                    let mut front = vec![nodes.points.len() as u32];
                    self.push_on_skin(face, p, nodes, grid, spacings);
                    self.advance(outline, face, &mut front, nodes, grid, spacings);
                }
            }
            if face == INTERFACE {
                self.keep_volume(outline, nodes, first);
                grid.refill(&nodes.points);
            }
        }
    }

    /// Moves nodes off a curved interface so that the facets between them enclose what it encloses: on a sphere of radius R triangles of
    /// edge e lie e^2/(8 R) within on average, a quarter of how far the sphere is below its tangent plane at the distance e.
    fn keep_volume(&self, outline: &Outline, nodes: &mut Nodes, first: usize) {
        for i in first..nodes.points.len() {
            let p = nodes.points[i];
            let Some((_, normal)) = outline.on(INTERFACE, p) else { continue };
            let edge = self.spacing.at(self.domain, p);
            let [t1, t2] = tangents(normal);
            let below = |k: usize| {
                let (sin, cos) = (2.0 * PI * k as f64 / TRIES as f64).sin_cos();
                let beside = add(p, scale(add(scale(t1, cos), scale(t2, sin)), edge));
                outline.on(INTERFACE, beside).map_or(0.0, |(q, _)| dot(sub(p, q), normal))
            };
            let mean = (0..TRIES).map(below).sum::<f64>() / TRIES as f64;
            let off = (0.25 * mean).clamp(-MOST_OFF * edge, MOST_OFF * edge);
            nodes.points[i] = add(p, scale(normal, off));
        }
    }

    fn advance(
        &self,
        outline: &Outline,
        face: u8,
        front: &mut Vec<u32>,
        nodes: &mut Nodes,
        grid: &mut Grid,
        spacings: &mut Vec<f64>,
    ) {
        let mut next = 0;
        while next < front.len() {
            let seed = front[next];
            next += 1;
            let p = nodes.points[seed as usize];
            let Some((_, normal)) = outline.on(face, p) else { continue };
            let h = self.h(p);
            let [t1, t2] = tangents(normal);
            let turn = hash01(u64::from(seed), 1);
            for k in 0..TRIES {
                let (sin, cos) = (2.0 * PI * (k as f64 + turn) / TRIES as f64).sin_cos();
                let way = add(scale(t1, cos), scale(t2, sin));
                let Some((candidate, _)) = outline.on(face, add(p, scale(way, self.stride(p, h, way)))) else {
                    continue;
                };
                if self.accepts_on_skin(outline, face, candidate, nodes, grid, spacings) {
                    front.push(nodes.points.len() as u32);
                    self.push_on_skin(face, candidate, nodes, grid, spacings);
                }
            }
        }
    }

    fn accepts_on_skin(
        &self,
        outline: &Outline,
        face: u8,
        p: Point,
        nodes: &Nodes,
        grid: &Grid,
        spacings: &[f64],
    ) -> bool {
        let h = self.h(p);
        !self.reserved(p)
            && !grid.crowded(&nodes.points, spacings, p, h, [GAP, self.spacing.growth])
            && (face != INTERFACE || outline.depth(p) > CLEARANCE * h)
    }

    fn push_on_skin(&self, face: u8, p: Point, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>) {
        nodes.push(p, face, face == INTERFACE);
        grid.push(p);
        spacings.push(self.h(p));
    }
}
