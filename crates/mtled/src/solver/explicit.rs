//! A model with one state of it and the memory to step it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::approximation::ShapeTable;

use super::aside::{along, aside};
use super::drag::{End, Grip, Wall};
use super::model::{Model, Workspace, with_kernel};
use super::settings::SolverSettings;
use super::state::{Kept, Moving, Path, Role, State};
use super::work::StepWork;

/// Explicit solver of one body: a shared [`Model`], a `State`, a `Workspace`, and a state to come back to.
#[derive(Debug)]
pub struct Solver {
    pub(super) model: Arc<Model>,
    pub(super) state: State,
    pub(super) work: Workspace,
    pub(super) saved: Kept,
    /// What a [`super::Team`] found at the last evaluation, if it was that which evaluated.
    pub(super) told: Option<Told>,
}

/// What is left in the solver of an evaluation by a team.
#[derive(Clone, Copy, Debug)]
pub(super) struct Told {
    /// J
    pub energy: f64,
    pub min_jacobian: f64,
}

impl Solver {
    /// Model and undeformed state for a shape table. `role` says which nodes are held from the start.
    #[must_use]
    pub fn new(
        table: &ShapeTable,
        cells: &[[u32; 4]],
        points: &[[f64; 3]],
        role: Vec<Role>,
        settings: &SolverSettings,
    ) -> Self {
        let model = Model::of_materials(table, cells, points, role, &[settings.law], settings);
        Self::of(Arc::new(model), settings.threads)
    }

    /// The undeformed state of a model, and memory to step it on so many threads.
    #[must_use]
    pub fn of(model: Arc<Model>, threads: usize) -> Self {
        let state = model.undeformed();
        let mut work = Workspace::new(&model, threads);
        model.evaluate(&state, &mut work);
        Self { saved: Kept::of(&state.moving), state, work, model, told: None }
    }

    /// Another solver of the same model, with a copy of the state, on the caller's thread alone.
    #[must_use]
    pub fn branch(&self) -> Self {
        Self {
            model: Arc::clone(&self.model),
            state: self.state.clone(),
            saved: self.saved.clone(),
            work: Workspace::new(&self.model, 1),
            told: None,
        }
    }

    /// Takes over state and materials of another solver of the same cloud ([`Model::is_like`]): copies, allocates nothing. Before the next
    /// step [`Solver::settle`] has to bring back what follows from that.
    pub fn take_over(&mut self, other: &Self) {
        self.model = Arc::clone(&other.model);
        self.state.clone_from(&other.state);
    }

    /// Evaluates the internal force of the state that was taken over, and keeps it to come back to in trouble.
    pub fn settle(&mut self) {
        self.evaluate();
        self.save();
    }

    fn evaluate(&mut self) {
        self.model.evaluate(&self.state, &mut self.work);
        self.told = None;
    }

    /// What a step estimate begins from is what this solver's own memory holds.
    pub(super) fn leave_team(&mut self) {
        if self.told.is_some() {
            self.evaluate();
        }
    }

    /// What never changes.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Nodal parameters, m.
    #[must_use]
    pub fn parameters(&self) -> &[[f64; 3]] {
        &self.state.moving.u
    }

    /// What holds each node.
    #[must_use]
    pub fn roles(&self) -> &[Role] {
        &self.state.constraints.role
    }

    /// Gives a node another role; an instrument node keeps its displacement until [`Solver::prescribe`] moves it.
    pub fn set_role(&mut self, node: usize, role: Role) {
        let u = match role {
            Role::Dragged => aside(&self.state.moving.u[node], &self.state.constraints.drag.axis),
            _ => self.state.moving.u[node],
        };
        self.state.constraints.role[node] = role;
        self.state.constraints.path[node] = Path { start: u, end: u, spring: 0.0, along: [0.0; 3] };
        self.state.moving.q[node] = [0.0; 3];
    }

    /// Prescribes the displacement of an instrument node at the end of the next advance, m.
    pub fn prescribe(&mut self, node: usize, displacement: [f64; 3]) {
        self.state.constraints.path[node] =
            Path { start: self.state.moving.u[node], end: displacement, spring: 0.0, along: [0.0; 3] };
    }

    /// As [`Solver::prescribe`], for a guided node: a spring in N/m pulls it sideways to the displacement. Where the spring begins
    /// stays, so the spring's end moves from there and not from where the node is.
    pub fn guide(&mut self, node: usize, displacement: [f64; 3], spring: f64) {
        let path = &mut self.state.constraints.path[node];
        let [x, y, _] = path.end;
        *path = Path { start: [x, y, self.state.moving.u[node][2]], end: displacement, spring, along: [0.0; 3] };
    }

    /// As [`Solver::guide`], of a node that is held along a unit vector and not along z; the spring pulls it across that.
    pub fn guide_along(&mut self, node: usize, displacement: [f64; 3], spring: f64, axis: [f64; 3]) {
        let path = &mut self.state.constraints.path[node];
        let (u, end) = (&self.state.moving.u[node], path.end);
        let way = along(&std::array::from_fn(|k| u[k] - end[k]), &axis);
        let start = std::array::from_fn(|k| end[k] + way * axis[k]);
        *path = Path { start, end: displacement, spring, along: axis };
    }

    /// Moves the instrument's surface, if it has one, to a displacement at the end of the next advance, m.
    pub fn move_surface(&mut self, displacement: [f64; 3]) {
        self.state.constraints.way =
            Path { start: self.state.moving.offset, end: displacement, spring: 0.0, along: [0.0; 3] };
    }

    /// Says how the rod's wall goes with a layer of nodes. A wall that begins to act does so without a force.
    pub fn grip(&mut self, layer: usize, wall: Wall) {
        let share = self.model.share();
        let wall = Wall { spring: share * wall.spring, limit: share * wall.limit, ..wall };
        let before = &mut self.state.constraints.drag.walls[layer];
        let begins = before.limit <= 0.0 && wall.limit > 0.0;
        *before = wall;
        if wall.grip == Grip::Free {
            let places = self.state.constraints.drag.layer(layer);
            self.state.moving.slip.held[places].fill(false);
        }
        if begins {
            let slip = &mut self.state.moving.slip;
            slip.wall[layer] = slip.at - self.state.constraints.drag.of_layer(layer, &self.state.moving.u);
            slip.wall_floor[layer] = slip.wall[layer];
        }
    }

    /// Says how the rod's end goes through the material.
    pub fn set_end(&mut self, end: End) {
        let [spring, stiff, limit] = [end.spring, end.stiff, end.limit].map(|x| self.model.share() * x);
        self.state.constraints.drag.end = End { spring, stiff, limit, ..end };
    }

    /// The rod's end is at a depth of the material, m.
    pub fn place_end(&mut self, depth: f64) {
        self.state.moving.slip.end.fill(depth);
        self.state.moving.slip.end_floor.fill(depth);
        self.state.moving.slip.began.fill(depth);
    }

    /// A stretch of time begins, that of the end's [`End::rate`].
    pub fn begin_cut(&mut self) {
        self.state.moving.slip.began.copy_from_slice(&self.state.moving.slip.end);
    }

    /// What was learnt of the motion is no longer true: the nodes stand, and go along with nothing.
    pub fn forget_motion(&mut self) {
        self.state.moving.q.fill([0.0; 3]);
        self.state.moving.tangent.0.iter_mut().for_each(|t| t.fill([0.0; 3]));
        self.state.control.motion.unpredicted = [1.0; 3];
    }

    /// Moves the rod along its axis, to a way in m at the end of the next advance.
    pub fn drag_to(&mut self, way: f64) {
        self.state.constraints.drag.way = [self.state.moving.slip.at, way];
    }

    /// Puts the rod to a way in m with no motion.
    pub fn drag_from(&mut self, way: f64) {
        self.state.moving.slip.at = way;
        self.state.constraints.drag.way = [way; 2];
    }

    /// Force of the rod's wall and of its end on the tissue, N, into the body.
    #[must_use]
    pub fn drag_forces(&self) -> [f64; 2] {
        self.state.moving.slip.forces().map(|force| force / self.model.share())
    }

    /// Work that slip along the rod and at its end has dissipated, J.
    #[must_use]
    pub fn dissipated(&self) -> f64 {
        self.state.moving.slip.dissipated / self.model.share()
    }

    /// Depth of the material that the rod's end has cut, m: the mean over its area.
    #[must_use]
    pub fn cut(&self) -> f64 {
        self.state.constraints.drag.cut(&self.state.moving.slip)
    }

    /// Internal force on a node after the last step, N: what its holder exerts on the tissue.
    #[must_use]
    pub fn internal_force(&self, node: usize) -> [f64; 3] {
        self.state.moving.f[node]
    }

    /// Mean displacement of a layer of dragged nodes along the rod's axis, m.
    #[must_use]
    pub fn of_layer(&self, layer: usize) -> f64 {
        self.state.constraints.drag.of_layer(layer, &self.state.moving.u)
    }

    /// What of a way of the instrument, m, is along directions whose tangent motions have not been learnt yet (see `solver::step`). The tissue
    /// does not go along with it at once: it is an impulse.
    #[must_use]
    pub fn unpredicted(&self, way: [f64; 3]) -> f64 {
        let unpredicted = self.state.control.motion.unpredicted;
        way.iter().zip(unpredicted).map(|(d, share)| (d * share).powi(2)).sum::<f64>().sqrt()
    }

    /// Says which share of an integration point is tissue, 0 to 1; the rest carries no stress.
    pub fn set_active(&mut self, point: usize, share: f64) {
        with_kernel!((&self.model.kernel, &mut self.state.points) => (k, points) { k.set_active(points, point, share) });
    }

    /// Watches a flag: once it is set, an advance ends within 24 steps.
    pub fn stop_on(&mut self, flag: Arc<AtomicBool>) {
        self.work.stop = flag;
    }

    /// Whether that flag is set.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.work.is_stopped()
    }

    /// Angular frequency of the slowest mode, rad per step.
    #[must_use]
    pub fn slowest(&self) -> f64 {
        self.state.slowest()
    }

    /// Keeps the present state, to come back to with [`Solver::restore`].
    pub fn save(&mut self) {
        self.saved.keep(&self.state.moving);
    }

    /// Back to the kept state, with every present mass multiplied by `factor` from there on.
    pub fn restore(&mut self, factor: f64) {
        let mass_factor = factor * self.state.moving.mass_factor;
        self.saved.give_back(&mut self.state.moving);
        self.state.moving.mass_factor = mass_factor;
        self.told = None;
        self.lighten_slow_modes(false);
        self.model.recover(&mut self.state, &mut self.work);
    }

    /// Back to the undeformed state, with the roles of the start.
    pub fn reset(&mut self) {
        self.model.undeform(&mut self.state);
        self.settle();
    }

    /// Smallest volume ratio at the last evaluation.
    #[must_use]
    pub fn min_jacobian(&self) -> f64 {
        match self.told {
            Some(told) => told.min_jacobian,
            None => with_kernel!((&self.model.kernel, &self.work.scratch) => (k, scratch) { k.min_jacobian(scratch) }),
        }
    }

    /// Deformation gradient (row-major) of one integration point at the last evaluation.
    #[must_use]
    pub fn deformation(&self, point: usize) -> [f64; 9] {
        let State { moving, points, .. } = &self.state;
        with_kernel!((&self.model.kernel, &self.work.scratch, points) => (k, scratch, points) {
            match self.told {
                Some(_) => k.deformation_at(points, &moving.u, point),
                None => k.deformation(scratch, point),
            }
        })
    }

    /// Strain energy that stands in one integration point at the last evaluation, without the projected volumetric part, J.
    #[must_use]
    pub fn energy_of(&self, point: usize) -> f64 {
        let State { moving: Moving { u, memory, .. }, points, .. } = &self.state;
        with_kernel!((&self.model.kernel, &self.work.scratch, points) => (k, scratch, points) {
            match self.told {
                Some(_) => k.energy_at(points, u, memory, point),
                None => k.energy_of(memory, scratch, point),
            }
        })
    }

    /// Calls `visit(point, F, P, V)` for every integration point: F and first Piola-Kirchhoff stress (Pa) row-major,
    /// volume in m^3. After a step of a team it evaluates all of them once more, in memory of its own.
    pub fn for_points(&self, visit: impl FnMut(usize, [f64; 9], [f64; 9], f64)) {
        let evaluated = self.told.map(|_| {
            let mut work = Workspace::new(&self.model, 1);
            self.model.evaluate(&self.state, &mut work);
            work
        });
        let work = evaluated.as_ref().unwrap_or(&self.work);
        with_kernel!((&self.model.kernel, &work.scratch) => (k, scratch) {
            k.for_points(&self.state.moving.memory, scratch, visit);
        });
    }

    /// What a step has to do.
    #[must_use]
    pub fn work(&self) -> StepWork {
        self.model.work()
    }

    /// Threads that a step uses.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.work.threads()
    }
}
