//! Internal force of the total Lagrangian formulation, in two passes over the blocks:
//!
//! ```text
//! pass 1   F = I + sum_j u_j (x) grad phi_j,   J = det F,   dilation summed to nodes, then to coarse pressure nodes
//! pass 2   p from the coarse pressures,        f_j += V P(F, p) grad phi_j
//! ```
//!
//! Pass 2 is the exact derivative of the energy that pass 1 defines (see [`super::dilatation`]), so the force is
//! conservative. With the pointwise volume ratio p = kappa u'(J_g) and the coarse nodes are idle.

use super::VolumeRatio;
use crate::approximation::ShapeTable;
use crate::material::neo_hookean::Gradient;
use crate::material::{Law, Volumetric};

use super::block::{Block, ForceOfLane, Shares};
use super::dilatation::{Dilatation, POINTWISE_BULK};
use super::disjoint::{Chunks, Each, Either, Offsets, Runs, Then};
use super::fold::{self, Guard, Resistance};
use super::memory::Memory;
use super::points::{Constants, Relaxing};
use super::pool::Pool;
use super::strip::Strip;
use crate::number::lanes::{LANES, Lanes, Loop, run};
use crate::number::{Number, Real};

/// Nodes per part of a phase over nodes. Under Miri, here and below, so few that a tiny model has several parts.
pub const NODES_PER_CHUNK: usize = if cfg!(miri) { 8 } else { 256 };
/// Coarse nodes per part of a phase over them.
const COARSE_PER_CHUNK: usize = if cfg!(miri) { 4 } else { 64 };

/// Internal-force kernel of one model.
#[derive(Clone, Debug)]
pub struct Kernel<T: Real> {
    pub(super) blocks: Vec<Block<T>>,
    /// Block and slot of each integration point.
    slot: Vec<(u32, u32)>,
    /// Internal force of each block on each of its nodes, block after block, N.
    force: Vec<[T; 3]>,
    /// Where each block's begin.
    force_runs: Offsets,
    force_shares: Shares,
    /// V (J - 1) of each block at each of its vertices, block after block, m^3.
    dilation: Vec<T>,
    /// Where each block's begin.
    dilation_runs: Offsets,
    dilation_shares: Shares,
    projection: Projection<T>,
    guard: Guard,
    /// Of the guarded cells at the last evaluation.
    resistance: Vec<Resistance>,
    /// Of each thread.
    scratch: Vec<ForceOfLane<T>>,
    nodes: usize,
    pub(super) constants: Constants,
}

/// The projection of the dilation and its last values.
#[derive(Clone, Debug)]
struct Projection<T> {
    /// N_aP, [`NODES_PER_CHUNK`] nodes each; none with the pointwise volume ratio.
    strips: Vec<Strip<T>>,
    /// Sums of the strips to each of their coarse nodes, strip after strip, m^3.
    sums: Vec<T>,
    /// Where the sums of each strip begin.
    runs: Offsets,
    shares: Shares,
    /// V_P, m^3.
    volume: Vec<f64>,
    /// (kappa - kappa_s) u'(J_P), Pa.
    coarse: Vec<T>,
    /// The same at the nodes, Pa; whole groups of lanes.
    nodal: Vec<T>,
}

impl<T: Real> Kernel<T> {
    /// Prepares the blocks of a shape table.
    #[must_use]
    pub fn new(
        table: &ShapeTable,
        cells: &[[u32; 4]],
        points: &[[f64; 3]],
        law: &Law,
        volume_ratio: VolumeRatio,
    ) -> Self {
        let nodes = points.len();
        let (mu, kappa) = (law.shear_modulus(), law.bulk_modulus);
        let (dilatation, pointwise) = match volume_ratio {
            VolumeRatio::Projected => {
                (Dilatation::projected(points, cells, table.form), kappa.min(POINTWISE_BULK * mu))
            }
            VolumeRatio::Averaged => (Dilatation::nodal(nodes), 0.0),
            VolumeRatio::Pointwise => (Dilatation { start: vec![0; nodes + 1], ..Dilatation::default() }, kappa),
        };
        let mut blocks = Block::partition(table, cells, points);
        let mut slot = vec![(0, 0); table.volume.len()];
        for (b, block) in blocks.iter_mut().enumerate() {
            block.memory = Memory::new(&law.prony, block.point.len());
            block.occupied().for_each(|(s, point)| slot[point] = (b as u32, s as u32));
        }
        let most = blocks.iter().map(|b| b.nodes.len()).max().unwrap_or(0);
        let projection = Projection::new(&dilatation, table, cells, nodes);
        let force_runs = Offsets::of(blocks.iter().map(|b| b.nodes.len()));
        let dilation_runs = Offsets::of(blocks.iter().map(|b| b.vertices.len()));
        Self {
            force: vec![[T::default(); 3]; force_runs.total()],
            force_runs,
            force_shares: Shares::of(blocks.iter().map(|b| b.nodes.as_slice()), nodes),
            dilation: vec![T::default(); dilation_runs.total()],
            dilation_runs,
            dilation_shares: Shares::of(blocks.iter().map(|b| b.vertices.as_slice()), nodes),
            projection,
            scratch: vec![vec![Default::default(); most]],
            resistance: vec![Resistance::default(); table.guarded.len()],
            guard: Guard::new(&table.guarded, cells, points, mu),
            nodes,
            constants: Constants {
                law: *law,
                projected: kappa - pointwise,
                pointwise,
                resists_collapse: volume_ratio == VolumeRatio::Projected,
            },
            slot,
            blocks,
        }
    }

    /// Makes memory for a team of so many threads; a new kernel has it for one.
    #[must_use]
    pub fn for_threads(mut self, threads: usize) -> Self {
        self.scratch.resize(threads.max(1), self.scratch[0].clone());
        self
    }

    /// Number of nodes.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Smallest volume ratio of any integration point at the last evaluation.
    #[must_use]
    pub fn min_jacobian(&self) -> f64 {
        self.blocks.iter().map(|b| b.min_jacobian).fold(f64::INFINITY, f64::min)
    }

    /// Says which share of an integration point is tissue, 0 to 1; the rest carries no stress.
    pub fn set_active(&mut self, point: usize, share: f64) {
        let (b, s) = self.slot[point];
        self.blocks[b as usize].active[s as usize / LANES].0[s as usize % LANES] = T::of(share);
    }

    /// Makes every point tissue again.
    pub fn activate_all(&mut self) {
        self.blocks.iter_mut().for_each(|b| b.active.fill(Lanes::of(1.0)));
    }

    /// Deformation gradient (row-major) of one integration point at the last evaluation.
    #[must_use]
    pub fn deformation(&self, point: usize) -> Gradient<f64> {
        let (b, s) = self.slot[point];
        self.blocks[b as usize].deformation_in(s as usize)
    }

    /// Strain energy at the last evaluation, J.
    #[must_use]
    pub fn energy(&self) -> f64 {
        let projected: f64 = if self.constants.projected > 0.0 {
            let (kappa, volumetric) = (self.constants.projected, self.constants.law.volumetric);
            let density = |p: f64| kappa * volumetric.energy(volumetric.dilation(p / kappa));
            self.projection.coarse.iter().zip(&self.projection.volume).map(|(p, v)| v * density(p.get())).sum()
        } else {
            0.0
        };
        let resisting: f64 = self.resistance.iter().map(|r| r.energy).sum();
        self.blocks.iter().map(|b| b.energy).sum::<f64>() + projected + resisting
    }

    /// Calls `visit(point, F, P, V)` for every integration point of the last evaluation: deformation gradient and first
    /// Piola-Kirchhoff stress in Pa (row-major), volume in m^3.
    pub fn for_points(&self, mut visit: impl FnMut(usize, Gradient<f64>, Gradient<f64>, f64)) {
        for b in &self.blocks {
            let law = Relaxing { constants: &self.constants, memory: &b.memory };
            for (slot, point) in b.occupied() {
                let f = b.deformation_in(slot);
                let (_, stress) = law.evaluate(slot, &f, b.projected_pressure_in(slot));
                visit(point, f, stress, b.volume_in(slot));
            }
        }
    }
}

impl<T: Real> Projection<T> {
    fn new(dilatation: &Dilatation, table: &ShapeTable, cells: &[[u32; 4]], nodes: usize) -> Self {
        let entries = |a: usize| {
            let (coarse, value) = dilatation.of_node(a);
            coarse.iter().copied().zip(value.iter().copied())
        };
        let mut volume = vec![0.0; dilatation.count];
        let corners = table.form.corners();
        let share = 1.0 / corners as f64;
        for (p, v) in table.volume.iter().enumerate() {
            for n in &cells[table.cell[p] as usize][..corners] {
                entries(*n as usize).for_each(|(coarse, value)| volume[coarse as usize] += share * v * value);
            }
        }
        let strips: Vec<Strip<T>> = if dilatation.count > 0 {
            let range = |first: usize| first..(first + NODES_PER_CHUNK).min(nodes);
            (0..nodes).step_by(NODES_PER_CHUNK).map(|first| Strip::new(range(first), entries)).collect()
        } else {
            Vec::new()
        };
        let runs = Offsets::of(strips.iter().map(|s| s.coarse().len()));
        Self {
            sums: vec![T::default(); runs.total()],
            runs,
            shares: Shares::of(strips.iter().map(Strip::coarse), dilatation.count),
            volume,
            coarse: vec![T::default(); dilatation.count],
            nodal: vec![T::default(); strips.len() * NODES_PER_CHUNK],
            strips,
        }
    }
}

impl<T: Real> Kernel<T> {
    /// Internal force for nodal parameters `u`, m: the blocks hold their forces afterwards.
    pub(super) fn force(&mut self, pool: &mut Pool, u: &[[f64; 3]]) {
        let deform = (Each::new(&mut self.blocks), Runs::new(&mut self.dilation, &self.dilation_runs));
        pool.each(deform, |_, (block, dilation)| block.deform(u, dilation));
        let pressure: &[T] = if self.constants.projected > 0.0 {
            let (dilation, shares) = (&self.dilation, &self.dilation_shares);
            self.projection.project(pool, &self.constants, |n| {
                // V_a (J_a - 1), m^3
                T::of(shares.of_index(n).iter().map(|&at| dilation[at as usize].get()).sum())
            })
        } else {
            &[]
        };
        let (constants, guard) = (&self.constants, &self.guard);
        let blocks = (Each::new(&mut self.blocks), Runs::new(&mut self.force, &self.force_runs));
        let count = self.force_runs.len();
        let work = Then(blocks, Chunks::new(&mut self.resistance, fold::CELLS_PER_CHUNK));
        pool.each_with(&mut self.scratch, work, |scratch, i, part| match part {
            Either::First((block, force)) => block.stress(pressure, constants, scratch, force),
            Either::Second(cells) => fold::fill(cells, i - count, |cell| guard.resistance(cell, u)),
        });
    }

    /// Shares of the masses, over s (see [`super::mass`]), in the first component of the forces.
    pub(super) fn bound(&mut self, pool: &mut Pool, u: &[[f64; 3]]) {
        let (constants, guard) = (&self.constants, &self.guard);
        let blocks = (Each::new(&mut self.blocks), Runs::new(&mut self.force, &self.force_runs));
        let count = self.force_runs.len();
        let work = Then(blocks, Chunks::new(&mut self.resistance, fold::CELLS_PER_CHUNK));
        pool.each_with(&mut self.scratch, work, |scratch, i, part| match part {
            Either::First((block, force)) => block.bound(constants, scratch, force),
            Either::Second(cells) => fold::fill(cells, i - count, |cell| guard.bound(cell, u)),
        });
    }

    /// Internal force on one node, N, after [`Kernel::force`].
    #[inline]
    pub(super) fn node_force(&self, n: usize) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for &at in self.force_shares.of_index(n) {
            let share = self.force[at as usize];
            (0..3).for_each(|k| sum[k] += share[k].get());
        }
        for &at in self.guard.of_node(n) {
            let share = self.resistance[at as usize / 4].force[at as usize % 4];
            (0..3).for_each(|k| sum[k] += share[k]);
        }
        sum
    }

    /// Internal force on every node, N, for nodal parameters `u`, m: for tests and studies, since it allocates.
    pub fn internal_force(&mut self, pool: &mut Pool, u: &[[f64; 3]]) -> Vec<[f64; 3]> {
        self.force(pool, u);
        (0..self.nodes).map(|n| self.node_force(n)).collect()
    }
}

impl<T: Real> Projection<T> {
    /// Pressure at the nodes, Pa, from V_a (J_a - 1) of each, m^3.
    fn project(&mut self, pool: &mut Pool, constants: &Constants, dilation: impl Fn(usize) -> T + Sync) -> &[T] {
        let sums = (Each::new(&mut self.strips), Runs::new(&mut self.sums, &self.runs));
        pool.each(sums, |_, (strip, out)| run(ToCoarse(strip, &dilation, out)));
        let (sums, shares, volume) = (&self.sums, &self.shares, &self.volume);
        pool.each(Chunks::new(&mut self.coarse, COARSE_PER_CHUNK), |i, out| {
            for (out, coarse) in out.iter_mut().zip(i * COARSE_PER_CHUNK..) {
                let sum: f64 = shares.of_index(coarse).iter().map(|&at| sums[at as usize].get()).sum();
                *out = pressure(constants, sum, volume[coarse]);
            }
        });
        let coarse = &self.coarse;
        let nodal = (Each::new(&mut self.strips), Chunks::new(&mut self.nodal, NODES_PER_CHUNK));
        pool.each(nodal, |_, (strip, out)| run(ToNodes(strip, coarse, out)));
        &self.nodal
    }
}

/// (kappa - kappa_s) u'(J_P), Pa, from the sum of V_a N_aP (J_a - 1) and V_P, m^3.
fn pressure<T: Real>(constants: &Constants, sum: f64, volume: f64) -> T {
    let (kappa, dilation) = (constants.projected, sum / volume);
    T::of(match constants.law.volumetric {
        _ if volume <= 0.0 => 0.0,
        Volumetric::Quadratic => kappa * dilation,
        other => kappa * other.slope(dilation),
    })
}

/// The dilations of one strip's nodes, to its coarse nodes.
struct ToCoarse<'a, T: Real, D>(&'a mut Strip<T>, &'a D, &'a mut [T]);

impl<T: Real, D: Fn(usize) -> T> Loop for ToCoarse<'_, T, D> {
    #[inline(always)]
    fn go(self) {
        self.0.sum_to_coarse(self.1, self.2);
    }
}

/// The coarse pressures to one strip's nodes.
struct ToNodes<'a, T: Real>(&'a mut Strip<T>, &'a [T], &'a mut [T]);

impl<T: Real> Loop for ToNodes<'_, T> {
    #[inline(always)]
    fn go(self) {
        self.0.hand_to_nodes(self.1, self.2);
    }
}
