//! Internal force of eight members at once: the [kernel](super::super::kernel)'s two passes with members in the lanes.

use std::sync::Arc;

use super::super::block::Block;
use super::super::kernel::{Kernel, Points, Tables};
use super::super::points::Constants;
use super::super::pool::Pool;
use super::super::projection::ProjectionScratch;
use super::passes::{Bound, Deform, Laws, Stress, Vectors};
use super::table::PointTable;
use crate::approximation::Form;
use crate::material::neo_hookean::Gradient;
use crate::mirror::Mirror;
use crate::number::lanes::{LANES, Lanes, run};
use crate::number::{Number, Real};

/// What the members of a team have in common: the points of each block.
#[derive(Debug)]
pub struct Common<T: Real> {
    tables: Arc<Tables<T>>,
    points: Vec<PointTable<T>>,
}

/// Laws of the members, and the memory of an evaluation.
#[derive(Debug)]
pub struct Lockstep<T: Real> {
    common: Arc<Common<T>>,
    members: usize,
    /// Of each region.
    laws: Vec<Laws<T>>,
    /// Of each member by region.
    constants: Vec<Vec<Constants>>,
    /// At which of its changes a member's shares of the points were taken over.
    seen: [Option<u64>; LANES],
    /// Share of each point that is tissue, by block.
    active: Vec<Vec<Lanes<T>>>,
    deformation: Vec<Vec<Gradient<Lanes<T>>>>,
    /// V (J - 1) and pressure at all vertices, m^3 and Pa.
    dilation: Vec<Lanes<T>>,
    pressure: Vec<Lanes<T>>,
    projection: Vec<ProjectionScratch<T>>,
    min_jacobian: Lanes<T>,
    /// Of each block, J.
    energy: Vec<Lanes<T>>,
    /// Of one block at a time: displacements, what is at its vertices, and forces.
    local_u: Vec<Vectors<T>>,
    at_vertices: Vec<Lanes<T>>,
    local_force: Vec<Vectors<T>>,
}

impl<T: Real> Common<T> {
    /// The point tables of a kernel.
    pub fn new(kernel: &Kernel<T>) -> Self {
        Self { tables: Arc::clone(&kernel.tables), points: kernel.blocks().iter().map(PointTable::new).collect() }
    }
}

impl<T: Real> Lockstep<T> {
    /// Of up to eight kernels on one set of tables; `None` where they aren't, or where a law is not the plain one.
    pub fn new(kernels: &[&Kernel<T>], common: Option<Arc<Common<T>>>) -> Option<Self> {
        let first = kernels.first()?;
        let common = common.filter(|c| Arc::ptr_eq(&c.tables, &first.tables));
        let alike = kernels.len() <= LANES && kernels.iter().all(|k| Arc::ptr_eq(&k.tables, &first.tables));
        let region = |r: usize| {
            let law = |lane: usize| kernels[lane.min(kernels.len() - 1)].constants[r].plain();
            let laws: Vec<_> = (0..LANES).map(law).collect::<Option<_>>()?;
            laws.try_into().ok().map(Laws)
        };
        let laws = (0..first.constants.len()).map(region).collect::<Option<Vec<_>>>().filter(|_| alike)?;
        let common = common.unwrap_or_else(|| Arc::new(Common::new(first)));
        let (tables, points) = (&common.tables, &common.points);
        let zero = Lanes::default();
        let vertices = tables.dilation_shares.start.len() - 1;
        let most = |size: fn(&Block<T>) -> usize| tables.blocks.iter().map(size).max().unwrap_or(0);
        Some(Self {
            members: kernels.len(),
            seen: [None; LANES],
            laws,
            constants: kernels.iter().map(|k| k.constants.clone()).collect(),
            active: points.iter().map(|p| vec![Lanes::of(1.0); p.len()]).collect(),
            deformation: points.iter().map(|p| vec![[zero; 9]; p.len()]).collect(),
            dilation: vec![zero; vertices],
            pressure: vec![zero; vertices],
            projection: kernels.iter().map(|_| tables.projection.scratch()).collect(),
            min_jacobian: Lanes::of(1.0),
            energy: vec![zero; points.len()],
            local_u: vec![[zero; 3]; most(|b| b.nodes.len())],
            local_force: vec![[zero; 3]; most(|b| b.nodes.len())],
            at_vertices: vec![zero; most(|b| b.vertices.len())],
            common,
        })
    }

    /// What further teams of the same cloud can share.
    pub fn common(&self) -> &Arc<Common<T>> {
        &self.common
    }

    /// Takes over which share of each point is tissue to a member.
    pub fn set_active(&mut self, member: usize, points: &Points<T>) {
        if self.seen[member].replace(points.changes) == Some(points.changes) {
            return;
        }
        for ((active, table), of_block) in self.active.iter_mut().zip(&self.common.points).zip(&points.active) {
            for (active, &slot) in active.iter_mut().zip(&table.slot) {
                active.0[member] = of_block[slot as usize / LANES].0[slot as usize % LANES];
            }
        }
    }

    /// Smallest volume ratio of a member's points at the last evaluation.
    pub fn min_jacobian(&self, member: usize) -> f64 {
        self.min_jacobian.0[member].get()
    }

    /// Strain energy of a member at the last evaluation, J.
    pub fn energy(&self, member: usize) -> f64 {
        let constants = &self.constants[member];
        let projected = if constants.iter().any(|c| c.projected > 0.0) {
            self.common.tables.projection.energy(&self.projection[member], constants)
        } else {
            0.0
        };
        self.energy.iter().map(|e| e.0[member].get()).sum::<f64>() + projected
    }

    /// First half of an evaluation, for each member's nodal parameters, m: deformation gradients, and pressures.
    pub fn deform(&mut self, pool: &mut Pool, u: &[&[[f64; 3]]; LANES]) {
        self.gather(u);
        self.project(pool);
    }

    /// Second half: internal force of each member, N.
    pub fn force(&mut self, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        self.clear(f);
        for b in 0..self.common.points.len() {
            let nodes = self.common.tables.blocks[b].nodes.len();
            self.local_force[..nodes].fill([Lanes::default(); 3]);
            self.load_pressure(b);
            self.stress(b);
            mirror_back(&self.common.tables.blocks[b], &mut self.local_force[..nodes]);
            self.hand_out(b, f);
        }
    }

    /// Shares of the masses, over s, at the last evaluation, in the first component of `f`.
    pub fn bound(&mut self, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        self.clear(f);
        for b in 0..self.common.points.len() {
            let block = &self.common.tables.blocks[b];
            let (nodes, region) = (block.nodes.len(), usize::from(block.region));
            self.local_force[..nodes].fill([Lanes::default(); 3]);
            self.load_pressure(b);
            let Self { common, laws, deformation, at_vertices, local_force, .. } = self;
            let (table, laws, deformation, pressure, force) =
                (&common.points[b], &laws[region], &deformation[b][..], &at_vertices[..], &mut local_force[..nodes]);
            match block_form(&common.tables.blocks[b]) {
                true => run(Bound::<_, true> { table, laws, deformation, pressure, force }),
                false => run(Bound::<_, false> { table, laws, deformation, pressure, force }),
            }
            self.hand_out(b, f);
        }
    }

    fn clear(&self, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        f.iter_mut().flatten().for_each(|f| f.fill([0.0; 3]));
    }

    /// Pass 1 over all blocks.
    fn gather(&mut self, u: &[&[[f64; 3]]; LANES]) {
        self.dilation.fill(Lanes::default());
        self.min_jacobian = Lanes::of(f64::MAX);
        for b in 0..self.common.points.len() {
            let Self { common, active, deformation, dilation, min_jacobian, local_u, at_vertices, .. } = self;
            let block = &common.tables.blocks[b];
            load(block, u, local_u);
            let here = &mut at_vertices[..block.vertices.len()];
            here.fill(Lanes::default());
            let (table, active, u, deformation) =
                (&common.points[b], &active[b][..], &local_u[..], &mut deformation[b][..]);
            match block_form(block) {
                true => run(Deform::<_, true> { table, active, u, deformation, dilation: here, min: min_jacobian }),
                false => run(Deform::<_, false> { table, active, u, deformation, dilation: here, min: min_jacobian }),
            }
            for (&n, here) in block.vertices.iter().zip(&*at_vertices) {
                dilation[n as usize] += *here;
            }
        }
    }

    /// Pressures at the vertices.
    fn project(&mut self, pool: &mut Pool) {
        let Self { common, constants, dilation, pressure, projection, members, .. } = self;
        for k in 0..*members {
            if constants[k].iter().all(|c| c.projected <= 0.0) {
                continue;
            }
            let nodal = common.tables.projection.project(&mut projection[k], pool, &constants[k], |n| dilation[n].0[k]);
            for (pressure, nodal) in pressure.iter_mut().zip(nodal) {
                pressure.0[k] = *nodal;
            }
        }
    }

    fn load_pressure(&mut self, b: usize) {
        for (here, &n) in self.at_vertices.iter_mut().zip(&self.common.tables.blocks[b].vertices) {
            *here = self.pressure[n as usize];
        }
    }

    /// Pass 2 over one block.
    fn stress(&mut self, b: usize) {
        let Self { common, laws, active, deformation, at_vertices, local_force, energy, .. } = self;
        let block = &common.tables.blocks[b];
        let (table, laws, active) = (&common.points[b], &laws[usize::from(block.region)], &active[b][..]);
        let (deformation, pressure, force) = (&deformation[b][..], &at_vertices[..], &mut local_force[..]);
        let energy = &mut energy[b];
        match block_form(block) {
            true => run(Stress::<_, true> { table, laws, active, deformation, pressure, force, energy }),
            false => run(Stress::<_, false> { table, laws, active, deformation, pressure, force, energy }),
        }
    }

    /// Adds a block's forces to those of the members.
    fn hand_out(&self, b: usize, f: &mut [Option<&mut [[f64; 3]]>; LANES]) {
        let nodes = &self.common.tables.blocks[b].nodes;
        for (k, f) in f.iter_mut().enumerate() {
            let Some(f) = f else { continue };
            for (&n, force) in nodes.iter().zip(&self.local_force) {
                let sum = &mut f[n as usize];
                (0..3).for_each(|c| sum[c] += force[c].0[k].get());
            }
        }
    }
}

/// Whether a block is of a half plane.
fn block_form<T: Real>(block: &Block<T>) -> bool {
    matches!(block.form, Form::Axisymmetric)
}

/// Displacements of a block's nodes and images, relative to its first node as in [`Block::deform`].
fn load<T: Real>(block: &Block<T>, u: &[&[[f64; 3]]; LANES], local: &mut [Vectors<T>]) {
    for (k, u) in u.iter().enumerate() {
        let origin = u[block.nodes[0] as usize];
        for (l, (local, &n)) in local.iter_mut().zip(&block.nodes).enumerate() {
            let image = l >= block.originals;
            let v = match block.form {
                Form::Full => relative(&u[n as usize], &origin),
                Form::Mirrored(mirror) if image => relative(&mirror.image(&u[n as usize]), &origin),
                Form::Mirrored(_) => relative(&u[n as usize], &origin),
                Form::Axisymmetric => {
                    let [radial, _, axial] = u[n as usize];
                    [if image { -radial } else { radial }, 0.0, axial - origin[2]]
                }
            };
            (0..3).for_each(|c| local[c].0[k] = T::of(v[c]));
        }
    }
}

fn relative(u: &[f64; 3], origin: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| u[k] - origin[k])
}

/// What pulls an image pulls its node the mirrored way.
fn mirror_back<T: Real>(block: &Block<T>, force: &mut [Vectors<T>]) {
    for force in &mut force[block.originals..] {
        match block.form {
            Form::Mirrored(mirror) => mirrored(&mirror, force),
            Form::Full | Form::Axisymmetric => force[0] = -force[0],
        }
    }
}

fn mirrored<T: Real>(mirror: &Mirror, force: &mut Vectors<T>) {
    for k in 0..LANES {
        let image = mirror.image(&[0, 1, 2].map(|c| force[c].0[k].get()));
        (0..3).for_each(|c| force[c].0[k] = T::of(image[c]));
    }
}
