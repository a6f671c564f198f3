//! Internal force of the total Lagrangian formulation, in two passes over the blocks:
//!
//! ```text
//! pass 1   F = I + sum_j u_j (x) grad phi_j,   J = det F,   dilation summed to nodes, then to coarse pressure nodes
//! pass 2   p from the coarse pressures,        f_j += V P(F, p) grad phi_j
//! ```
//!
//! Pass 2 is the exact derivative of the energy that pass 1 defines (see [`super::dilatation`]), so the force is
//! conservative. With the pointwise volume ratio p = kappa u'(J_g) and the coarse nodes are idle.

use crate::approximation::ShapeTable;
use crate::material::neo_hookean::Gradient;
use crate::material::{Law, Volumetric};
use crate::scene::VolumeRatio;

use super::block::{Block, Shares};
use super::dilatation::{Dilatation, POINTWISE_BULK};
use super::fold::{self, Guard, Resistance};
use super::lanes::{LANES, Lanes, Loop, run};
use super::memory::Memory;
use super::points::{Constants, Relaxing};
use super::pool::{Dealt, Team};
use super::real::{Number, Real};
use super::rows::Rows;

/// Nodes per share of the sums over nodes.
pub const NODES_PER_DEAL: usize = 256;
/// Groups of rows per share of a product with N_aP.
const ROWS_PER_DEAL: usize = NODES_PER_DEAL / LANES;

/// Internal-force kernel of one model.
#[derive(Clone, Debug)]
pub struct Kernel<T: Real> {
    pub(super) blocks: Vec<Block<T>>,
    /// Block and slot of each integration point.
    slot: Vec<(u32, u32)>,
    node_shares: Shares,
    projection: Projection<T>,
    pressure: Pressure<T>,
    guard: Guard,
    /// Of the guarded cells at the last evaluation.
    resistance: Vec<Resistance>,
    nodes: usize,
    pub(super) constants: Constants,
}

/// N_aP both ways, and the volumes of the coarse nodes.
#[derive(Clone, Debug)]
struct Projection<T> {
    /// Rows P.
    to_coarse: Rows<T>,
    /// Rows a.
    to_nodes: Rows<T>,
    /// V_P, m^3.
    volume: Vec<f64>,
}

/// Volume ratios and pressures of the last evaluation; whole groups of lanes.
#[derive(Clone, Debug)]
struct Pressure<T> {
    /// V_a (J_a - 1), m^3.
    dilation: Vec<T>,
    /// (kappa - kappa_s) u'(J_P), Pa.
    coarse: Vec<T>,
    /// The same at the nodes, Pa.
    nodal: Vec<T>,
}

/// The kernel's memory during a job, dealt to the team's threads.
pub struct Parts<'a, T: Real> {
    pub(super) blocks: Dealt<'a, Block<T>>,
    dilation: Dealt<'a, T>,
    coarse: Dealt<'a, T>,
    nodal: Dealt<'a, T>,
    resistance: Dealt<'a, Resistance>,
    pub(super) guard: &'a Guard,
    node_shares: &'a Shares,
    projection: &'a Projection<T>,
    nodes: usize,
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
        let projection = Projection::new(&dilatation, table, cells, nodes);
        Self {
            node_shares: Shares::of(blocks.iter().map(|b| b.nodes.as_slice()), nodes),
            pressure: Pressure {
                dilation: vec![T::default(); nodes],
                coarse: vec![T::default(); LANES * projection.to_coarse.groups()],
                nodal: vec![T::default(); LANES * projection.to_nodes.groups()],
            },
            projection,
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

    /// Lends the kernel's memory to a job.
    pub fn parts(&mut self) -> Parts<'_, T> {
        Parts {
            blocks: Dealt::new(&mut self.blocks),
            dilation: Dealt::new(&mut self.pressure.dilation),
            coarse: Dealt::new(&mut self.pressure.coarse),
            nodal: Dealt::new(&mut self.pressure.nodal),
            resistance: Dealt::new(&mut self.resistance),
            guard: &self.guard,
            node_shares: &self.node_shares,
            projection: &self.projection,
            nodes: self.nodes,
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
            self.pressure.coarse.iter().zip(&self.projection.volume).map(|(p, v)| v * density(p.get())).sum()
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
        let mut of_coarse = vec![Vec::new(); dilatation.count];
        for a in 0..nodes {
            entries(a).for_each(|(coarse, value)| of_coarse[coarse as usize].push((a as u32, value)));
        }
        let mut volume = vec![0.0; dilatation.count];
        let corners = table.form.corners();
        let share = 1.0 / corners as f64;
        for (p, v) in table.volume.iter().enumerate() {
            for n in &cells[table.cell[p] as usize][..corners] {
                entries(*n as usize).for_each(|(coarse, value)| volume[coarse as usize] += share * v * value);
            }
        }
        Self {
            to_nodes: Rows::new(if dilatation.count > 0 { nodes } else { 0 }, |a| entries(a).collect()),
            to_coarse: Rows::new(dilatation.count, |coarse| of_coarse[coarse].clone()),
            volume,
        }
    }
}

impl<T: Real> Parts<'_, T> {
    /// Internal force for nodal parameters `u`. The caller must have passed a barrier since `u` was written; on return
    /// the blocks hold their forces and the team has passed a barrier.
    pub fn force(&self, team: &Team, u: &[[f64; 3]]) {
        let count = self.blocks.len();
        // SAFETY (all blocks below): each block, then each range of nodes or rows, is claimed by one thread between
        // barriers, and what a phase reads no thread writes in it.
        team.claim(count, |b| unsafe { self.blocks.get(b) }.deform(u));
        team.barrier();
        let pressures: &[T] = if self.constants.projected > 0.0 {
            team.claim(self.nodes.div_ceil(NODES_PER_DEAL), |deal| self.sum_dilation(deal));
            team.barrier();
            team.claim(self.projection.to_coarse.groups().div_ceil(ROWS_PER_DEAL), |deal| run(ToCoarse(self, deal)));
            team.barrier();
            team.claim(self.projection.to_nodes.groups().div_ceil(ROWS_PER_DEAL), |deal| run(ToNodes(self, deal)));
            team.barrier();
            unsafe { self.nodal.read() }
        } else {
            &[]
        };
        team.claim(count + self.guard_deals(), |i| match i.checked_sub(count) {
            None => unsafe { self.blocks.get(i) }.stress(pressures, &self.constants),
            Some(deal) => self.resist(deal, |cell| self.guard.resistance(cell, u)),
        });
        team.barrier();
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

    /// V_a (J_a - 1) of one deal of nodes.
    fn sum_dilation(&self, deal: usize) {
        let range = deal * NODES_PER_DEAL..((deal + 1) * NODES_PER_DEAL).min(self.nodes);
        // SAFETY: as in `force`.
        let (blocks, dilation) = unsafe { (self.blocks.read(), self.dilation.part(range.clone())) };
        for (out, n) in dilation.iter_mut().zip(range) {
            let shares = self.node_shares.of_index(n).iter();
            *out = T::of(shares.map(|&(b, l)| blocks[b as usize].dilation[l as usize].get()).sum());
        }
    }

    /// Internal force on one node, N, after [`Parts::force`].
    ///
    /// # Safety
    /// Since the barrier that ends [`Parts::force`] no thread may have begun another evaluation.
    #[inline]
    pub unsafe fn node_force(&self, n: usize) -> [f64; 3] {
        // SAFETY: blocks are only read now, by the caller's promise.
        let (blocks, resistance) = unsafe { (self.blocks.read(), self.resistance.read()) };
        let mut sum = [0.0; 3];
        for &(b, l) in self.node_shares.of_index(n) {
            let share = blocks[b as usize].force[l as usize];
            (0..3).for_each(|k| sum[k] += share[k].get());
        }
        for &(cell, corner) in self.guard.of_node(n) {
            let share = resistance[cell as usize].force[corner as usize];
            (0..3).for_each(|k| sum[k] += share[k]);
        }
        sum
    }
}

/// Coarse pressures of one deal of rows.
struct ToCoarse<'a, T: Real>(&'a Parts<'a, T>, usize);

impl<T: Real> Loop for ToCoarse<'_, T> {
    #[inline(always)]
    fn go(self) {
        let Self(parts, deal) = self;
        let Projection { to_coarse, volume, .. } = parts.projection;
        let kappa = parts.constants.projected;
        for group in deal * ROWS_PER_DEAL..((deal + 1) * ROWS_PER_DEAL).min(to_coarse.groups()) {
            let range = LANES * group..LANES * (group + 1);
            // SAFETY: as in `Parts::force`.
            let (dilation, out) = unsafe { (parts.dilation.read(), parts.coarse.part(range.clone())) };
            let sums = to_coarse.times(group, dilation);
            for ((out, sum), volume) in out.iter_mut().zip(sums.0).zip(&volume[range.start..]) {
                let dilation = sum.get() / volume;
                *out = T::of(match parts.constants.law.volumetric {
                    _ if *volume <= 0.0 => 0.0,
                    Volumetric::Quadratic => kappa * dilation,
                    other => kappa * other.slope(dilation),
                });
            }
        }
    }
}

/// Nodal pressures of one deal of rows.
struct ToNodes<'a, T: Real>(&'a Parts<'a, T>, usize);

impl<T: Real> Loop for ToNodes<'_, T> {
    #[inline(always)]
    fn go(self) {
        let Self(parts, deal) = self;
        let rows = &parts.projection.to_nodes;
        for group in deal * ROWS_PER_DEAL..((deal + 1) * ROWS_PER_DEAL).min(rows.groups()) {
            // SAFETY: as in `Parts::force`.
            let (coarse, out) = unsafe { (parts.coarse.read(), parts.nodal.part(LANES * group..LANES * (group + 1))) };
            out.copy_from_slice(&rows.times(group, coarse).0);
        }
    }
}
