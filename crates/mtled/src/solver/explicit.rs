//! A model with one state of it and the memory to step it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::approximation::ShapeTable;

use super::contact::Touch;
use super::drag::{End, Wall};
use super::model::{Model, Workspace, with_kernel};
use super::settings::SolverSettings;
use super::slip::Slip;
use super::state::{Kept, Moving, Role, State};
use super::step::{Advance, Balance};
use super::work::StepWork;

/// Explicit solver of one body: a shared [`Model`], a [`State`], a [`Workspace`], and a state to come back to.
#[derive(Debug)]
pub struct Solver {
    pub(super) model: Arc<Model>,
    pub(super) state: State,
    pub(super) work: Workspace,
    saved: Kept,
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
        Self::of(Arc::new(Model::new(table, cells, points, role, settings)), settings.threads)
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
    fn leave_team(&mut self) {
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
        self.state.parameters()
    }

    /// What holds each node.
    #[must_use]
    pub fn roles(&self) -> &[Role] {
        self.state.roles()
    }

    /// [`State::set_role`].
    pub fn set_role(&mut self, node: usize, role: Role) {
        self.state.set_role(node, role);
    }

    /// [`State::prescribe`].
    pub fn prescribe(&mut self, node: usize, displacement: [f64; 3]) {
        self.state.prescribe(node, displacement);
    }

    /// [`State::guide`].
    pub fn guide(&mut self, node: usize, displacement: [f64; 3], spring: f64) {
        self.state.guide(node, displacement, spring);
    }

    /// [`State::guide_along`].
    pub fn guide_along(&mut self, node: usize, displacement: [f64; 3], spring: f64, axis: [f64; 3]) {
        self.state.guide_along(node, displacement, spring, axis);
    }

    /// [`State::move_surface`].
    pub fn move_surface(&mut self, displacement: [f64; 3]) {
        self.state.move_surface(displacement);
    }

    /// [`State::grip`].
    pub fn grip(&mut self, layer: usize, wall: Wall) {
        self.state.grip(layer, wall);
    }

    /// [`State::set_end`].
    pub fn set_end(&mut self, end: End) {
        self.state.set_end(end);
    }

    /// [`State::place_end`].
    pub fn place_end(&mut self, depth: f64) {
        self.state.place_end(depth);
    }

    /// [`State::begin_cut`].
    pub fn begin_cut(&mut self) {
        self.state.begin_cut();
    }

    /// [`State::forget_motion`].
    pub fn forget_motion(&mut self) {
        self.state.forget_motion();
    }

    /// [`State::adapt_damping`].
    pub fn adapt_damping(&mut self) {
        self.state.adapt_damping(&mut self.work);
    }

    /// [`State::drag_to`].
    pub fn drag_to(&mut self, way: f64) {
        self.state.drag_to(way);
    }

    /// [`State::drag_from`].
    pub fn drag_from(&mut self, way: f64) {
        self.state.drag_from(way);
    }

    /// [`State::slip`].
    #[must_use]
    pub fn slip(&self) -> &Slip {
        self.state.slip()
    }

    /// [`State::cut`].
    #[must_use]
    pub fn cut(&self) -> f64 {
        self.state.cut()
    }

    /// [`State::internal_force`].
    #[must_use]
    pub fn internal_force(&self, node: usize) -> [f64; 3] {
        self.state.internal_force(node)
    }

    /// [`State::of_layer`].
    #[must_use]
    pub fn of_layer(&self, layer: usize) -> f64 {
        self.state.of_layer(layer)
    }

    /// [`State::touches`].
    #[must_use]
    pub fn touches(&self) -> &[Touch] {
        self.state.touches()
    }

    /// [`State::slowest`].
    #[must_use]
    pub fn slowest(&self) -> f64 {
        self.state.slowest()
    }

    /// [`State::unlearnt`].
    #[must_use]
    pub fn unlearnt(&self, way: [f64; 3]) -> f64 {
        self.state.unlearnt(way)
    }

    /// [`Model::set_active`].
    pub fn set_active(&mut self, point: usize, share: f64) {
        self.model.set_active(&mut self.state, point, share);
    }

    /// [`Model::advance`].
    pub fn advance(&mut self, advance: &Advance) -> u32 {
        self.told = None;
        self.model.advance(&mut self.state, &mut self.work, advance)
    }

    /// [`Workspace::stop_on`].
    pub fn stop_on(&mut self, flag: Arc<AtomicBool>) {
        self.work.stop_on(flag);
    }

    /// [`Workspace::is_stopped`].
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.work.is_stopped()
    }

    /// [`Model::balance`].
    #[must_use]
    pub fn balance(&self) -> Balance {
        match self.told {
            Some(told) => self.model.balance_of(&self.state, told.energy),
            None => self.model.balance(&self.state, &self.work),
        }
    }

    /// [`Model::refresh_if_due`].
    pub fn refresh_if_due(&mut self) {
        self.leave_team();
        self.model.refresh_if_due(&mut self.state, &mut self.work);
    }

    /// [`Model::refresh_step`].
    pub fn refresh_step(&mut self) {
        self.leave_team();
        self.model.refresh_step(&mut self.state, &mut self.work);
    }

    /// [`Model::fastest`].
    pub fn fastest(&mut self, iterations: usize) -> f64 {
        self.leave_team();
        self.model.fastest(&mut self.state, &mut self.work, iterations)
    }

    /// [`Model::stress_relaxation`].
    #[must_use]
    pub fn stress_relaxation(&self, time_s: f64) -> f64 {
        self.model.stress_relaxation(&self.state, time_s)
    }

    /// [`Model::relax_until`].
    pub fn relax_until(&mut self, time_s: f64) {
        if self.state.moving.time.is_none() {
            self.saved.time = Some(time_s);
        }
        self.model.relax_until(&mut self.state, &mut self.work, time_s);
    }

    /// [`Model::relax_again`].
    pub fn relax_again(&mut self, time_s: f64) {
        self.model.relax_again(&mut self.state, &mut self.work, time_s);
    }

    /// [`Model::commit`].
    pub fn commit(&mut self, time_s: f64) {
        self.model.commit(&mut self.state, &mut self.work, time_s);
    }

    /// Takes no step until `time_s`: what relaxes is remembered, and the present state kept to come back to, since
    /// coming back to one from before a long rest would spread what follows over all of the rest.
    pub fn rest(&mut self, time_s: f64) {
        self.commit(time_s);
        if self.model.relaxes() {
            self.save();
        }
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
