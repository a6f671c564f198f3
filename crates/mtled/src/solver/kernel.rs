//! Internal force of the total Lagrangian formulation, in two passes over the blocks:
//!
//! ```text
//! pass 1   F = I + sum_j u_j (x) grad phi_j,   J = det F,   dilation summed to nodes, then to coarse pressure nodes
//! pass 2   p from the coarse pressures,        f_j += V P(F, p) grad phi_j
//! ```
//!
//! Pass 2 is the exact derivative of the energy that pass 1 defines (see [`super::dilatation`]), so the force is
//! conservative. With the pointwise volume ratio p = kappa u'(J_g) and the coarse nodes are idle.

use std::sync::Arc;

use super::VolumeRatio;
use crate::approximation::ShapeTable;
use crate::material::Law;
use crate::material::neo_hookean::Gradient;

use super::block::{Block, BlockScratch, ForceOfLane};
use super::dilatation::Dilatation;
use super::disjoint::{Chunks, Each, NODES_PER_CHUNK, Offsets, Runs};
use super::memory::{Memory, Relaxing};
use super::points::{Constants, Projected};
use super::pool::Pool;
use super::projection::{Projection, ProjectionScratch};
use super::strip::FIELDS;
use super::vertices::Vertices;
use crate::number::{LANES, Lanes, Number, Real};
use crate::shares::Shares;

/// Internal-force kernel of one model: what never changes.
#[derive(Debug)]
pub struct Kernel<T: Real> {
    pub(super) tables: Arc<Tables<T>>,
    /// Of the material of each region.
    pub(super) constants: Vec<Constants>,
}

/// What a shape table makes of a kernel, whatever the materials: the largest part of a model, shared by those of one cloud.
#[derive(Debug)]
pub(super) struct Tables<T: Real> {
    pub blocks: Vec<Block<T>>,
    /// Block and slot of each integration point.
    pub slot: Vec<(u32, u32)>,
    /// Where each block's forces begin among those of all, and which of them are a node's.
    pub force_runs: Offsets,
    pub force_shares: Shares,
    /// The same of the dilations.
    dilation_runs: Offsets,
    pub dilation_shares: Shares,
    pub projection: Projection<T>,
    pub nodes: usize,
    volume_ratio: VolumeRatio,
}

/// What a displacement field costs and exerts.
#[derive(Clone, Debug)]
pub struct InternalForce {
    /// On each node, N.
    pub force: Vec<[f64; 3]>,
    /// Strain energy, J.
    pub energy: f64,
    /// Deformation gradient of each integration point.
    pub deformation: Vec<Gradient<f64>>,
}

/// What a state says of the integration points.
#[derive(Debug)]
pub(super) struct Points<T> {
    /// Share of each point that is tissue, by block and group: 1, or less where a needle fills its cell.
    pub(super) active: Vec<Vec<Lanes<T>>>,
    /// How often that has changed.
    pub(super) changes: u64,
    /// Points of the last changes, each at its number over the length.
    pub(super) recent: [u32; RECENT],
}

/// Changes that are known one by one: some poses' of a needle.
const RECENT: usize = 64;

impl<T: Real> Points<T> {
    /// All of them tissue again.
    pub(super) fn fill(&mut self) {
        self.active.iter_mut().for_each(|active| active.fill(Lanes::of(1.0)));
        self.changes += RECENT as u64 + 1;
    }

    /// Points whose share may have changed since there were so many changes; `None`: any.
    pub(super) fn since(&self, changes: u64) -> Option<impl Iterator<Item = usize> + '_> {
        let known = self.changes.checked_sub(changes).is_some_and(|new| new <= RECENT as u64);
        known.then(|| (changes..self.changes).map(|c| self.recent[c as usize % RECENT] as usize))
    }
}

impl<T: Clone> Clone for Points<T> {
    fn clone(&self) -> Self {
        Self { active: self.active.clone(), changes: self.changes, recent: self.recent }
    }

    fn clone_from(&mut self, other: &Self) {
        self.active.clone_from(&other.active);
        // more than are known one by one
        self.changes += RECENT as u64 + 1;
    }
}

/// Scratch memory of an evaluation, and what the last one left there.
#[derive(Debug)]
pub(super) struct Scratch<T: Real> {
    blocks: Vec<BlockScratch<T>>,
    /// Internal force of each block on each of its nodes, block after block, N.
    force: Vec<[T; 3]>,
    /// V (J - 1) of each block at each of its vertices, block after block, m^3, and V (I1 - 3) where the law is [mixed](super::mixed): a
    /// corner adds to both at once.
    strained: Vec<[T; FIELDS]>,
    projection: ProjectionScratch<T>,
    /// Of each thread.
    lanes: Vec<ForceOfLane<T>>,
}

impl<T: Real> Tables<T> {
    fn constants(&self, laws: &[Law]) -> Vec<Constants> {
        laws.iter().map(|law| Constants::new(law, self.volume_ratio)).collect()
    }
}

impl<T: Real> Kernel<T> {
    /// Prepares the blocks of a shape table, with the law of each region.
    #[must_use]
    pub fn of_materials(
        table: &ShapeTable,
        cells: &[[u32; 4]],
        points: &[[f64; 3]],
        laws: &[Law],
        volume_ratio: VolumeRatio,
    ) -> Self {
        let nodes = points.len();
        let vertices = Vertices::new(cells, &table.region, nodes);
        let places = vertices.places(points);
        let dilatation = match volume_ratio {
            VolumeRatio::Projected | VolumeRatio::Mixed => {
                Dilatation::projected(&places, &vertices.cells, &vertices.region, table.form)
            }
            VolumeRatio::Averaged => Dilatation::nodal(&vertices.region),
            VolumeRatio::Pointwise => Dilatation { start: vec![0; places.len() + 1], ..Dilatation::default() },
        };
        let blocks = Block::partition(table, &vertices, &places, nodes);
        let mut slot = vec![(0, 0); table.volume.len()];
        for (b, block) in blocks.iter().enumerate() {
            block.occupied().for_each(|(s, point)| slot[point] = (b as u32, s as u32));
        }
        let tables = Tables {
            force_runs: Offsets::of(blocks.iter().map(|b| b.nodes.len())),
            force_shares: Shares::of(blocks.iter().map(|b| b.nodes.as_slice()), nodes),
            dilation_runs: Offsets::of(blocks.iter().map(|b| b.vertices.len())),
            dilation_shares: Shares::of(blocks.iter().map(|b| b.vertices.as_slice()), places.len()),
            projection: Projection::new(&dilatation, table, &vertices.cells, places.len()),
            nodes,
            volume_ratio,
            slot,
            blocks,
        };
        Self { constants: tables.constants(laws), tables: Arc::new(tables) }
    }

    /// The same of other materials, on the same tables.
    pub(super) fn with_laws(&self, laws: &[Law]) -> Self {
        Self { constants: self.tables.constants(laws), tables: Arc::clone(&self.tables) }
    }

    /// Material of a block.
    pub(super) fn of(&self, block: &Block<T>) -> &Constants {
        &self.constants[usize::from(block.region)]
    }

    /// Whether any material has a projected pressure.
    fn projects(&self) -> bool {
        self.constants.iter().any(|c| c.projected > 0.0)
    }

    /// Whether any material's distortion sees the projected volume ratio.
    fn mixes(&self) -> bool {
        self.constants.iter().any(|c| c.mixed)
    }

    /// All points tissue.
    pub(super) fn points(&self) -> Points<T> {
        let active = self.tables.blocks.iter().map(|b| vec![Lanes::of(1.0); b.volume.len()]).collect();
        Points { active, changes: 0, recent: [0; RECENT] }
    }

    /// What a material that relaxes remembers at first, by block.
    pub(super) fn memory(&self) -> Vec<Memory> {
        self.tables.blocks.iter().map(|b| Memory::new(&self.of(b).law.prony, b.volume.len(), b.form)).collect()
    }

    /// Scratch memory for a team of so many threads.
    pub(super) fn scratch(&self, threads: usize) -> Scratch<T> {
        let most = self.tables.blocks.iter().map(|b| b.nodes.len()).max().unwrap_or(0);
        Scratch {
            blocks: self.tables.blocks.iter().map(|b| BlockScratch::new(b, self.of(b).mixed)).collect(),
            force: vec![[T::default(); 3]; self.tables.force_runs.total()],
            strained: vec![[T::default(); FIELDS]; self.tables.dilation_runs.total()],
            projection: self.tables.projection.scratch(self.mixes()),
            lanes: vec![vec![Default::default(); most]; threads.max(1)],
        }
    }

    /// Says which share of an integration point is tissue, 0 to 1; the rest carries no stress.
    pub(super) fn set_active(&self, points: &mut Points<T>, point: usize, share: f64) {
        let (b, s) = self.tables.slot[point];
        points.active[b as usize][s as usize / LANES].0[s as usize % LANES] = T::of(share);
        points.recent[points.changes as usize % RECENT] = point as u32;
        points.changes += 1;
    }

    /// Smallest volume ratio of any integration point at the last evaluation.
    pub(super) fn min_jacobian(&self, scratch: &Scratch<T>) -> f64 {
        scratch.blocks.iter().map(|b| b.min_jacobian).fold(f64::INFINITY, f64::min)
    }

    /// Deformation gradient (row-major) of one integration point at the last evaluation.
    pub(super) fn deformation(&self, scratch: &Scratch<T>, point: usize) -> Gradient<f64> {
        let (b, s) = self.tables.slot[point];
        scratch.blocks[b as usize].deformation_in(s as usize)
    }

    /// Strain energy at the last evaluation, J.
    pub(super) fn energy(&self, scratch: &Scratch<T>) -> f64 {
        let projected =
            if self.projects() { self.tables.projection.energy(&scratch.projection, &self.constants) } else { 0.0 };
        scratch.blocks.iter().map(|b| b.energy).sum::<f64>() + projected
    }

    /// Strain energy that stands in one integration point at the last evaluation, without the projected volumetric part, J.
    pub(super) fn energy_of(&self, memory: &[Memory], scratch: &Scratch<T>, point: usize) -> f64 {
        let (b, slot) = self.tables.slot[point];
        let (b, slot) = (b as usize, slot as usize);
        let law = Relaxing { constants: self.of(&self.tables.blocks[b]), memory: &memory[b] };
        let (density, _) = law.evaluate(slot, &scratch.blocks[b].deformation_in(slot), Projected::default());
        density * self.tables.blocks[b].volume_in(slot)
    }

    /// Calls `visit(point, F, P, V)` for every integration point of the last evaluation: deformation gradient and first
    /// Piola-Kirchhoff stress in Pa (row-major), volume in m^3.
    pub(super) fn for_points(
        &self,
        memory: &[Memory],
        scratch: &Scratch<T>,
        mut visit: impl FnMut(usize, Gradient<f64>, Gradient<f64>, f64),
    ) {
        for ((block, scratch), memory) in self.tables.blocks.iter().zip(&scratch.blocks).zip(memory) {
            let law = Relaxing { constants: self.of(block), memory };
            for (slot, point) in block.occupied() {
                let f = scratch.deformation_in(slot);
                let (_, stress) = law.evaluate(slot, &f, block.projected_in(scratch, slot));
                visit(point, f, stress, block.volume_in(slot));
            }
        }
    }

    /// Internal force for nodal parameters `u`, m: the scratch memory holds the blocks' forces afterwards.
    pub(super) fn force(
        &self,
        points: &Points<T>,
        memory: &[Memory],
        scratch: &mut Scratch<T>,
        pool: &mut Pool,
        u: &[[f64; 3]],
    ) {
        let active = &points.active;
        let Tables { blocks, projection, dilation_runs: runs, dilation_shares: shares, .. } = &*self.tables;
        let deform = (Each::new(&mut scratch.blocks), Runs::new(&mut scratch.strained, runs));
        let mixed = self.mixes();
        pool.each(deform, |b, (scratch, strained)| blocks[b].deform(&active[b], u, mixed, scratch, strained));
        let strained = &scratch.strained;
        // of all cells at a node, m^3
        let sum = |n: usize| {
            let mut sum = [T::default(); FIELDS];
            for &at in shares.of_index(n) {
                sum.iter_mut().zip(strained[at as usize]).for_each(|(sum, share)| *sum += share);
            }
            sum
        };
        let projected: [&[T]; FIELDS] = if mixed {
            projection.project_mixed(&mut scratch.projection, pool, &self.constants, sum)
        } else if self.projects() {
            projection.project(&mut scratch.projection, pool, &self.constants, |n| sum(n)[0])
        } else {
            [&[]; FIELDS]
        };
        let blocks = (Each::new(&mut scratch.blocks), Runs::new(&mut scratch.force, &self.tables.force_runs));
        pool.each_with(&mut scratch.lanes, blocks, |lanes, i, (scratch, force)| {
            let block = &self.tables.blocks[i];
            block.stress(&active[i], &memory[i], projected, self.of(block), scratch, lanes, force);
        });
    }

    /// Shares of the masses, over s (see [`super::mass`]), in the first component of the forces.
    pub(super) fn bound(&self, memory: &[Memory], scratch: &mut Scratch<T>, pool: &mut Pool) {
        let blocks = (Each::new(&mut scratch.blocks), Runs::new(&mut scratch.force, &self.tables.force_runs));
        pool.each_with(&mut scratch.lanes, blocks, |lanes, i, (scratch, force)| {
            let block = &self.tables.blocks[i];
            block.bound(&memory[i], self.of(block), scratch, lanes, force);
        });
    }

    /// Internal force on one node, N, after [`Kernel::force`].
    #[inline]
    pub(super) fn node_force(&self, scratch: &Scratch<T>, n: usize) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for &at in self.tables.force_shares.of_index(n) {
            let share = scratch.force[at as usize];
            (0..3).for_each(|k| sum[k] += share[k].get());
        }
        sum
    }

    /// The same on every node.
    pub(super) fn node_forces(&self, scratch: &Scratch<T>, pool: &mut Pool, out: &mut [[f64; 3]]) {
        pool.each(Chunks::new(out, NODES_PER_CHUNK), |i, out| {
            for (out, n) in out.iter_mut().zip(i * NODES_PER_CHUNK..) {
                *out = self.node_force(scratch, n);
            }
        });
    }

    /// Fixes what every point remembers for an increment of `dt` seconds.
    pub(super) fn begin(&self, memory: &mut [Memory], pool: &mut Pool, dt: f64) {
        pool.each(Each::new(memory), |b, memory| memory.begin(&self.of(&self.tables.blocks[b]).law.prony, dt));
    }

    /// Takes the deformation of the last evaluation into what every point remembers.
    pub(super) fn commit(
        &self,
        points: &Points<T>,
        memory: &mut [Memory],
        scratch: &Scratch<T>,
        pool: &mut Pool,
        dt: f64,
    ) {
        pool.each(Each::new(memory), |b, memory| {
            let block = &self.tables.blocks[b];
            memory.commit(block, &points.active[b], &scratch.blocks[b], self.of(block), dt);
        });
    }

    /// Evaluates one displacement field, nodal parameters `u` in m, without a solver. For tests and studies: allocates.
    ///
    /// Two evaluations at once need two pools: a pool is borrowed for as long as its threads work.
    ///
    /// ```compile_fail,E0499
    /// # fn at_once(kernel: &mtled::solver::Kernel<f64>, pool: &mut mtled::solver::Pool, u: &[[f64; 3]]) {
    /// std::thread::scope(|s| {
    ///     s.spawn(|| kernel.internal_force(pool, u));
    ///     s.spawn(|| kernel.internal_force(pool, u));
    /// });
    /// # }
    /// ```
    #[must_use]
    pub fn internal_force(&self, pool: &mut Pool, u: &[[f64; 3]]) -> InternalForce {
        let mut scratch = self.scratch(pool.threads());
        self.force(&self.points(), &self.memory(), &mut scratch, pool, u);
        InternalForce {
            force: (0..self.tables.nodes).map(|n| self.node_force(&scratch, n)).collect(),
            energy: self.energy(&scratch),
            deformation: (0..self.tables.slot.len()).map(|p| self.deformation(&scratch, p)).collect(),
        }
    }
}
