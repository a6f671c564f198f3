//! Model and state of the explicit solution: masses, nodal parameters, velocities, prescribed nodes.
//!
//! The motion is quasi-static, so mass and time are numerical: the step is 1 and the masses are scaled until the
//! largest eigenvalue of M^-1 K is (2 f)^2, f being the step factor (Joldes, Wittek, Miller 2012). Every point gets
//! mass in proportion to its own bound, so fine and coarse, crushed and relaxed regions share one critical step.

use crate::approximation::{Form, ShapeTable};

use super::inertia::{Motion, Sums};
use super::kernel::{Kernel, NODES_PER_CHUNK};
use super::mass::Sway;
use super::pool::Pool;
use super::settings::{Precision, SolverSettings};
use super::step;

/// Blocks of a half plane that are worth a thread.
const BLOCKS_PER_THREAD: usize = 4;

/// Power iterations at the start: the estimate is from below, so [`EIGENVALUE_MARGIN`] stands on top.
const POWER_ITERATIONS: usize = 40;
/// They end once so many have raised the estimate by less than [`GROWTH`].
const SETTLED: usize = 8;
const GROWTH: f64 = 0.005;
/// Safety on the estimated largest eigenvalue.
const EIGENVALUE_MARGIN: f64 = 1.06;

/// What holds a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Role {
    /// Nothing.
    #[default]
    Free,
    /// The fixed base.
    Base,
    /// The instrument: its displacement is prescribed.
    Instrument,
}

/// The kernel in either precision.
#[derive(Clone, Debug)]
pub(super) enum AnyKernel {
    F32(Kernel<f32>),
    F64(Kernel<f64>),
}

macro_rules! with_kernel {
    ($kernel:expr, $k:ident => $body:expr) => {
        match $kernel {
            $crate::solver::state::AnyKernel::F32($k) => $body,
            $crate::solver::state::AnyKernel::F64($k) => $body,
        }
    };
}
pub(super) use with_kernel;

/// Displacement of a node from where it was to where it shall be at the end of an advance.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Path {
    pub start: [f64; 3],
    pub end: [f64; 3],
}

/// What changes from step to step.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// Nodal parameters, m.
    pub u: Vec<[f64; 3]>,
    /// Velocity relative to the tangent motion, m per step.
    pub q: Vec<[f64; 3]>,
    /// Tangent motion: displacement per metre that the instrument travels.
    pub tangent: Vec<[f64; 3]>,
    /// Internal force at `u`, N.
    pub f: Vec<[f64; 3]>,
    /// Factor on every mass: 1, or more where the deformed tissue's stable step is smaller.
    pub mass_factor: f64,
    /// When the material's memory was last brought up to date, s; `None` before the first pose.
    pub time: Option<f64>,
}

impl State {
    fn new(nodes: usize) -> Self {
        let zero = vec![[0.0; 3]; nodes];
        Self { u: zero.clone(), q: zero.clone(), tangent: zero.clone(), f: zero, mass_factor: 1.0, time: None }
    }

    pub fn copy_from(&mut self, other: &Self) {
        self.u.copy_from_slice(&other.u);
        self.q.copy_from_slice(&other.q);
        self.tangent.copy_from_slice(&other.tangent);
        self.f.copy_from_slice(&other.f);
        self.mass_factor = other.mass_factor;
        self.time = other.time;
    }

    fn clear(&mut self) {
        for v in [&mut self.u, &mut self.q, &mut self.tangent, &mut self.f] {
            v.fill([0.0; 3]);
        }
        self.mass_factor = 1.0;
        self.time = None;
    }
}

/// Explicit solver of one scene.
#[derive(Debug)]
pub struct Solver {
    pub(super) kernel: AnyKernel,
    /// What the shape table describes.
    pub(super) form: Form,
    pub(super) pool: Pool,
    pub(super) state: State,
    pub(super) saved: State,
    /// Masses at factor 1, N per (m/step^2).
    pub(super) mass: Vec<f64>,
    /// s of [`super::mass`].
    pub(super) mass_scale: f64,
    pub(super) sway: Sway,
    pub(super) role: Vec<Role>,
    pub(super) path: Vec<Path>,
    /// Eigenvector and eigenvalue estimates of the undeformed state.
    pub(super) first_probe: (Vec<[f64; 3]>, f64),
    /// Present estimate of the eigenvector of the largest eigenvalue of M^-1 K, and scratch for its image.
    pub(super) probe: Vec<[f64; 3]>,
    pub(super) scratch: Vec<[f64; 3]>,
    /// Angular frequency of the slowest mode at mass factor 1, rad per step.
    pub(super) slowest: f64,
    pub(super) step_factor: f64,
    /// Largest eigenvalue of M^-1 K at the last estimate, mass factor 1.
    pub(super) largest: f64,
    pub(super) steps_since_refresh: u32,
    /// Travel per step of late, m.
    pub(super) usual_travel: f64,
    pub(super) motion: Motion,
    /// Of each deal of nodes, after the last advance.
    pub(super) sums: Vec<Sums>,
}

impl Solver {
    /// Masses, stable step and memory for a shape table. `role` says which nodes are held from the start.
    #[must_use]
    pub fn new(
        table: &ShapeTable,
        cells: &[[u32; 4]],
        points: &[[f64; 3]],
        role: Vec<Role>,
        settings: &SolverSettings,
    ) -> Self {
        let (law, ratio) = (&settings.law, settings.volume_ratio);
        let kernel = match settings.precision {
            Precision::F32 => {
                AnyKernel::F32(Kernel::new(table, cells, points, law, ratio).for_threads(settings.threads))
            }
            Precision::F64 => {
                AnyKernel::F64(Kernel::new(table, cells, points, law, ratio).for_threads(settings.threads))
            }
        };
        let nodes = points.len();
        let mu = law.shear_modulus();
        let (modulus, threads) = match table.form {
            Form::Full => (mu, settings.threads),
            // Blocks are what threads share, and a half plane has one or a few. So short a step gains nothing from a
            // second thread on a quiet machine, and loses tenfold where one has to wait for a processor.
            Form::Axisymmetric => {
                let blocks = with_kernel!(&kernel, k => k.blocks.len());
                (
                    9.0 * law.bulk_modulus * mu / (3.0 * law.bulk_modulus + mu),
                    settings.threads.min(blocks.div_ceil(BLOCKS_PER_THREAD)),
                )
            }
        };
        let mut solver = Self {
            kernel,
            form: table.form,
            pool: Pool::new(threads),
            state: State::new(nodes),
            saved: State::new(nodes),
            mass: vec![0.0; nodes],
            mass_scale: 1.0,
            sway: Sway::new(points, table.volume.iter().sum(), modulus),
            path: vec![Path::default(); nodes],
            first_probe: (Vec::new(), 0.0),
            probe: noise(&role),
            scratch: vec![[0.0; 3]; nodes],
            slowest: 0.0,
            step_factor: settings.step_factor,
            largest: 0.0,
            steps_since_refresh: 0,
            usual_travel: 0.0,
            motion: Motion::default(),
            sums: vec![Sums::default(); nodes.div_ceil(NODES_PER_CHUNK)],
            role,
        };
        step::evaluate(&mut solver);
        solver.refresh_masses();
        let mut before = [0.0; SETTLED];
        for i in 0..POWER_ITERATIONS {
            step::probe(&mut solver);
            if solver.largest < (1.0 + GROWTH) * before[i % SETTLED] {
                break;
            }
            before[i % SETTLED] = solver.largest;
        }
        let limit = 4.0 * settings.step_factor * settings.step_factor;
        let scale = EIGENVALUE_MARGIN * solver.largest / limit;
        solver.mass_scale = scale;
        solver.mass.iter_mut().for_each(|m| *m *= scale);
        solver.largest /= scale;
        solver.slowest = solver.sway.frequency(&solver.mass);
        solver.first_probe = (solver.probe.clone(), solver.largest);
        step::evaluate(&mut solver);
        solver
    }

    /// Nodal parameters, m.
    #[must_use]
    pub fn parameters(&self) -> &[[f64; 3]] {
        &self.state.u
    }

    /// What holds each node.
    #[must_use]
    pub fn roles(&self) -> &[Role] {
        &self.role
    }

    /// Gives a node another role; an instrument node keeps its displacement until [`Solver::prescribe`] moves it.
    pub fn set_role(&mut self, node: usize, role: Role) {
        self.role[node] = role;
        self.path[node] = Path { start: self.state.u[node], end: self.state.u[node] };
        self.state.q[node] = [0.0; 3];
    }

    /// Prescribes the displacement of an instrument node at the end of the next advance, m.
    pub fn prescribe(&mut self, node: usize, displacement: [f64; 3]) {
        self.path[node] = Path { start: self.state.u[node], end: displacement };
    }

    /// Angular frequency of the slowest mode, rad per step.
    #[must_use]
    pub fn slowest(&self) -> f64 {
        self.slowest / self.state.mass_factor.sqrt()
    }

    /// Keeps the present state, to come back to with [`Solver::restore`].
    pub fn save(&mut self) {
        self.saved.copy_from(&self.state);
        with_kernel!(&mut self.kernel, k => k.save_memory());
    }

    /// Back to the kept state, with every present mass multiplied by `factor` from there on.
    pub fn restore(&mut self, factor: f64) {
        let mass_factor = factor * self.state.mass_factor;
        let saved = &self.saved;
        self.state.copy_from(saved);
        with_kernel!(&mut self.kernel, k => k.restore_memory());
        self.state.mass_factor = mass_factor;
        // the estimate of the largest eigenvalue may have followed the trouble beyond all numbers
        if !self.probe.iter().flatten().all(|e| e.is_finite()) {
            self.probe.copy_from_slice(&self.first_probe.0);
        }
        // masses are to be those of the kept state: the one that was left may have had enormous ones
        step::evaluate(self);
        self.mass.fill(0.0);
        self.refresh_masses();
        // velocities that led into trouble are not worth keeping
        self.state.q.fill([0.0; 3]);
        for (path, u) in self.path.iter_mut().zip(&self.state.u) {
            path.start = *u;
        }
    }

    /// Back to the undeformed state; roles are the caller's to set.
    pub fn reset(&mut self) {
        self.state.clear();
        self.saved.clear();
        self.path.fill(Path::default());
        self.steps_since_refresh = 0;
        self.usual_travel = 0.0;
        self.motion = Motion::default();
        self.sums.fill(Sums::default());
        with_kernel!(&mut self.kernel, k => {
            k.activate_all();
            k.clear_memory();
        });
        self.probe.copy_from_slice(&self.first_probe.0);
        self.largest = self.first_probe.1;
        step::evaluate(self);
        self.mass.fill(0.0);
        self.refresh_masses();
    }

    /// Smallest volume ratio at the last evaluation.
    #[must_use]
    pub fn min_jacobian(&self) -> f64 {
        with_kernel!(&self.kernel, k => k.min_jacobian())
    }

    /// Deformation gradient (row-major) of one integration point at the last evaluation.
    #[must_use]
    pub fn deformation(&self, point: usize) -> [f64; 9] {
        with_kernel!(&self.kernel, k => k.deformation(point))
    }

    /// Says which share of an integration point is tissue, 0 to 1; the rest carries no stress.
    pub fn set_active(&mut self, point: usize, share: f64) {
        with_kernel!(&mut self.kernel, k => k.set_active(point, share));
    }

    /// Calls `visit(point, F, P, V)` for every integration point: F and first Piola-Kirchhoff stress (Pa) row-major,
    /// volume in m^3.
    pub fn for_points(&self, visit: impl FnMut(usize, [f64; 9], [f64; 9], f64)) {
        with_kernel!(&self.kernel, k => k.for_points(visit));
    }

    /// Threads that a step uses.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.pool.threads()
    }
}

/// A fixed vector with no symmetry, zero on held nodes.
fn noise(role: &[Role]) -> Vec<[f64; 3]> {
    let value = |i: usize| ((i.wrapping_mul(2_654_435_761) >> 7) % 1009) as f64 / 1009.0 - 0.5;
    let free =
        |(i, r): (usize, &Role)| if *r == Role::Free { std::array::from_fn(|k| value(3 * i + k)) } else { [0.0; 3] };
    role.iter().enumerate().map(free).collect()
}

/// Strain energy of the last evaluation, J.
pub(super) fn energy(kernel: &AnyKernel) -> f64 {
    with_kernel!(kernel, k => k.energy())
}
