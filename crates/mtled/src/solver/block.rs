//! Partition of the integration points into blocks that fit the processor's caches.
//!
//! A block copies the displacement of its own nodes in, works on 16-bit local indices and adds force to its own
//! buffer; the buffers are then summed node by node in a fixed order. The partition depends on the model alone, so
//! the result has the same bits for any number of threads, and no atomic is needed. Within a block points stand in
//! groups of eight, one to a lane.

use std::ops::Range;

use rayon::prelude::*;

use crate::approximation::{Form, ShapeTable};
use crate::material::neo_hookean::Gradient;

use super::strip::{FIELDS, ascending};
use super::vertices::Vertices;
use crate::number::{LANES, Lanes, Real};

/// Blocks to share among threads: two for each of sixteen.
const BLOCKS: usize = 32;
/// Visits per block at least and at most: the larger, the fewer nodes belong to several (four times as many visits make a
/// step 8% cheaper), until the block's own nodes no longer stay in cache while its gradients stream through. Under Miri, a
/// tiny model has several.
const VISITS: std::ops::RangeInclusive<usize> = if cfg!(miri) { 32..=64 } else { 4096..=16384 };

/// In [`Block::point`]: a lane that holds no point.
const NO_POINT: u32 = u32::MAX;

/// A run of groups of integration points with their local shape table. A visit is a group's use of a node; a slot is a lane
/// of a group.
#[derive(Debug)]
pub(super) struct Block<T: Real> {
    /// Global index of each local node, ascending; then the nodes whose images beyond the axis the block uses.
    pub nodes: Vec<u32>,
    /// Number of local nodes that are no images.
    pub originals: usize,
    /// What the shape table describes.
    pub form: Form,
    /// Offsets into `local` and `gradient`, one more than groups.
    pub start: Vec<u32>,
    /// Local index of each visited node.
    pub local: Vec<u16>,
    /// d phi_j / d X_k over the point's `scale`; zero in the lanes whose support does not have the node.
    pub gradient: Vec<[[T::Stored; LANES]; 3]>,
    /// Lanes of each visit whose support has the node, one bit each.
    pub used: Vec<u8>,
    /// sum_j |grad phi_j|^2 of each point, 1/m^2.
    pub squares: Vec<Lanes<T>>,
    /// Scale of each point's gradients, 1/m (see `packed`).
    pub scale: Vec<Lanes<T>>,
    /// Volume of each point, m^3; zero where a lane holds none.
    pub volume: Vec<Lanes<T>>,
    /// Vertex of each corner of the points' cells, ascending: what shares volume ratios (see [`super::vertices`]).
    pub vertices: Vec<u32>,
    /// Position in `vertices` of the corners of each point's cell. A triangle repeats its last.
    pub corners: Vec<[[u16; LANES]; 4]>,
    /// Index of each slot's point in the shape table.
    pub point: Vec<u32>,
    /// Region that all its points lie in.
    pub region: u8,
}

/// A block's scratch memory, and what its last evaluation left there.
#[derive(Debug)]
pub(super) struct BlockScratch<T> {
    /// Displacement of the local nodes relative to the block's first node, m.
    pub u: Vec<[T; 3]>,
    /// Deformation gradient of each point.
    pub deformation: Vec<Gradient<Lanes<T>>>,
    /// Pressure at each vertex, Pa, and theta^(-2/3) - 1 (see [`super::mixed`]): a corner reads both at once.
    pub projected: Vec<[T; FIELDS]>,
    /// Whether the second is there.
    pub mixed: bool,
    /// Smallest volume ratio of the block's points at the last evaluation.
    pub min_jacobian: f64,
    /// Strain energy of the block's points less the projected volumetric part, at the last evaluation, J.
    pub energy: f64,
}

impl<T: Real> BlockScratch<T> {
    pub(super) fn new(block: &Block<T>, mixed: bool) -> Self {
        Self {
            u: vec![[T::default(); 3]; block.nodes.len()],
            deformation: vec![Default::default(); block.volume.len()],
            projected: vec![[T::default(); FIELDS]; block.vertices.len()],
            mixed,
            min_jacobian: 1.0,
            energy: 0.0,
        }
    }

    pub(super) fn deformation_in(&self, slot: usize) -> Gradient<f64> {
        self.deformation[slot / LANES].map(|f| f.0[slot % LANES].get())
    }
}

/// A thread's own memory while it works on a block: internal force on each local node by the lane of the points that
/// exert it, N; zero between blocks. It stays in the thread's first cache, where the blocks' own would not.
pub(super) type ForceOfLane<T> = Vec<[Lanes<T>; 3]>;

impl<T: Real> Block<T> {
    /// Groups the points of a shape table and cuts the groups into blocks, each in one region. `places` of the vertices.
    pub(super) fn partition(table: &ShapeTable, vertices: &Vertices, places: &[[f64; 3]], nodes: usize) -> Vec<Self> {
        let mut groups = table.groups(&vertices.cells, places);
        let region = |group: &[u32]| table.region_of(group[0] as usize);
        groups.sort_by_key(|group| region(group));
        let visited: Vec<Vec<u32>> = groups.par_iter().map(|group| visited(table, group)).collect();
        let total: usize = visited.iter().map(Vec::len).sum();
        let most = total.div_ceil(BLOCKS).clamp(*VISITS.start(), *VISITS.end());
        let mut ranges = Vec::new();
        let (mut first, mut visits) = (0, 0);
        for (g, visited) in visited.iter().enumerate() {
            let full = visits + visited.len() > most || region(&groups[g]) != region(&groups[first]);
            if full && g > first {
                ranges.push(first..g);
                (first, visits) = (g, 0);
            }
            visits += visited.len();
        }
        if first < groups.len() {
            ranges.push(first..groups.len());
        }
        let block = |r: Range<usize>| Self::new(table, &vertices.cells, nodes, &groups[r.clone()], &visited[r]);
        ranges.into_par_iter().map(block).collect()
    }

    fn new(table: &ShapeTable, cells: &[[u32; 4]], count: usize, groups: &[Vec<u32>], visited: &[Vec<u32>]) -> Self {
        let corners = |p: u32| cells[table.cell[p as usize] as usize];
        let members = || groups.iter().flatten().copied();
        let nodes = ascending(visited.iter().flatten().copied());
        let vertices = ascending(members().flat_map(corners));
        let mut block = Self {
            // entries beyond the last node are images
            originals: nodes.partition_point(|&n| (n as usize) < count),
            form: table.form,
            start: vec![0],
            local: visited.iter().flatten().map(|&n| position(&nodes, n)).collect(),
            gradient: vec![Default::default(); visited.iter().map(Vec::len).sum()],
            used: vec![0; visited.iter().map(Vec::len).sum()],
            squares: vec![Lanes::default(); groups.len()],
            scale: vec![Lanes::default(); groups.len()],
            volume: vec![Lanes::default(); groups.len()],
            corners: vec![[[0; LANES]; 4]; groups.len()],
            point: vec![NO_POINT; LANES * groups.len()],
            nodes: nodes.iter().map(|&n| n % count as u32).collect(),
            vertices: Vec::new(),
            region: table.region_of(groups[0][0] as usize),
        };
        let mut from = 0;
        for (g, (group, visited)) in groups.iter().zip(visited).enumerate() {
            for (lane, &p) in group.iter().enumerate() {
                block.point[LANES * g + lane] = p;
                block.volume[g].0[lane] = T::of(table.volume[p as usize]);
                for (k, n) in corners(p).into_iter().enumerate() {
                    block.corners[g][k][lane] = position(&vertices, n);
                }
                let entries = table.entries(p as usize);
                let (scale, packed) = packed::<T>(&table.gradient[entries.clone()]);
                block.scale[g].0[lane] = T::of(scale);
                let mut squares = 0.0;
                for (&n, gradient) in table.nodes[entries].iter().zip(packed) {
                    let visit = from + usize::from(position(visited, n));
                    (0..3).for_each(|k| block.gradient[visit][k][lane] = gradient[k]);
                    block.used[visit] |= 1 << lane;
                    squares += gradient.iter().map(|&g| (scale * T::load(g).get()).powi(2)).sum::<f64>();
                }
                block.squares[g].0[lane] = T::of(squares);
            }
            from += visited.len();
            block.start.push(from as u32);
        }
        block.vertices = vertices;
        block
    }

    /// Slots that hold a point, with the point's index in the shape table.
    pub(super) fn occupied(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let held = self.point.iter().enumerate().filter(|&(_, &point)| point != NO_POINT);
        held.map(|(slot, &point)| (slot, point as usize))
    }

    /// Volume of the point in one slot, m^3.
    pub(super) fn volume_in(&self, slot: usize) -> f64 {
        self.volume[slot / LANES].0[slot % LANES].get()
    }
}

/// The gradients of a point over a scale of their own.
///
/// The kernel is as fast as gradients stream in from memory, so in single precision they are kept in 16 bits: whole
/// numbers, the largest 32767. Rounding changes a gradient by up to 3e-5 of the largest, but not the sum over the
/// support nodes, so that a uniform displacement strains nothing.
fn packed<T: Real>(gradient: &[[f64; 3]]) -> (f64, Vec<[T::Stored; 3]>) {
    let Some(most) = T::LARGEST_STORED else {
        return (1.0, gradient.iter().map(|g| g.map(T::store)).collect());
    };
    let largest = gradient.iter().flatten().fold(0.0_f64, |a, g| a.max(g.abs()));
    let scale = if largest > 0.0 { largest / (most - 1.0) } else { 1.0 };
    let exact: Vec<[f64; 3]> = gradient.iter().map(|g| g.map(|g| g / scale)).collect();
    let mut whole: Vec<[f64; 3]> = exact.iter().map(|g| g.map(f64::round)).collect();
    for k in 0..3 {
        let sum = |g: &[[f64; 3]]| g.iter().map(|g| g[k]).sum::<f64>();
        let mut missing = sum(&exact).round() - sum(&whole);
        // those that were rounded furthest the wrong way give way: a few
        while missing != 0.0 {
            let gain = |i: usize| (exact[i][k] - whole[i][k]) * missing.signum();
            let Some(most) = (0..exact.len()).reduce(|a, b| if gain(b) > gain(a) { b } else { a }) else { break };
            whole[most][k] += missing.signum();
            missing -= missing.signum();
        }
    }
    (scale, whole.iter().map(|g| g.map(T::store)).collect())
}

/// Support nodes of a group's points, ascending.
fn visited(table: &ShapeTable, group: &[u32]) -> Vec<u32> {
    let support = |&p: &u32| &table.nodes[table.entries(p as usize)];
    ascending(group.iter().flat_map(support).copied())
}

fn position(sorted: &[u32], n: u32) -> u16 {
    sorted.partition_point(|&m| m < n) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_gradients_keep_their_sum_and_are_close() {
        // shape functions of a constant sum to zero
        let mut gradient: Vec<[f64; 3]> =
            (0..40).map(|i| std::array::from_fn(|k| 900.0 * ((i * 7 + k * 13) as f64).sin())).collect();
        let sum: [f64; 3] = std::array::from_fn(|k| gradient.iter().map(|g| g[k]).sum());
        gradient.push(sum.map(|s| -s));
        let (scale, stored) = packed::<f32>(&gradient);
        for k in 0..3 {
            assert_eq!(stored.iter().map(|g| i32::from(g[k])).sum::<i32>(), 0);
            for (g, s) in gradient.iter().zip(&stored) {
                assert!((g[k] - scale * f64::from(s[k])).abs() < scale, "{} {}", g[k], s[k]);
            }
        }
        let (scale, stored) = packed::<f64>(&gradient);
        assert_eq!((scale, stored), (1.0, gradient));
    }
}
