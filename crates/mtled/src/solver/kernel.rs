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
use super::fold::{self, Guard, Resistance};
use super::memory::Memory;
use super::points::{Constants, Relaxing};
use super::pool::{Dealt, Team};
use super::strip::Strip;
use crate::number::lanes::{LANES, Lanes, Loop, run};
use crate::number::{Number, Real};

/// Nodes per share of the sums over nodes.
pub const NODES_PER_DEAL: usize = 256;
/// Coarse nodes per share of the sums over them.
const COARSE_PER_DEAL: usize = 64;

/// Internal-force kernel of one model.
#[derive(Clone, Debug)]
pub struct Kernel<T: Real> {
    pub(super) blocks: Vec<Block<T>>,
    /// Block and slot of each integration point.
    slot: Vec<(u32, u32)>,
    /// Internal force of each block on each of its nodes, block after block, N.
    force: Vec<[T; 3]>,
    force_shares: Shares,
    /// V (J - 1) of each block at each of its vertices, block after block, m^3.
    dilation: Vec<T>,
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
    /// N_aP, [`NODES_PER_DEAL`] nodes each; none with the pointwise volume ratio.
    strips: Vec<Strip<T>>,
    /// Sums of the strips to each of their coarse nodes, strip after strip, m^3.
    sums: Vec<T>,
    /// Where the sums of each strip begin, one more than strips.
    start: Vec<usize>,
    shares: Shares,
    /// V_P, m^3.
    volume: Vec<f64>,
    /// (kappa - kappa_s) u'(J_P), Pa.
    coarse: Vec<T>,
    /// The same at the nodes, Pa; whole groups of lanes.
    nodal: Vec<T>,
}

/// The kernel's memory during a job, dealt to the team's threads.
pub struct Parts<'a, T: Real> {
    pub(super) blocks: Dealt<'a, Block<T>>,
    force: Dealt<'a, [T; 3]>,
    dilation: Dealt<'a, T>,
    strips: Dealt<'a, Strip<T>>,
    sums: Dealt<'a, T>,
    coarse: Dealt<'a, T>,
    nodal: Dealt<'a, T>,
    resistance: Dealt<'a, Resistance>,
    pub(super) scratch: Dealt<'a, ForceOfLane<T>>,
    pub(super) guard: &'a Guard,
    force_shares: &'a Shares,
    dilation_shares: &'a Shares,
    /// Where the sums of each strip begin.
    start: &'a [usize],
    shares: &'a Shares,
    /// V_P, m^3.
    volume: &'a [f64],
    pub(super) constants: Constants,
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
        Self {
            force: vec![[T::default(); 3]; blocks.iter().map(|b| b.nodes.len()).sum()],
            force_shares: Shares::of(blocks.iter().map(|b| b.nodes.as_slice()), nodes),
            dilation: vec![T::default(); blocks.iter().map(|b| b.vertices.len()).sum()],
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

    /// Lends the kernel's memory to a job.
    pub fn parts(&mut self) -> Parts<'_, T> {
        Parts {
            blocks: Dealt::new(&mut self.blocks),
            force: Dealt::new(&mut self.force),
            dilation: Dealt::new(&mut self.dilation),
            strips: Dealt::new(&mut self.projection.strips),
            sums: Dealt::new(&mut self.projection.sums),
            coarse: Dealt::new(&mut self.projection.coarse),
            nodal: Dealt::new(&mut self.projection.nodal),
            resistance: Dealt::new(&mut self.resistance),
            scratch: Dealt::new(&mut self.scratch),
            guard: &self.guard,
            force_shares: &self.force_shares,
            dilation_shares: &self.dilation_shares,
            start: &self.projection.start,
            shares: &self.projection.shares,
            volume: &self.projection.volume,
            constants: self.constants,
        }
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
            let range = |first: usize| first..(first + NODES_PER_DEAL).min(nodes);
            (0..nodes).step_by(NODES_PER_DEAL).map(|first| Strip::new(range(first), entries)).collect()
        } else {
            Vec::new()
        };
        let mut start = vec![0];
        start.extend(strips.iter().scan(0, |sum, strip| {
            *sum += strip.coarse().len();
            Some(*sum)
        }));
        Self {
            sums: vec![T::default(); strips.iter().map(|s| s.coarse().len()).sum()],
            start,
            shares: Shares::of(strips.iter().map(Strip::coarse), dilatation.count),
            volume,
            coarse: vec![T::default(); dilatation.count],
            nodal: vec![T::default(); strips.len() * NODES_PER_DEAL],
            strips,
        }
    }
}

impl<T: Real> Parts<'_, T> {
    /// Internal force for nodal parameters `u`. The caller must have passed a barrier since `u` was written; on return
    /// the blocks hold their forces and the team has passed a barrier.
    pub fn force(&self, team: &Team, u: &[[f64; 3]]) {
        let count = self.blocks.len();
        // SAFETY (all blocks below): each block, strip or range of nodes is claimed by one thread between barriers, a
        // thread's scratch memory is its own, and what a phase reads no thread writes in it.
        team.claim(count, |b| {
            let block = unsafe { self.blocks.get(b) };
            let range = block.first.vertex..block.first.vertex + block.vertices.len();
            block.deform(u, unsafe { self.dilation.part(range) });
        });
        team.barrier();
        let pressures: &[T] = if self.constants.projected > 0.0 {
            team.claim(self.strips.len(), |strip| run(ToCoarse(self, strip)));
            team.barrier();
            team.claim(self.coarse.len().div_ceil(COARSE_PER_DEAL), |deal| self.press(deal));
            team.barrier();
            team.claim(self.strips.len(), |strip| run(ToNodes(self, strip)));
            team.barrier();
            unsafe { self.nodal.read() }
        } else {
            &[]
        };
        team.claim(count + self.guard_deals(), |i| match i.checked_sub(count) {
            None => {
                let block = unsafe { self.blocks.get(i) };
                let (scratch, force) = unsafe { (self.scratch.get(team.rank), self.force_of(block)) };
                block.stress(pressures, &self.constants, scratch, force);
            }
            Some(deal) => self.resist(deal, |cell| self.guard.resistance(cell, u)),
        });
        team.barrier();
    }

    /// Forces of a block.
    ///
    /// # Safety
    /// The caller must have claimed the block, and no thread may read forces.
    #[expect(clippy::mut_from_ref, reason = "exclusive by the contract above")]
    pub(super) unsafe fn force_of(&self, block: &Block<T>) -> &mut [[T; 3]] {
        // SAFETY: blocks don't overlap.
        unsafe { self.force.part(block.first.node..block.first.node + block.nodes.len()) }
    }

    /// Shares of a pass over the guarded cells.
    pub(super) fn guard_deals(&self) -> usize {
        self.guard.len().div_ceil(fold::CELLS_PER_DEAL)
    }

    /// Keeps what the guarded cells of one deal resist with.
    pub(super) fn resist(&self, deal: usize, of: impl Fn(usize) -> Resistance) {
        let first = deal * fold::CELLS_PER_DEAL;
        for cell in first..(first + fold::CELLS_PER_DEAL).min(self.guard.len()) {
            // SAFETY: as in `force`.
            unsafe { *self.resistance.get(cell) = of(cell) };
        }
    }

    /// V_a (J_a - 1), m^3.
    #[inline(always)]
    fn dilation(&self, n: usize) -> T {
        // SAFETY: as in `force`.
        let dilation = unsafe { self.dilation.read() };
        T::of(self.dilation_shares.of_index(n).iter().map(|&at| dilation[at as usize].get()).sum())
    }

    /// Pressures of one deal of coarse nodes.
    fn press(&self, deal: usize) {
        let range = deal * COARSE_PER_DEAL..((deal + 1) * COARSE_PER_DEAL).min(self.coarse.len());
        let kappa = self.constants.projected;
        // SAFETY: as in `force`.
        let (sums, out) = unsafe { (self.sums.read(), self.coarse.part(range.clone())) };
        for (out, coarse) in out.iter_mut().zip(range) {
            let sum: f64 = self.shares.of_index(coarse).iter().map(|&at| sums[at as usize].get()).sum();
            let dilation = sum / self.volume[coarse];
            *out = T::of(match self.constants.law.volumetric {
                _ if self.volume[coarse] <= 0.0 => 0.0,
                Volumetric::Quadratic => kappa * dilation,
                other => kappa * other.slope(dilation),
            });
        }
    }

    /// Internal force on one node, N, after [`Parts::force`].
    ///
    /// # Safety
    /// Since the barrier that ends [`Parts::force`] no thread may have begun another evaluation.
    #[inline]
    pub unsafe fn node_force(&self, n: usize) -> [f64; 3] {
        // SAFETY: forces are only read now, by the caller's promise.
        let (force, resistance) = unsafe { (self.force.read(), self.resistance.read()) };
        let mut sum = [0.0; 3];
        for &at in self.force_shares.of_index(n) {
            let share = force[at as usize];
            (0..3).for_each(|k| sum[k] += share[k].get());
        }
        for &at in self.guard.of_node(n) {
            let share = resistance[at as usize / 4].force[at as usize % 4];
            (0..3).for_each(|k| sum[k] += share[k]);
        }
        sum
    }
}

/// The dilations of one strip's nodes, to its coarse nodes.
struct ToCoarse<'a, T: Real>(&'a Parts<'a, T>, usize);

impl<T: Real> Loop for ToCoarse<'_, T> {
    #[inline(always)]
    fn go(self) {
        let Self(parts, strip) = self;
        // SAFETY: as in `Parts::force`.
        let (own, out) =
            unsafe { (parts.strips.get(strip), parts.sums.part(parts.start[strip]..parts.start[strip + 1])) };
        own.sum_to_coarse(|n| parts.dilation(n), out);
    }
}

/// The coarse pressures to one strip's nodes.
struct ToNodes<'a, T: Real>(&'a Parts<'a, T>, usize);

impl<T: Real> Loop for ToNodes<'_, T> {
    #[inline(always)]
    fn go(self) {
        let Self(parts, strip) = self;
        let range = strip * NODES_PER_DEAL..(strip + 1) * NODES_PER_DEAL;
        // SAFETY: as in `Parts::force`.
        let (coarse, out) = unsafe { (parts.coarse.read(), parts.nodal.part(range)) };
        unsafe { parts.strips.get(strip) }.hand_to_nodes(coarse, out);
    }
}
