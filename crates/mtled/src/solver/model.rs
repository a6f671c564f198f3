//! What never changes: the partition with its gradients, the material, the masses' scale; and the scratch memory that a
//! step needs beside it.
//!
//! The motion is quasi-static, so mass and time are numerical: the step is 1 and the masses are scaled until the
//! largest eigenvalue of M^-1 K is (2 f)^2, f being the step factor (Joldes, Wittek, Miller 2012). Every point gets
//! mass in proportion to its own bound, so fine and coarse, crushed and relaxed regions share one critical step.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::approximation::{Form, ShapeTable};
use crate::material::Law;

use super::adaptive_damping::Sample;
use super::contact::Surface;
use super::drag::Drag;
use super::half::Half;
use super::kernel::{Kernel, Scratch};
use super::mass::{Extent, FundamentalMode};
use super::pool::Pool;
use super::rest::Rest;
use super::settings::{Precision, SolverSettings};
use super::slow_modes::SlowModes;
use super::state::{Moving, Role, State};

/// Blocks of a half plane that are worth a thread.
const BLOCKS_PER_THREAD: usize = 4;

/// Power iterations at the start: the estimate is from below, so [`EIGENVALUE_MARGIN`] stands on top.
const POWER_ITERATIONS: usize = 40;
/// They end once so many have raised the estimate by less than [`GROWTH`].
const SETTLED: usize = 8;
const GROWTH: f64 = 0.005;
/// Safety on the estimated largest eigenvalue.
const EIGENVALUE_MARGIN: f64 = 1.06;

/// Something of the kernel in either precision.
#[derive(Debug)]
pub(super) enum Precise<S, D> {
    F32(S),
    F64(D),
}

impl<S: Clone, D: Clone> Clone for Precise<S, D> {
    fn clone(&self) -> Self {
        match self {
            Self::F32(own) => Self::F32(own.clone()),
            Self::F64(own) => Self::F64(own.clone()),
        }
    }

    fn clone_from(&mut self, other: &Self) {
        match (self, other) {
            (Self::F32(own), Self::F32(other)) => own.clone_from(other),
            (Self::F64(own), Self::F64(other)) => own.clone_from(other),
            (own, other) => *own = other.clone(),
        }
    }
}

/// `with_kernel!((&kernel, &mut scratch) => (k, s) { ... })`: the body for the one precision that all have.
macro_rules! with_kernel {
    (($($any:expr),+) => ($($name:ident),+) $body:block) => {
        match ($($any,)+) {
            ($($crate::solver::model::Precise::F32($name),)+) => $body,
            ($($crate::solver::model::Precise::F64($name),)+) => $body,
            #[allow(unreachable_patterns)] // with one value there is no other case
            _ => unreachable!("model, state and workspace have one precision: a state is used with its own model"),
        }
    };
}
pub(super) use with_kernel;

/// What never changes about a discretised body. Shared by any number of `State`s.
#[derive(Debug)]
pub struct Model {
    pub(super) kernel: Precise<Kernel<f32>, Kernel<f64>>,
    /// What the shape table describes.
    pub(super) form: Form,
    /// What a body with a plane of symmetry has.
    pub(super) half: Option<Arc<Half>>,
    extent: Extent,
    pub(super) mode: FundamentalMode,
    /// s of [`super::mass`].
    pub(super) mass_scale: f64,
    pub(super) step_factor: f64,
    /// Threads that are worth having.
    threads: usize,
    /// Undeformed places of the nodes, m.
    pub(super) points: Arc<[[f64; 3]]>,
    /// What the undeformed state has that is not zero.
    pub(super) rest: Rest,
    /// Slow modes that may have less inertia.
    pub(super) modes: Option<SlowModes>,
}

/// Scratch memory of a step, and its team of threads. What the last evaluation of the internal force found stands here:
/// deformation gradients, energy, smallest volume ratio.
#[derive(Debug)]
pub(super) struct Workspace {
    pub(super) pool: Pool,
    pub(super) scratch: Precise<Scratch<f32>, Scratch<f64>>,
    /// A displacement field beside the state's own, m, and then the force there, N.
    pub(super) image: Vec<[f64; 3]>,
    /// Where tissue that comes to rest was, for [`Solver::adapt_damping`](super::Solver::adapt_damping).
    pub(super) sample: Sample,
    /// Set from outside to end an advance before its last step.
    pub(super) stop: Arc<AtomicBool>,
}

impl Workspace {
    /// Memory and threads, the caller's included, for a model; no more threads than are worth having.
    pub(super) fn new(model: &Model, threads: usize) -> Self {
        let pool = Pool::new(threads.min(model.threads));
        let scratch = match &model.kernel {
            Precise::F32(k) => Precise::F32(k.scratch(pool.threads())),
            Precise::F64(k) => Precise::F64(k.scratch(pool.threads())),
        };
        let nodes = model.points.len();
        // only what a rod holds is brought to rest
        let sample = Sample::new(if model.rest.drag.nodes.is_empty() { 0 } else { nodes });
        Self { pool, scratch, image: vec![[0.0; 3]; nodes], sample, stop: Arc::default() }
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(super) fn threads(&self) -> usize {
        self.pool.threads()
    }
}

impl Model {
    /// Partition, masses and stable step for a shape table. `role` says which nodes are held from the start. Of a body of several
    /// materials the law of each region of the table, and no other, counts.
    #[must_use]
    pub fn of_materials(
        table: &ShapeTable,
        cells: &[[u32; 4]],
        points: &[[f64; 3]],
        role: Vec<Role>,
        laws: &[Law],
        settings: &SolverSettings,
    ) -> Self {
        let ratio = settings.volume_ratio;
        let kernel = match settings.precision {
            Precision::F32 => Precise::F32(Kernel::of_materials(table, cells, points, laws, ratio)),
            Precision::F64 => Precise::F64(Kernel::of_materials(table, cells, points, laws, ratio)),
        };
        let threads = match table.form {
            Form::Full | Form::Mirrored(_) => settings.threads,
            // Blocks are what threads share, and a half plane has one or a few. So short a step gains nothing from a
            // second thread on a quiet machine, and loses tenfold where one has to wait for a processor.
            Form::Axisymmetric => {
                let blocks = with_kernel!((&kernel) => (k) { k.tables.blocks.len() });
                settings.threads.min(blocks.div_ceil(BLOCKS_PER_THREAD))
            }
        };
        let half = table.form.mirror().map(|mirror| Arc::new(Half::new(mirror, points)));
        let extent = extent(table, cells, points, laws.len());
        let mut model = Self {
            points: Arc::clone(&extent.points),
            rest: Rest::new(&kernel, role, half.as_deref()),
            half,
            kernel,
            form: table.form,
            mode: FundamentalMode::of(&extent, &moduli(table.form, laws)),
            extent,
            mass_scale: 1.0,
            step_factor: settings.step_factor,
            threads,
            modes: None,
        };
        model.scale_masses();
        model
    }

    /// The same body of other materials, undeformed: as many laws as this one was made of. It has the bits of a model that is made anew
    /// and shares all tables with this one.
    #[must_use]
    pub fn with_laws(&self, laws: &[Law]) -> Self {
        let kernel = match &self.kernel {
            Precise::F32(k) => Precise::F32(k.with_laws(laws)),
            Precise::F64(k) => Precise::F64(k.with_laws(laws)),
        };
        let rest = self.rest.of_materials(&kernel, self.half.as_deref());
        let mut model = Self {
            mode: FundamentalMode::of(&self.extent, &moduli(self.form, laws)),
            kernel,
            rest,
            mass_scale: 1.0,
            extent: self.extent.clone(),
            points: Arc::clone(&self.points),
            half: self.half.clone(),
            modes: None,
            ..*self
        };
        model.scale_masses();
        if self.modes.is_some() { model.with_slow_modes() } else { model }
    }

    /// Whether states and scratch memory of one can be used with the other: both are of one cloud, of whatever materials.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.points, &other.points)
    }

    /// Laws that it was made of.
    #[must_use]
    pub fn materials(&self) -> usize {
        with_kernel!((&self.kernel) => (k) { k.constants.len() })
    }

    /// Surfaces that nodes of [`Role::Surface`] may not pass, as [`Model::with_surfaces`] has them.
    #[must_use]
    pub fn surfaces(&self) -> [Option<Surface>; 2] {
        [self.rest.instrument, self.rest.base]
    }

    /// With nodes at other places than those for which the table was fitted: its gradients and volumes are of these.
    #[must_use]
    pub fn with_nodes_at(mut self, points: &[[f64; 3]]) -> Self {
        self.points = points.into();
        self
    }

    /// With surfaces that nodes of [`Role::Surface`] may not pass: the instrument's, and one that the body stands on.
    #[must_use]
    pub fn with_surfaces(mut self, instrument: Option<Surface>, base: Option<Surface>) -> Self {
        (self.rest.instrument, self.rest.base) = (instrument, base);
        self
    }

    /// With a rod through layers of nodes (see [`Role::Dragged`]): `nodes` by layer and ring, the number of nodes in each ring of each
    /// layer, and the rings' shares of the area of the rod's end. `axis`: unit vector into the body; `flattening`: way of the rod, or
    /// past it, on which a layer that its end has bent becomes flat again, m.
    #[must_use]
    pub fn with_rod(
        mut self,
        axis: [f64; 3],
        nodes: Vec<u32>,
        ring_sizes: &[Vec<usize>],
        areas: Vec<f64>,
        flattening: f64,
    ) -> Self {
        let share = |n: &u32| self.half.as_ref().map_or(1.0, |half| half.share(*n as usize));
        let shares = nodes.iter().map(share).collect();
        let drag = Drag::new(axis, (nodes, shares), ring_sizes, areas, flattening);
        self.rest.drag = drag;
        self
    }

    /// Finds the masses' scale, the largest eigenvalue at rest, and its eigenvector.
    fn scale_masses(&mut self) {
        let (mut state, mut work) = (self.undeformed(), Workspace::new(self, self.threads));
        self.evaluate(&state, &mut work);
        self.refresh_masses(&mut state, &mut work);
        let mut before = [0.0; SETTLED];
        for i in 0..POWER_ITERATIONS {
            self.probe(&mut state, &mut work);
            if state.control.largest < (1.0 + GROWTH) * before[i % SETTLED] {
                break;
            }
            before[i % SETTLED] = state.control.largest;
        }
        let limit = 4.0 * self.step_factor * self.step_factor;
        let scale = EIGENVALUE_MARGIN * state.control.largest / limit;
        let control = &mut state.control;
        control.mass.iter_mut().for_each(|m| *m *= scale);
        control.largest /= scale;
        control.slowest = self.mode.frequency(control.mass.iter().copied());
        self.mass_scale = scale;
        self.rest.control = state.control;
    }

    /// Share of the body that the model holds.
    pub(super) fn share(&self) -> f64 {
        if self.half.is_some() { 0.5 } else { 1.0 }
    }

    /// The part of a node's vector that its place leaves: of one on a plane of symmetry what lies within that.
    #[inline]
    pub(super) fn of_node(&self, n: usize, v: [f64; 3]) -> [f64; 3] {
        match &self.half {
            Some(half) => half.of_node(n, v),
            None => v,
        }
    }

    /// Evaluates the internal force at the present nodal parameters, so that deformation, energy and smallest volume
    /// ratio are those of the state and not of a probe.
    pub(super) fn evaluate(&self, state: &State, work: &mut Workspace) {
        let Moving { u, memory, .. } = &state.moving;
        with_kernel!((&self.kernel, &state.points, &mut work.scratch) => (k, points, scratch) {
            k.force(points, memory, scratch, &mut work.pool, u);
        });
    }
}

/// Modulus of the slowest mode in each material, Pa: of shear in space and of stretch in a half plane.
fn moduli(form: Form, laws: &[Law]) -> Vec<f64> {
    let modulus = |law: &Law| {
        let mu = law.shear_modulus();
        match form {
            Form::Full | Form::Mirrored(_) => mu,
            Form::Axisymmetric => 9.0 * law.bulk_modulus * mu / (3.0 * law.bulk_modulus + mu),
        }
    };
    laws.iter().map(modulus).collect()
}

/// What the slowest mode needs of a body of so many materials.
fn extent(table: &ShapeTable, cells: &[[u32; 4]], points: &[[f64; 3]], materials: usize) -> Extent {
    let corners = table.form.corners();
    let height = |p: usize| {
        let cell = &cells[table.cell[p] as usize][..corners];
        cell.iter().map(|&n| points[n as usize][2]).sum::<f64>() / corners as f64
    };
    let part = |p: usize| (height(p), table.volume[p], table.region_of(p));
    let parts = if materials == 1 { 0 } else { table.volume.len() };
    Extent { points: points.into(), volume: table.volume.iter().sum(), parts: (0..parts).map(part).collect() }
}
