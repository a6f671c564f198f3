//! A second solver of the same model, which takes over the state of the first whenever it is asked to.
//!
//! What is copied is what a step changes and a new evaluation of the internal force does not bring back: displacements,
//! velocities, tangent motion, masses, roles, the share of each point that is tissue, and what the material remembers.

use super::kernel::Kernel;
use super::pool::Pool;
use super::state::{AnyKernel, Solver};
use super::step;
use crate::number::Real;

impl Solver {
    /// A solver of the same model and state, on the caller's thread alone.
    #[must_use]
    pub fn double(&self) -> Self {
        Self {
            kernel: self.kernel.clone(),
            form: self.form,
            pool: Pool::new(1),
            state: self.state.clone(),
            saved: self.saved.clone(),
            mass: self.mass.clone(),
            mass_scale: self.mass_scale,
            sway: self.sway.clone(),
            role: self.role.clone(),
            path: self.path.clone(),
            first_probe: self.first_probe.clone(),
            probe: self.probe.clone(),
            scratch: self.scratch.clone(),
            slowest: self.slowest,
            step_factor: self.step_factor,
            largest: self.largest,
            steps_since_refresh: self.steps_since_refresh,
            usual_travel: self.usual_travel,
            motion: self.motion,
            sums: self.sums.clone(),
        }
    }

    /// Takes over the state of another solver of the same model: copies, allocates nothing. Before the next step
    /// [`Solver::settle`] has to bring back what follows from that.
    pub fn take_over(&mut self, other: &Self) {
        self.state.copy_from(&other.state);
        self.mass.copy_from_slice(&other.mass);
        self.role.copy_from_slice(&other.role);
        self.path.copy_from_slice(&other.path);
        self.probe.copy_from_slice(&other.probe);
        self.slowest = other.slowest;
        self.largest = other.largest;
        self.steps_since_refresh = other.steps_since_refresh;
        self.usual_travel = other.usual_travel;
        self.motion = other.motion;
        self.sums.copy_from_slice(&other.sums);
        match (&mut self.kernel, &other.kernel) {
            (AnyKernel::F32(own), AnyKernel::F32(other)) => own.take_over(other),
            (AnyKernel::F64(own), AnyKernel::F64(other)) => own.take_over(other),
            // Two solvers of one model have one precision.
            _ => {}
        }
    }

    /// Evaluates the internal force of the state that was taken over, and keeps it to come back to in trouble.
    pub fn settle(&mut self) {
        step::evaluate(self);
        self.save();
    }
}

impl<T: Real> Kernel<T> {
    fn take_over(&mut self, other: &Self) {
        for (own, other) in self.blocks.iter_mut().zip(&other.blocks) {
            own.active.copy_from_slice(&other.active);
            own.memory.take_over(&other.memory);
        }
    }
}
