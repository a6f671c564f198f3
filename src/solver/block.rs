//! Partition of the integration points into blocks that fit the first-level cache.
//!
//! A block copies the displacement of its own nodes in, works on 16-bit local indices and adds force to its own
//! buffer; the buffers are then summed node by node in a fixed order. The partition depends on the model alone, so
//! the result has the same bits for any number of threads, and no atomic is needed.

use crate::approximation::{Form, ShapeTable};

use super::dilatation::Dilatation;
use super::memory::Memory;
use super::real::Real;

/// Support entries per block: gradients of about 200 kB stream through, the few hundred nodes stay in cache.
const ENTRIES: usize = 16_384;

/// A run of integration points with their local shape table and scratch memory.
#[derive(Clone, Debug)]
pub struct Block<T> {
    /// Global index of each local node, ascending; then the nodes whose images beyond the axis the block uses.
    pub nodes: Vec<u32>,
    /// Number of local nodes that are no images.
    pub originals: usize,
    /// What the shape table describes.
    pub form: Form,
    /// Offsets into `local` and `gradient`, one more than points.
    pub start: Vec<u32>,
    /// Local index of each support node.
    pub local: Vec<u16>,
    /// d phi_j / d X_k, 1/m.
    pub gradient: Vec<[T; 3]>,
    /// Volume of each point, m^3.
    pub volume: Vec<T>,
    /// Share of each point that is tissue: 1, or less where a needle fills its cell.
    pub active: Vec<T>,
    /// Local indices of the corners of the point's cell: the nodes that share its volume ratio. A triangle repeats its
    /// last.
    pub corners: Vec<[u16; 4]>,
    /// First point of the block in the shape table.
    pub first_point: usize,
    /// Global index of each coarse pressure node that the block's nodes use.
    pub coarse: Vec<u32>,
    /// Offsets into `coarse_local` and `coarse_value`, one more than local nodes.
    pub coarse_start: Vec<u32>,
    /// Local coarse index.
    pub coarse_local: Vec<u16>,
    /// N_aP.
    pub coarse_value: Vec<f64>,
    /// Displacement of the local nodes relative to the block's first node, m; the fourth lane is padding.
    pub u: Vec<[T; 4]>,
    /// Deformation gradient of each point, by columns: d x / d X_k, each padded to four lanes.
    pub deformation: Vec<[[T; 4]; 3]>,
    /// Sum over the block's points of V (J - 1) over the number of corners, at each local node, m^3.
    pub dilation: Vec<T>,
    /// Sum over the block's nodes of N_aP times `dilation`, m^3.
    pub coarse_dilation: Vec<f64>,
    /// Pressure at each local node, Pa.
    pub pressure: Vec<T>,
    /// Internal force of the block's points on each local node, N; the fourth lane is padding.
    pub force: Vec<[T; 4]>,
    /// Smallest volume ratio of the block's points at the last evaluation.
    pub min_jacobian: f64,
    /// Strain energy of the block's points less the projected volumetric part, at the last evaluation, J.
    pub energy: f64,
    /// What the points of a relaxing material remember.
    pub memory: Memory,
}

/// Where each global index's shares lie: block and local index, in block order.
#[derive(Clone, Debug, Default)]
pub struct Shares {
    /// Offsets, one more than indices.
    pub start: Vec<u32>,
    /// (block, local index).
    pub at: Vec<(u32, u32)>,
}

impl<T: Real> Block<T> {
    /// Cuts a shape table of `count` nodes into blocks.
    #[must_use]
    pub fn partition(table: &ShapeTable, cells: &[[u32; 4]], count: usize, dilatation: &Dilatation) -> Vec<Self> {
        let points = table.volume.len();
        let mut blocks = Vec::new();
        let mut first = 0;
        while first < points {
            let mut last = first + 1;
            while last < points && (table.start[last + 1] - table.start[first]) as usize <= ENTRIES {
                last += 1;
            }
            blocks.push(Self::new(table, cells, count, dilatation, first, last));
            first = last;
        }
        blocks
    }

    fn new(
        table: &ShapeTable,
        cells: &[[u32; 4]],
        count: usize,
        dilatation: &Dilatation,
        first: usize,
        last: usize,
    ) -> Self {
        let entries = table.start[first] as usize..table.start[last] as usize;
        let corners = |p: usize| cells[table.cell[p] as usize];
        let nodes = ascending(table.nodes[entries.clone()].iter().copied().chain((first..last).flat_map(corners)));
        let mut coarse_of_node: Vec<(&[u32], &[f64])> = vec![(&[], &[]); nodes.len()];
        // only nodes that are corners of the block's own cells carry dilation
        for n in (first..last).flat_map(corners) {
            coarse_of_node[position(&nodes, n) as usize] = dilatation.of_node(n as usize);
        }
        let coarse = ascending(coarse_of_node.iter().flat_map(|(c, _)| c.iter().copied()));
        let mut coarse_start = vec![0];
        let mut coarse_local = Vec::new();
        let mut coarse_value = Vec::new();
        for (c, v) in coarse_of_node {
            coarse_local.extend(c.iter().map(|&p| position(&coarse, p)));
            coarse_value.extend_from_slice(v);
            coarse_start.push(coarse_local.len() as u32);
        }
        // entries beyond the last node are images
        let originals = nodes.partition_point(|&n| (n as usize) < count);
        let form = table.form;
        let local = table.nodes[entries.clone()].iter().map(|&n| position(&nodes, n)).collect();
        let corners = (first..last).map(|p| corners(p).map(|n| position(&nodes, n))).collect();
        let nodes: Vec<u32> = nodes.into_iter().map(|n| n % count as u32).collect();
        let count = nodes.len();
        Self {
            originals,
            form,
            start: (first..=last).map(|p| table.start[p] - table.start[first]).collect(),
            local,
            gradient: table.gradient[entries].iter().map(|g| g.map(T::of)).collect(),
            volume: table.volume[first..last].iter().map(|&v| T::of(v)).collect(),
            active: vec![T::of(1.0); last - first],
            corners,
            first_point: first,
            coarse_start,
            coarse_local,
            coarse_value,
            u: vec![[T::default(); 4]; count],
            deformation: vec![[[T::default(); 4]; 3]; last - first],
            dilation: vec![T::default(); count],
            coarse_dilation: vec![0.0; coarse.len()],
            pressure: vec![T::default(); count],
            force: vec![[T::default(); 4]; count],
            min_jacobian: 1.0,
            energy: 0.0,
            memory: Memory::default(),
            nodes,
            coarse,
        }
    }
}

fn ascending(indices: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut v: Vec<u32> = indices.collect();
    v.sort_unstable();
    v.dedup();
    v
}

fn position(sorted: &[u32], n: u32) -> u16 {
    sorted.partition_point(|&m| m < n) as u16
}

impl Shares {
    /// Collects the shares of every index in `0..count` from the blocks' ascending index lists.
    #[must_use]
    pub fn of<'a>(lists: impl Iterator<Item = &'a [u32]> + Clone, count: usize) -> Self {
        let mut start = vec![0u32; count + 1];
        for &n in lists.clone().flatten() {
            start[n as usize + 1] += 1;
        }
        for n in 0..count {
            start[n + 1] += start[n];
        }
        let mut at = vec![(0, 0); start[count] as usize];
        let mut next = start.clone();
        for (b, list) in lists.enumerate() {
            for (l, &n) in list.iter().enumerate() {
                at[next[n as usize] as usize] = (b as u32, l as u32);
                next[n as usize] += 1;
            }
        }
        Self { start, at }
    }

    /// Shares of one index.
    #[must_use]
    pub fn of_index(&self, n: usize) -> &[(u32, u32)] {
        &self.at[self.start[n] as usize..self.start[n + 1] as usize]
    }
}
