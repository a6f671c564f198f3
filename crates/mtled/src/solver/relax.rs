//! The memory of a relaxing material in step with the poses' time.

use super::explicit::Solver;
use super::kernel::Kernel;
use super::memory::Memory;
use super::model::{Model, with_kernel};
use super::points::Constants;
use super::state::Moving;
use crate::number::Real;

impl<T: Real> Kernel<T> {
    /// See [`Solver::stress_relaxation`].
    fn stress_relaxation(&self, memory: &[Memory], dt: f64) -> f64 {
        let total = memory.iter().map(|m| m.sums.total).sum::<f64>().sqrt();
        let of_region = |(region, constants): (usize, &Constants)| -> f64 {
            let prony = &constants.law.prony;
            let decay = prony.increment(dt).decay;
            let own = || self.tables.blocks.iter().zip(memory).filter(|(b, _)| usize::from(b.region) == region);
            let term = |i: usize| own().map(|(_, m)| m.sums.terms[i]).sum::<f64>().sqrt();
            (0..prony.len()).map(|i| (1.0 - decay[i]) * term(i)).sum()
        };
        let change: f64 = self.constants.iter().enumerate().map(of_region).sum();
        if total > 0.0 { change / total } else { 0.0 }
    }
}

impl Model {
    pub(super) fn relaxes(&self) -> bool {
        with_kernel!((&self.kernel) => (k) { k.constants.iter().any(|c| !c.law.prony.is_empty()) })
    }
}

impl Solver {
    /// Seconds from the last commit to `time_s`; time that runs backwards stands still.
    fn since_commit(&self, time_s: f64) -> f64 {
        self.state.moving.time.map_or(0.0, |then| (time_s - then).max(0.0))
    }

    /// What relaxation will change in the distortional stress from the last commit to `time_s` if nothing moves, relative
    /// to that stress: upper bound of the root mean square over the body; 0 for an elastic material.
    #[must_use]
    pub fn stress_relaxation(&self, time_s: f64) -> f64 {
        if !self.model.relaxes() {
            return 0.0;
        }
        let dt = self.since_commit(time_s);
        with_kernel!((&self.model.kernel) => (k) { k.stress_relaxation(&self.state.moving.memory, dt) })
    }

    /// Lets the material relax until `time_s`: the advances that follow find the balance of that moment.
    pub fn relax_until(&mut self, time_s: f64) {
        if self.state.moving.time.is_none() {
            self.saved.time = Some(time_s);
        }
        self.begin_increment(time_s);
    }

    fn begin_increment(&mut self, time_s: f64) {
        let dt = self.since_commit(time_s);
        let Self { model, state, work, .. } = self;
        state.moving.time.get_or_insert(time_s);
        if model.relaxes() {
            with_kernel!((&model.kernel) => (k) { k.begin(&mut state.moving.memory, &mut work.pool, dt) });
        }
    }

    /// The same after a return to an earlier state, with the internal force of the moment, which a step estimate needs.
    pub fn relax_again(&mut self, time_s: f64) {
        if !self.model.relaxes() {
            return;
        }
        self.begin_increment(time_s);
        let Self { model, state, work, .. } = self;
        let Moving { u, f, memory, .. } = &mut state.moving;
        with_kernel!((&model.kernel, &state.points, &mut work.scratch) => (k, points, scratch) {
            k.force(points, memory, scratch, &mut work.pool, u);
            k.node_forces(scratch, &mut work.pool, f);
        });
    }

    /// Takes the present deformation as that of `time_s`: the material remembers it.
    pub fn commit(&mut self, time_s: f64) {
        let dt = self.since_commit(time_s);
        let Self { model, state, work, .. } = self;
        state.moving.time = Some(time_s);
        if model.relaxes() {
            let memory = &mut state.moving.memory;
            with_kernel!((&model.kernel, &state.points, &work.scratch) => (k, points, scratch) {
                k.commit(points, memory, scratch, &mut work.pool, dt);
            });
        }
    }

    /// Takes no step until `time_s`: what relaxes is remembered, and the present state kept to come back to, since
    /// coming back to one from before a long rest would spread what follows over all of the rest.
    pub fn rest(&mut self, time_s: f64) {
        self.commit(time_s);
        if self.model.relaxes() {
            self.save();
        }
    }
}
