//! Bricks inside a body that tetrahedra fill: nodes on a lattice where there is room for it, and the hexahedra that come of it.
//!
//! The lattice is as wide as the spacing far from every feature. It ends before the surface, interfaces and whatever is finer, and other nodes
//! stay out of the bricks' circumspheres, so that the triangulation cuts a brick into tetrahedra of its own corners. Where it has not, the
//! tetrahedra stay what they are: a gap is never left. (Finer lattices, in halves, nearer to a feature did not fill more of a body: a brick
//! beside a finer one has nodes in its faces.)

use std::collections::{BTreeMap, BTreeSet};

use super::edges::Nodes;
use super::hexahedron::{CORNERS, Hexahedron};
use super::packing::{BODY_GAP, PACKED, Packing};
use super::quality::six_volumes;
use super::vector::{Point, norm, sub};
use crate::grid::Grid;

/// Least wanted distance of nodes over the lattice's pitch.
const FINE: f64 = 0.8;
/// Distance of a brick from surface, interfaces and nodes of features over the pitch, at least: tetrahedra of about its size lie between.
const ROOM: f64 = 0.75;
/// Radius that is kept free of other nodes over that of the circumsphere.
const CLEAR: f64 = 1.02;
/// Largest relative difference between the volumes of a brick and of its tetrahedra.
const ROUND_OFF: f64 = 1e-9;

/// The bricks of a cloud; none by default.
#[derive(Default)]
pub(crate) struct Bricks {
    corners: Vec<[Point; 8]>,
    middles: Vec<Point>,
    /// Of the middles.
    grid: Option<Grid>,
    /// Radius about the middles that other nodes stay out of.
    reach: f64,
}

impl Packing<'_> {
    /// Adds the nodes of bricks, which stay where they are, between those that are there already.
    pub(crate) fn plant(&mut self, nodes: &mut Nodes, grid: &mut Grid, spacings: &mut Vec<f64>) {
        let (low, high) = self.domain.bounds();
        let extent = sub(high, low);
        let count = extent.map(|x| (x / (PACKED * self.spacing.far)).round().max(1.0) as u32);
        let edges = [0, 1, 2].map(|k| extent[k] / f64::from(count[k]));
        let pitch = edges.into_iter().fold(0.0, f64::max);
        // neighbours have the same digits for the corners that they share
        let place = |at: [u32; 3]| [0, 1, 2].map(|k| low[k] + extent[k] * (f64::from(at[k]) / f64::from(count[k])));
        let all = (0..count[2]).flat_map(|k| (0..count[1]).flat_map(move |j| (0..count[0]).map(move |i| [i, j, k])));
        let mut bricks = Bricks { reach: 0.5 * CLEAR * norm(edges), ..Bricks::default() };
        let mut middles = Grid::of_cells(low, high, pitch);
        for at in all {
            let corners = CORNERS.map(|c| place([0, 1, 2].map(|k| at[k] + u32::from(c[k] > 0))));
            let middle = [0, 1, 2].map(|k| 0.5 * (corners[0][k] + corners[6][k]));
            if self.has_room(nodes, spacings, grid, &corners, middle, pitch) {
                bricks.corners.push(corners);
                bricks.middles.push(middle);
                middles.push(middle);
            }
        }
        let mut planted = BTreeSet::new();
        for &p in bricks.corners.iter().flatten() {
            if planted.insert(digits(p)) {
                nodes.push(p, 0, true);
                grid.push(p);
                spacings.push(self.h(p));
            }
        }
        self.bricks = Bricks { grid: Some(middles), ..bricks };
    }

    /// Whether a brick is clear of surface, interfaces, paths and the nodes that are there, and wide enough for the spacing.
    fn has_room(
        &self,
        nodes: &Nodes,
        spacings: &[f64],
        grid: &Grid,
        corners: &[Point; 8],
        middle: Point,
        pitch: f64,
    ) -> bool {
        let room = |p: Point, least: f64| {
            self.domain.depth_to(p, least).min(self.spacing.interface_distance(self.domain.height(), p)) >= least
        };
        let (at_corner, at_middle) = (ROOM * pitch, (0.5 + ROOM) * pitch);
        room(middle, at_middle)
            && self.h(middle) >= FINE * pitch
            && !grid.any(&nodes.points, middle, at_middle, |_, _| true)
            && corners.iter().all(|&p| {
                room(p, at_corner)
                    && !self.reserved(p)
                    && !grid.crowded(&nodes.points, spacings, p, self.h(p), [BODY_GAP, self.spacing.growth])
            })
    }
}

impl Bricks {
    /// Whether a place lies in the circumsphere of a brick.
    pub(crate) fn hold(&self, p: Point) -> bool {
        self.grid.as_ref().is_some_and(|grid| grid.any(&self.middles, p, self.reach, |_, _| true))
    }

    /// The hexahedra among a cloud's cells: the bricks that tetrahedra of their own corners fill.
    pub(crate) fn hexahedra(&self, points: &[Point], cells: &[[u32; 4]]) -> Vec<Hexahedron> {
        if self.corners.is_empty() {
            return Vec::new();
        }
        let node: BTreeMap<[u64; 3], u32> = points.iter().map(|p| digits(*p)).zip(0..).collect();
        let mut star: Vec<Vec<u32>> = vec![Vec::new(); points.len()];
        for (c, at) in cells.iter().zip(0..) {
            c.iter().for_each(|&n| star[n as usize].push(at));
        }
        let hexahedron = |places: &[Point; 8]| {
            let found: Option<Vec<u32>> = places.iter().map(|p| node.get(&digits(*p)).copied()).collect();
            let corners: [u32; 8] = found?.try_into().ok()?;
            let mut own: Vec<u32> = corners.iter().flat_map(|&n| &star[n as usize]).copied().collect();
            own.sort_unstable();
            own.dedup();
            own.retain(|&c| cells[c as usize].iter().all(|n| corners.contains(n)));
            let filled: f64 = own.iter().map(|&c| six_volumes(&cells[c as usize].map(|n| points[n as usize]))).sum();
            let [x, y, z] = sub(places[6], places[0]);
            ((filled / (6.0 * x * y * z) - 1.0).abs() < ROUND_OFF).then_some(Hexahedron { corners, cells: own })
        };
        self.corners.iter().filter_map(hexahedron).collect()
    }
}

/// What tells a place from all others.
fn digits(p: Point) -> [u64; 3] {
    p.map(f64::to_bits)
}
