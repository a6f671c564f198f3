//! Bricks inside a body that tetrahedra fill: nodes on a lattice where there is room for it, and the hexahedra that come of it.
//!
//! The lattice is as wide as the spacing far from every feature. It ends before the surface, interfaces and whatever is finer, and other nodes
//! stay out of the bricks' circumspheres, so that the triangulation cuts a brick into tetrahedra of its own corners. Where it has not, the
//! tetrahedra stay what they are: a gap is never left. (Finer lattices, in halves, nearer to a feature did not fill more of a body: a brick
//! beside a finer one has nodes in its faces.)

use std::collections::{BTreeMap, BTreeSet};

use mtled::cloud::hexahedron::{CORNERS, Hexahedron};
use mtled::cloud::quality::six_volumes;
use mtled::cloud::{self, Cloud, CloudError, Domain, OwnNodes, PACKED, Room, Spacing};

type Point = [f64; 3];

/// Least wanted distance of nodes over the lattice's pitch.
const FINE: f64 = 0.8;
/// Distance of a brick from surface, interfaces and nodes of features over the pitch, at least: tetrahedra of about its size lie between.
const ROOM: f64 = 0.75;
/// Radius that is kept free of other nodes over that of the circumsphere.
const CLEAR: f64 = 1.02;
/// Largest relative difference between the volumes of a brick and of its tetrahedra.
const ROUND_OFF: f64 = 1e-9;

/// A body with hexahedra inside, on a lattice, where surface, interfaces and features leave room for them, and tetrahedra around them.
///
/// # Errors
/// As [`cloud::generate`].
pub fn with_bricks(domain: &Domain, spacing: &Spacing) -> Result<Cloud, CloudError> {
    let mut bricks = Vec::new();
    let mut cloud = cloud::generate_with(domain, spacing, &mut |room| {
        let lattice = Lattice::new(room.bounds(), PACKED * spacing.far);
        let with_room: Vec<[u32; 3]> = lattice.all().filter(|at| lattice.has_room(room, *at)).collect();
        bricks = with_room.iter().map(|at| lattice.corners(*at)).collect();
        let filled: BTreeSet<[u32; 3]> = with_room.into_iter().collect();
        let mut planted = BTreeSet::new();
        let corners = bricks.iter().flatten().copied();
        let nodes = corners.filter(|p| planted.insert(digits(*p))).collect();
        OwnNodes { nodes, keeps_free: Box::new(move |p| lattice.holds(&filled, p)) }
    })?;
    cloud.hexahedra = hexahedra(&bricks, &cloud.points, &cloud.cells);
    Ok(cloud)
}

/// Bricks that fill the box about a body.
struct Lattice {
    low: Point,
    extent: Point,
    count: [u32; 3],
    /// Longest edge of a brick.
    pitch: f64,
    /// Radius about the middle of a brick that other nodes stay out of.
    reach: f64,
}

impl Lattice {
    fn new((low, high): (Point, Point), edge: f64) -> Self {
        let extent = [0, 1, 2].map(|k| high[k] - low[k]);
        let count = extent.map(|x| (x / edge).round().max(1.0) as u32);
        let edges = [0, 1, 2].map(|k| extent[k] / f64::from(count[k]));
        let pitch = edges.into_iter().fold(0.0, f64::max);
        let reach = 0.5 * CLEAR * edges.iter().map(|x| x * x).sum::<f64>().sqrt();
        Self { low, extent, count, pitch, reach }
    }

    /// Bricks by their places along the axes.
    fn all(&self) -> impl Iterator<Item = [u32; 3]> {
        let [x, y, z] = self.count;
        (0..z).flat_map(move |k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])))
    }

    fn corners(&self, at: [u32; 3]) -> [Point; 8] {
        // neighbours have the same digits for the corners that they share
        let along = |k: usize, n: u32| self.low[k] + self.extent[k] * (f64::from(n) / f64::from(self.count[k]));
        CORNERS.map(|c| [0, 1, 2].map(|k| along(k, at[k] + u32::from(c[k] > 0))))
    }

    fn middle(&self, at: [u32; 3]) -> Point {
        let corners = self.corners(at);
        [0, 1, 2].map(|k| 0.5 * (corners[0][k] + corners[6][k]))
    }

    /// Whether a brick is clear of surface, interfaces, paths and the nodes that are there, and wide enough for the spacing.
    fn has_room(&self, room: &Room<'_>, at: [u32; 3]) -> bool {
        let middle = self.middle(at);
        let (at_corner, at_middle) = (ROOM * self.pitch, (0.5 + ROOM) * self.pitch);
        room.is_clear(middle, at_middle)
            && room.distance(middle) >= FINE * self.pitch
            && room.is_empty(middle, at_middle)
            && self.corners(at).iter().all(|&p| room.is_clear(p, at_corner) && room.takes(p))
    }

    /// Whether a place lies in the circumsphere of one of these bricks: of the one that it is in, or of a neighbour.
    fn holds(&self, filled: &BTreeSet<[u32; 3]>, p: Point) -> bool {
        let own = [0, 1, 2].map(|k| ((p[k] - self.low[k]) / self.extent[k] * f64::from(self.count[k])).max(0.0) as u32);
        let beside = (0..27).map(|n| [n % 3, n / 3 % 3, n / 9]);
        let within = |at: [u32; 3]| {
            let middle = self.middle(at);
            (0..3).map(|k| (p[k] - middle[k]).powi(2)).sum::<f64>() < self.reach * self.reach
        };
        // an offset of 1 is the brick itself
        beside
            .filter_map(|offset| {
                let [x, y, z] = [0, 1, 2].map(|k| (own[k] + offset[k]).checked_sub(1));
                Some([x?, y?, z?])
            })
            .any(|at| filled.contains(&at) && within(at))
    }
}

/// The hexahedra among a cloud's cells: the bricks that tetrahedra of their own corners fill.
fn hexahedra(bricks: &[[Point; 8]], points: &[Point], cells: &[[u32; 4]]) -> Vec<Hexahedron> {
    if bricks.is_empty() {
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
        let [x, y, z] = [0, 1, 2].map(|k| places[6][k] - places[0][k]);
        ((filled / (6.0 * x * y * z) - 1.0).abs() < ROUND_OFF).then_some(Hexahedron { corners, cells: own })
    };
    bricks.iter().filter_map(hexahedron).collect()
}

/// What tells a place from all others.
fn digits(p: Point) -> [u64; 3] {
    p.map(f64::to_bits)
}
