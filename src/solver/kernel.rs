//! Internal force of the total Lagrangian formulation, in two passes over the blocks:
//!
//! ```text
//! pass 1   F = I + sum_j u_j (x) grad phi_j,   J = det F,   dilation summed to nodes, then to coarse pressure nodes
//! pass 2   p from the coarse pressures,        f_j += V P(F, p) grad phi_j
//! ```
//!
//! Pass 2 is the exact derivative of the energy that pass 1 defines (see [`super::dilatation`]), so the force is
//! conservative. With the pointwise volume ratio p = kappa u'(J_g) and the coarse nodes are idle.

use crate::approximation::{Form, ShapeTable};
use crate::material::neo_hookean::{cofactor, determinant};
use crate::material::{Law, Volumetric};
use crate::scene::VolumeRatio;

use super::block::{Block, Shares};
use super::dilatation::{Dilatation, POINTWISE_BULK};
use super::memory::Memory;
use super::points::{Constants, PointLaw, Relaxing};
use super::pool::{Dealt, Team};
use super::real::Real;

/// Points whose law is evaluated before their stress is spread.
const RUN: usize = 16;

/// Columns of F = I.
const UNDEFORMED: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// Nodes per share of the final sum.
pub const NODES_PER_DEAL: usize = 256;

/// Internal-force kernel of one model.
#[derive(Clone, Debug)]
pub struct Kernel<T> {
    pub(super) blocks: Vec<Block<T>>,
    node_shares: Shares,
    coarse_shares: Shares,
    /// V_P, m^3.
    coarse_volume: Vec<f64>,
    /// (kappa - kappa_s) u'(J_P) at the last evaluation, Pa.
    coarse_pressure: Vec<f64>,
    nodes: usize,
    pub(super) constants: Constants,
}

/// The kernel's memory during a job, dealt to the team's threads.
pub struct Parts<'a, T> {
    pub(super) blocks: Dealt<'a, Block<T>>,
    pressure: Dealt<'a, f64>,
    pub(super) kernel: Fixed<'a>,
}

#[derive(Clone, Copy)]
pub(super) struct Fixed<'a> {
    node_shares: &'a Shares,
    coarse_shares: &'a Shares,
    coarse_volume: &'a [f64],
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
        let mut blocks = Block::partition(table, cells, nodes, &dilatation);
        blocks.iter_mut().for_each(|b| b.memory = Memory::new(&law.prony, b.volume.len()));
        let mut coarse_volume = vec![0.0; dilatation.count];
        let corners = table.form.corners();
        let share = 1.0 / corners as f64;
        for (p, v) in table.volume.iter().enumerate() {
            for n in &cells[table.cell[p] as usize][..corners] {
                let (coarse, value) = dilatation.of_node(*n as usize);
                for (c, x) in coarse.iter().zip(value) {
                    coarse_volume[*c as usize] += share * v * x;
                }
            }
        }
        Self {
            node_shares: Shares::of(blocks.iter().map(|b| b.nodes.as_slice()), nodes),
            coarse_shares: Shares::of(blocks.iter().map(|b| b.coarse.as_slice()), dilatation.count),
            coarse_pressure: vec![0.0; dilatation.count],
            coarse_volume,
            nodes,
            constants: Constants {
                law: *law,
                projected: kappa - pointwise,
                pointwise,
                resists_collapse: volume_ratio == VolumeRatio::Projected,
            },
            blocks,
        }
    }

    /// Lends the kernel's memory to a job.
    pub fn parts(&mut self) -> Parts<'_, T> {
        Parts {
            blocks: Dealt::new(&mut self.blocks),
            pressure: Dealt::new(&mut self.coarse_pressure),
            kernel: Fixed {
                node_shares: &self.node_shares,
                coarse_shares: &self.coarse_shares,
                coarse_volume: &self.coarse_volume,
                constants: self.constants,
            },
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

    fn block_of(&self, point: usize) -> usize {
        self.blocks.partition_point(|b| b.first_point <= point).saturating_sub(1)
    }

    /// Says which share of an integration point is tissue, 0 to 1; the rest carries no stress.
    pub fn set_active(&mut self, point: usize, share: f64) {
        let b = self.block_of(point);
        let b = &mut self.blocks[b];
        b.active[point - b.first_point] = T::of(share);
    }

    /// Makes every point tissue again.
    pub fn activate_all(&mut self) {
        self.blocks.iter_mut().for_each(|b| b.active.fill(T::of(1.0)));
    }

    /// Deformation gradient (row-major) of one integration point at the last evaluation.
    #[must_use]
    pub fn deformation(&self, point: usize) -> [f64; 9] {
        let b = &self.blocks[self.block_of(point)];
        gradient(&b.deformation[point - b.first_point]).map(Real::get)
    }

    /// Strain energy at the last evaluation, J.
    #[must_use]
    pub fn energy(&self) -> f64 {
        let projected: f64 = if self.constants.projected > 0.0 {
            let (kappa, volumetric) = (self.constants.projected, self.constants.law.volumetric);
            let density = |p: f64| kappa * volumetric.energy(volumetric.dilation(p / kappa));
            self.coarse_pressure.iter().zip(&self.coarse_volume).map(|(p, v)| v * density(*p)).sum()
        } else {
            0.0
        };
        self.blocks.iter().map(|b| b.energy).sum::<f64>() + projected
    }

    /// Calls `visit(point, F, P, V)` for every integration point of the last evaluation: deformation gradient and first
    /// Piola-Kirchhoff stress in Pa (row-major), volume in m^3.
    pub fn for_points(&self, mut visit: impl FnMut(usize, [f64; 9], [f64; 9], f64)) {
        for b in &self.blocks {
            let law = Relaxing { constants: &self.constants, memory: &b.memory };
            for p in 0..b.volume.len() {
                let f = gradient(&b.deformation[p]).map(Real::get);
                let (_, stress): (f64, _) = law.at(p, &f, b.projected_pressure(p).get());
                visit(b.first_point + p, f, stress, b.volume[p].get());
            }
        }
    }
}

impl<T: Real> Parts<'_, T> {
    /// Internal force for nodal parameters `u`. The caller must have passed a barrier since `u` was written; on return
    /// the blocks hold their forces and the team has passed a barrier.
    pub fn force(&self, team: &Team, u: &[[f64; 3]]) {
        let count = self.blocks.len();
        let constants = &self.kernel.constants;
        // SAFETY: each block is claimed by one thread between barriers.
        team.claim(count, |b| unsafe { self.blocks.get(b) }.deform(u));
        team.barrier();
        if constants.projected > 0.0 {
            team.claim(self.pressure.len().div_ceil(NODES_PER_DEAL), |deal| self.project(deal));
            team.barrier();
        }
        // SAFETY: as above; pressures are only read in this phase.
        team.claim(count, |b| unsafe { self.blocks.get(b).stress(self.pressure.read(), constants) });
        team.barrier();
    }

    fn project(&self, deal: usize) {
        let range = deal * NODES_PER_DEAL..((deal + 1) * NODES_PER_DEAL).min(self.pressure.len());
        // SAFETY: blocks are only read in this phase; each range of pressures is claimed by one thread.
        let (blocks, pressure) = unsafe { (self.blocks.read(), self.pressure.part(range.clone())) };
        for (p, out) in range.zip(pressure) {
            let shares = self.kernel.coarse_shares.of_index(p).iter();
            let dilation: f64 = shares.map(|&(b, l)| blocks[b as usize].coarse_dilation[l as usize]).sum();
            let volume = self.kernel.coarse_volume[p];
            let constants = &self.kernel.constants;
            *out = match constants.law.volumetric {
                _ if volume <= 0.0 => 0.0,
                Volumetric::Quadratic => constants.projected * dilation / volume,
                other => constants.projected * other.slope(dilation / volume),
            };
        }
    }

    /// Internal force on one node, N, after [`Parts::force`].
    ///
    /// # Safety
    /// Since the barrier that ends [`Parts::force`] no thread may have begun another evaluation.
    #[inline]
    pub unsafe fn node_force(&self, n: usize) -> [f64; 3] {
        // SAFETY: blocks are only read now, by the caller's promise.
        let blocks = unsafe { self.blocks.read() };
        let mut sum = [0.0; 3];
        for &(b, l) in self.kernel.node_shares.of_index(n) {
            let share = blocks[b as usize].force[l as usize];
            (0..3).for_each(|k| sum[k] += share[k].get());
        }
        sum
    }
}

/// The hoop strain of an axisymmetric field, sum_j u_r phi_j / r, comes out of the gather in the radial row; here it
/// takes its place on the diagonal. What shears the hoop direction is zero.
#[inline(always)]
fn hoop_to_diagonal<T: Real>(columns: &mut [[T; 4]; 3]) {
    columns[1] = [T::default(), columns[1][0], T::default(), T::default()];
}

/// And back: the hoop stress pushes its nodes outwards.
#[inline(always)]
fn hoop_to_radius<T: Real>(columns: &mut [[T; 4]; 3]) {
    columns[1] = [columns[1][1], T::default(), T::default(), T::default()];
}

/// Row-major F from its columns.
#[inline(always)]
pub(super) fn gradient<T: Real>(columns: &[[T; 4]; 3]) -> [T; 9] {
    std::array::from_fn(|i| columns[i % 3][i / 3])
}

impl<T: Real> Block<T> {
    /// Pass 1.
    fn deform(&mut self, u: &[[f64; 3]]) {
        // Relative to one of the block's own nodes: gradients of a constant vanish, and a rigid translation of the
        // whole sample costs no digits in single precision.
        let origin = u[self.nodes[0] as usize];
        match self.form {
            Form::Full => {
                for (local, &n) in self.u.iter_mut().zip(&self.nodes) {
                    let u = u[n as usize];
                    *local = [T::of(u[0] - origin[0]), T::of(u[1] - origin[1]), T::of(u[2] - origin[2]), T::default()];
                }
            }
            Form::Axisymmetric => self.copy_meridian(u, origin[2]),
        }
        self.dilation.fill(T::default());
        T::dispatch_deform(self);
        if !self.coarse.is_empty() {
            self.coarse_dilation.fill(0.0);
            for a in 0..self.nodes.len() {
                let dilation = self.dilation[a].get();
                for e in self.coarse_start[a] as usize..self.coarse_start[a + 1] as usize {
                    self.coarse_dilation[self.coarse_local[e] as usize] += self.coarse_value[e] * dilation;
                }
            }
        }
    }

    /// Displacements of nodes and images of a half plane: only a motion along the axis is rigid, so u_r stays absolute.
    fn copy_meridian(&mut self, u: &[[f64; 3]], origin: f64) {
        for (l, (local, &n)) in self.u.iter_mut().zip(&self.nodes).enumerate() {
            let [radial, _, axial] = u[n as usize];
            let radial = if l < self.originals { radial } else { -radial };
            *local = [T::of(radial), T::default(), T::of(axial - origin), T::default()];
        }
    }

    /// The loop over points of pass 1.
    #[inline(always)]
    pub(super) fn deform_points<const AXISYMMETRIC: bool>(&mut self) {
        let one = T::of(1.0);
        let share_of_corner = if AXISYMMETRIC { T::of(1.0 / 3.0) } else { T::of(0.25) };
        let mut min = T::of(f64::MAX);
        for p in 0..self.volume.len() {
            if AXISYMMETRIC && self.active[p] == T::default() {
                // the needle's, not the tissue's: nothing reads it but what is shown
                self.deformation[p] = UNDEFORMED.map(|column| column.map(T::of));
                continue;
            }
            let range = self.start[p] as usize..self.start[p + 1] as usize;
            let mut columns = T::gather(&self.local[range.clone()], &self.gradient[range], &self.u);
            if AXISYMMETRIC {
                hoop_to_diagonal(&mut columns);
            }
            for k in 0..3 {
                columns[k][k] += one;
            }
            self.deformation[p] = columns;
            let f = gradient(&columns);
            let j = determinant(&f, &cofactor(&f));
            let active = self.active[p];
            // a NaN does not survive this comparison; the energy of pass 2 keeps it
            min = if j < min && active > T::default() { j } else { min };
            let share = share_of_corner * active * self.volume[p] * (j - one);
            for &c in &self.corners[p][..if AXISYMMETRIC { 3 } else { 4 }] {
                self.dilation[c as usize] += share;
            }
        }
        self.min_jacobian = min.get();
    }

    /// Pass 2.
    fn stress(&mut self, coarse_pressure: &[f64], constants: &Constants) {
        if !self.coarse.is_empty() {
            for a in 0..self.nodes.len() {
                let entries = self.coarse_start[a] as usize..self.coarse_start[a + 1] as usize;
                let p: f64 = entries
                    .map(|e| {
                        self.coarse_value[e] * coarse_pressure[self.coarse[self.coarse_local[e] as usize] as usize]
                    })
                    .sum();
                self.pressure[a] = T::of(p);
            }
        }
        self.force.fill([T::default(); 4]);
        // the usual law has a loop of its own, with no choices in it
        if let Some(plain) = constants.plain() {
            T::dispatch_stress(self, &plain);
        } else {
            let memory = std::mem::take(&mut self.memory);
            T::dispatch_stress(self, &Relaxing { constants, memory: &memory });
            self.energy += memory.offset;
            self.memory = memory;
        }
        // what pulls an image outwards pulls its node the other way
        for force in &mut self.force[self.originals..] {
            force[0] = -force[0];
        }
    }

    #[inline(always)]
    pub(super) fn projected_pressure(&self, p: usize) -> T {
        let c = self.corners[p].map(|c| self.pressure[c as usize]);
        match self.form {
            Form::Full => T::of(0.25) * ((c[0] + c[1]) + (c[2] + c[3])),
            Form::Axisymmetric => T::of(1.0 / 3.0) * ((c[0] + c[1]) + c[2]),
        }
    }

    /// The loop over points of pass 2, in runs: the law of one point waits for itself most of the time, so those of a run
    /// are evaluated side by side before their stress is spread.
    #[inline(always)]
    pub(super) fn stress_points<L: PointLaw<T>, const AXISYMMETRIC: bool>(&mut self, law: &L) {
        let mut energy = T::default();
        let mut stress = [[[T::default(); 4]; 3]; RUN];
        let count = self.volume.len();
        for first in (0..count).step_by(RUN) {
            let run = first..(first + RUN).min(count);
            for (columns, p) in stress.iter_mut().zip(run.clone()) {
                let volume = self.active[p] * self.volume[p];
                if volume == T::default() {
                    continue;
                }
                let f = gradient(&self.deformation[p]);
                let (density, s) = law.at(p, &f, self.projected_pressure(p));
                energy += volume * density;
                *columns = std::array::from_fn(|k| [volume * s[k], volume * s[3 + k], volume * s[6 + k], T::default()]);
                if AXISYMMETRIC {
                    hoop_to_radius(columns);
                }
            }
            for (columns, p) in stress.iter().zip(run) {
                if self.active[p] * self.volume[p] == T::default() {
                    continue;
                }
                let range = self.start[p] as usize..self.start[p + 1] as usize;
                T::scatter(&self.local[range.clone()], &self.gradient[range], columns, &mut self.force);
            }
        }
        self.energy = energy.get();
    }
}

/// sum_j u_j (x) grad phi_j by columns. Two sets of accumulators hide the latency of the additions.
#[inline(always)]
pub(super) fn gather<T: Real>(local: &[u16], gradient: &[[T; 3]], u: &[[T; 4]]) -> [[T; 4]; 3] {
    let mut sets = [[[T::default(); 4]; 3]; 2];
    for (e, (l, g)) in local.iter().zip(gradient).enumerate() {
        accumulate(&mut sets[e % 2], &u[usize::from(*l)], g);
    }
    std::array::from_fn(|k| std::array::from_fn(|i| sets[0][k][i] + sets[1][k][i]))
}

/// f_j += V P grad phi_j, with V P by columns.
#[inline(always)]
pub(super) fn scatter<T: Real>(local: &[u16], gradient: &[[T; 3]], columns: &[[T; 4]; 3], force: &mut [[T; 4]]) {
    for (l, g) in local.iter().zip(gradient) {
        let force = &mut force[usize::from(*l)];
        for i in 0..4 {
            force[i] = columns[0][i].fma(g[0], columns[1][i].fma(g[1], columns[2][i].fma(g[2], force[i])));
        }
    }
}

#[inline(always)]
fn accumulate<T: Real>(columns: &mut [[T; 4]; 3], u: &[T; 4], g: &[T; 3]) {
    for k in 0..3 {
        for i in 0..4 {
            columns[k][i] = u[i].fma(g[k], columns[k][i]);
        }
    }
}
