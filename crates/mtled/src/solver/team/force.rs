//! Internal force of eight members at once: the [kernel](super::super::kernel)'s two passes with members in the lanes.

use std::sync::Arc;

use super::super::block::Block;
use super::super::kernel::{Kernel, Points, Tables};
use super::super::mixed::Mixed;
use super::super::points::{AnyShape, Constants, LaneLaw, NeoHookean, WithVolume};
use super::super::strip::FIELDS;
use super::passes::{Bound, Deform, Laws, Stress, Vectors, components, dimensions};
use super::projection::Projected;
use super::table::PointTable;
use super::transfer::{Load, Store, SumLanes, mirrored};
use crate::approximation::Form;
use crate::material::Volumetric;
use crate::number::{LANES, Lanes, Number, Real, run, run_pass};

/// What the members of a team have in common: the points of each block.
#[derive(Debug)]
pub(super) struct Common<T: Real> {
    tables: Arc<Tables<T>>,
    points: Vec<PointTable<T>>,
}

/// Laws of the members, and the memory of an evaluation.
#[derive(Debug)]
pub(super) struct Lockstep<T: Real> {
    /// Further teams of the same cloud can share it.
    pub(super) common: Arc<Common<T>>,
    laws: Vec<OfRegion<T>>,
    /// At which of its changes a member's shares of the points were taken over.
    seen: [Option<u64>; LANES],
    /// Share of each point that is tissue, by block.
    active: Vec<Vec<Lanes<T>>>,
    /// Of each point, by block, its [`components`].
    deformation: Vec<Vec<Lanes<T>>>,
    /// V (J - 1) at all vertices, m^3, and V (I1 - 3) where the law is [mixed](super::super::mixed).
    sums: [Vec<Lanes<T>>; FIELDS],
    /// Pressure at all vertices, Pa, and r - 1.
    coarse: [Vec<Lanes<T>>; FIELDS],
    projection: Projected<T>,
    min_jacobian: Lanes<T>,
    /// Of each block, J.
    energy: Vec<Lanes<T>>,
    /// Of one block at a time: displacements, what is at its vertices, and forces by lane of the groups; of vectors their [`dimensions`].
    local_u: Vec<Lanes<T>>,
    at_vertices: [Vec<Lanes<T>>; FIELDS],
    local_force: Vec<Lanes<T>>,
    /// Of each block on each of its nodes, block after block, N.
    force: Vec<Vectors<T>>,
}

/// Laws of the members in one region: one law, each with its own constants.
#[derive(Debug)]
enum OfRegion<T: Real> {
    Plain(Laws<NeoHookean<T>>),
    Mixed(Laws<Mixed<T>>),
    Other(Laws<WithVolume<AnyShape<T>, T>>),
}

/// `with_laws!((of_region) => (laws) { ... })`: the body for the law that they have.
macro_rules! with_laws {
    (($any:expr) => ($laws:ident) $body:expr) => {
        match $any {
            OfRegion::Plain($laws) => $body,
            OfRegion::Mixed($laws) => $body,
            OfRegion::Other($laws) => $body,
        }
    };
}

impl<T: Real> OfRegion<T> {
    /// Of the members' constants; `None` where their laws differ or one has no team.
    fn new(constants: &[Constants; LANES]) -> Option<Self> {
        // the projection of a team knows no other energy of volume
        let with_team = |c: &Constants| c.law.volumetric == Volumetric::Quadratic && c.law.prony.is_empty();
        if !constants.iter().all(with_team) {
            return None;
        }
        if constants[0].mixed {
            return of_each(constants, Constants::of_mixed).map(Self::Mixed);
        }
        if constants[0].plain::<T>().is_some() {
            return of_each(constants, |c| c.plain().filter(|_| !c.mixed)).map(Self::Plain);
        }
        let is_alike = |c: &Constants| !c.mixed && c.law.distortional.is_like(&constants[0].law.distortional);
        of_each(constants, |c| c.volume().filter(|_| is_alike(c)).map(|volume| WithVolume { shape: c.shape(), volume }))
            .map(Self::Other)
    }
}

/// One law of each member.
fn of_each<L>(constants: &[Constants; LANES], law: impl Fn(&Constants) -> Option<L>) -> Option<Laws<L>> {
    let laws: Vec<L> = constants.iter().map(law).collect::<Option<_>>()?;
    laws.try_into().ok().map(Laws)
}

/// By region; a place without a kernel has the last one's.
fn of_regions<T: Real>(kernels: &[&Kernel<T>]) -> Option<Vec<OfRegion<T>>> {
    let last = kernels.len() - 1;
    let region = |r: usize| OfRegion::new(&std::array::from_fn(|lane| kernels[lane.min(last)].constants[r]));
    (0..kernels.first()?.constants.len()).map(region).collect()
}

impl<T: Real> Common<T> {
    pub(super) fn new(kernel: &Kernel<T>) -> Self {
        Self { tables: Arc::clone(&kernel.tables), points: kernel.tables.blocks.iter().map(PointTable::new).collect() }
    }
}

impl<T: Real> Lockstep<T> {
    /// Of up to eight kernels on one set of tables; `None` where they aren't, or where a law has no team.
    pub(super) fn new(kernels: &[&Kernel<T>], common: Option<Arc<Common<T>>>) -> Option<Self> {
        let first = kernels.first()?;
        let common = common.filter(|c| Arc::ptr_eq(&c.tables, &first.tables));
        let alike = kernels.len() <= LANES && kernels.iter().all(|k| Arc::ptr_eq(&k.tables, &first.tables));
        let laws = of_regions(kernels).filter(|_| alike)?;
        let is_mixed = |laws: &OfRegion<T>| matches!(laws, OfRegion::Mixed(_));
        let mixed = laws.iter().any(is_mixed);
        if mixed && !laws.iter().all(is_mixed) {
            return None;
        }
        let fields = |of: usize| [true, mixed].map(|there| vec![Lanes::default(); if there { of } else { 0 }]);
        let common = common.unwrap_or_else(|| Arc::new(Common::new(first)));
        let (tables, points) = (&common.tables, &common.points);
        let zero = Lanes::default();
        let constants: Vec<Vec<Constants>> = kernels.iter().map(|k| k.constants.clone()).collect();
        let vertices = tables.dilation_shares.start.len() - 1;
        let most = |size: fn(&Block<T>) -> usize| tables.blocks.iter().map(size).max().unwrap_or(0);
        let planar = tables.blocks.first().is_some_and(is_planar);
        let nodes = dimensions(planar) * most(|b| b.nodes.len());
        Some(Self {
            seen: [None; LANES],
            laws,
            active: points.iter().map(|p| vec![Lanes::of(1.0); p.len()]).collect(),
            deformation: points.iter().map(|p| vec![zero; components(planar) * p.len()]).collect(),
            sums: fields(vertices),
            coarse: fields(vertices),
            projection: Projected::new(&tables.projection, &constants, mixed),
            min_jacobian: Lanes::of(1.0),
            energy: vec![zero; points.len()],
            local_u: vec![zero; nodes],
            local_force: vec![zero; LANES * nodes],
            force: vec![[zero; 3]; tables.force_runs.total()],
            at_vertices: fields(most(|b| b.vertices.len())),
            common,
        })
    }

    /// Takes over which share of each point is tissue to a member.
    pub(super) fn set_active(&mut self, member: usize, points: &Points<T>) {
        let Self { common, active, seen, .. } = self;
        if let Some(changed) = seen[member].replace(points.changes).and_then(|before| points.since(before)) {
            for point in changed {
                let (b, slot) = common.tables.slot[point];
                let of_block = &points.active[b as usize];
                if let Ok(at) = common.points[b as usize].slot.binary_search(&slot) {
                    active[b as usize][at].0[member] = of_block[slot as usize / LANES].0[slot as usize % LANES];
                }
            }
            return;
        }
        for ((active, table), of_block) in active.iter_mut().zip(&common.points).zip(&points.active) {
            for (active, &slot) in active.iter_mut().zip(&table.slot) {
                active.0[member] = of_block[slot as usize / LANES].0[slot as usize % LANES];
            }
        }
    }

    /// Smallest volume ratio of a member's points at the last evaluation.
    pub(super) fn min_jacobian(&self, member: usize) -> f64 {
        self.min_jacobian.0[member].get()
    }

    /// Strain energy of a member at the last evaluation, J.
    pub(super) fn energy(&self, member: usize) -> f64 {
        self.energy.iter().map(|e| e.0[member].get()).sum::<f64>() + self.projection.energy.0[member]
    }

    /// First half of an evaluation, for each member's nodal parameters, m: deformation gradients, and pressures.
    pub(super) fn deform(&mut self, u: &[&[[f64; 3]]; LANES]) {
        self.gather(u);
        let Self { common, sums, coarse, projection, .. } = self;
        projection.project(&common.tables.projection, sums, coarse);
    }

    /// Second half: internal force of each member, N.
    pub(super) fn force(&mut self, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        let common = Arc::clone(&self.common);
        for (b, block) in common.tables.blocks.iter().enumerate() {
            self.load_coarse(b);
            self.stress(b);
            mirror_back(block, self.sum_lanes(b));
        }
        self.store(f);
    }

    /// Shares of the masses, over s, at the last evaluation, in the first component of `f`.
    pub(super) fn bound(&mut self, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        for b in 0..self.common.points.len() {
            self.load_coarse(b);
            let block = &self.common.tables.blocks[b];
            let region = usize::from(block.region);
            let Self { common, laws, deformation, at_vertices, local_force, .. } = self;
            let coarse = at_vertices.each_ref().map(Vec::as_slice);
            let (table, deformation, force) = (&common.points[b], &deformation[b][..], &mut local_force[..]);
            let planar = is_planar(&common.tables.blocks[b]);
            with_laws!((&laws[region]) => (laws) bound(planar, table, laws, deformation, coarse, force));
            self.sum_lanes(b);
        }
        self.store(f);
    }

    /// Sums of the blocks on each node, to each member.
    fn store(&self, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        run(Store { shares: &self.common.tables.force_shares, from: &self.force, to: f });
    }

    /// Adds up what the lanes of a block's groups have added to its nodes.
    fn sum_lanes(&mut self, b: usize) -> &mut [Vectors<T>] {
        let to = &mut self.force[self.common.tables.force_runs.run(b)];
        let from = &mut self.local_force[..];
        match is_planar(&self.common.tables.blocks[b]) {
            true => run(SumLanes::<_, 2> { from, to }),
            false => run(SumLanes::<_, 3> { from, to }),
        }
        to
    }

    /// Pass 1 over all blocks.
    fn gather(&mut self, u: &[&[[f64; 3]]; LANES]) {
        self.sums.iter_mut().for_each(|sums| sums.fill(Lanes::default()));
        self.min_jacobian = Lanes::of(f64::MAX);
        for b in 0..self.common.points.len() {
            let Self { common, active, deformation, sums, min_jacobian, local_u, at_vertices, .. } = self;
            let block = &common.tables.blocks[b];
            run(Load { block, from: u, to: local_u });
            for here in at_vertices.iter_mut() {
                here.iter_mut().take(block.vertices.len()).for_each(|here| *here = Lanes::default());
            }
            let here = at_vertices.each_mut().map(Vec::as_mut_slice);
            let (table, active, u, deformation) =
                (&common.points[b], &active[b][..], &local_u[..], &mut deformation[b][..]);
            match is_planar(block) {
                true => run_pass(Deform::<_, true> { table, active, u, deformation, sums: here, min: min_jacobian }),
                false => run_pass(Deform::<_, false> { table, active, u, deformation, sums: here, min: min_jacobian }),
            }
            for (sums, here) in sums.iter_mut().zip(&*at_vertices).filter(|(sums, _)| !sums.is_empty()) {
                for (&n, here) in block.vertices.iter().zip(here) {
                    sums[n as usize] += *here;
                }
            }
        }
    }

    fn load_coarse(&mut self, b: usize) {
        let vertices = &self.common.tables.blocks[b].vertices;
        for (here, coarse) in self.at_vertices.iter_mut().zip(&self.coarse) {
            here.iter_mut().zip(vertices).for_each(|(here, &n)| *here = coarse[n as usize]);
        }
    }

    /// Pass 2 over one block.
    fn stress(&mut self, b: usize) {
        let region = usize::from(self.common.tables.blocks[b].region);
        // taken out for as long as they are read
        let laws = std::mem::take(&mut self.laws);
        with_laws!((&laws[region]) => (laws) self.stress_by(b, laws));
        self.laws = laws;
    }

    fn stress_by<L: LaneLaw<T>>(&mut self, b: usize, laws: &Laws<L>) {
        let Self { common, active, deformation, at_vertices, local_force, energy, .. } = self;
        let block = &common.tables.blocks[b];
        let (table, active, coarse) = (&common.points[b], &active[b][..], at_vertices.each_ref().map(Vec::as_slice));
        let (deformation, force, energy) = (&deformation[b][..], &mut local_force[..], &mut energy[b]);
        match is_planar(block) {
            true => run_pass(Stress::<_, _, true> { table, laws, active, deformation, coarse, force, energy }),
            false => run_pass(Stress::<_, _, false> { table, laws, active, deformation, coarse, force, energy }),
        }
    }
}

/// Shares of the masses of a block's points.
fn bound<T: Real, L: LaneLaw<T>>(
    planar: bool,
    table: &PointTable<T>,
    laws: &Laws<L>,
    deformation: &[Lanes<T>],
    coarse: [&[Lanes<T>]; FIELDS],
    force: &mut [Lanes<T>],
) {
    if planar {
        run_pass(Bound::<_, _, true> { table, laws, deformation, coarse, force });
    } else {
        run_pass(Bound::<_, _, false> { table, laws, deformation, coarse, force });
    }
}

/// Whether a block is of a half plane.
fn is_planar<T: Real>(block: &Block<T>) -> bool {
    matches!(block.form, Form::Axisymmetric)
}

/// What pulls an image pulls its node the mirrored way.
fn mirror_back<T: Real>(block: &Block<T>, force: &mut [Vectors<T>]) {
    for force in &mut force[block.originals..] {
        match block.form {
            Form::Mirrored(mirror) => *force = mirrored(&mirror, &force.map(Lanes::wide)).map(Lanes::narrow),
            Form::Full | Form::Axisymmetric => force[0] = -force[0],
        }
    }
}
