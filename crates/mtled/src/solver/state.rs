//! What changes from step to step, and what holds the nodes. Copied in one line, by `clone_from`, with no allocation.

use super::cloned::cloned_field_by_field;
use super::inertia::{Motion, Sums};
use super::kernel::Points;
use super::memory::Memory;
use super::model::Precise;

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

/// Displacement of a node from where it was to where it shall be at the end of an advance, m.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Path {
    pub start: [f64; 3],
    pub end: [f64; 3],
}

cloned_field_by_field! {
    /// State of one model: another is a branch of it. Belongs to the model that made it.
    #[derive(Debug)]
    pub struct State {
        pub(super) moving: Moving,
        pub(super) constraints: Constraints,
        pub(super) control: Control,
        pub(super) points: Precise<Points<f32>, Points<f64>>,
    }
}

cloned_field_by_field! {
    /// Where the tissue is: what is kept to come back to in trouble.
    #[derive(Debug)]
    pub(super) struct Moving {
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
        /// What the points of a relaxing material remember, by block.
        pub memory: Vec<Memory>,
    }
}

cloned_field_by_field! {
    /// What holds the nodes.
    #[derive(Debug)]
    pub(super) struct Constraints {
        pub role: Vec<Role>,
        pub path: Vec<Path>,
    }
}

cloned_field_by_field! {
    /// Masses, and what the step control has learnt.
    #[derive(Debug)]
    pub(super) struct Control {
        /// Masses at factor 1, N per (m/step^2).
        pub mass: Vec<f64>,
        /// Angular frequency of the slowest mode at mass factor 1, rad per step.
        pub slowest: f64,
        /// Present estimate of the eigenvector of the largest eigenvalue of M^-1 K.
        pub probe: Vec<[f64; 3]>,
        /// That eigenvalue at the last estimate, mass factor 1.
        pub largest: f64,
        pub steps_since_refresh: u32,
        /// Travel per step of late, m.
        pub usual_travel: f64,
        pub motion: Motion,
        /// Of each chunk of nodes, after the last advance.
        pub sums: Vec<Sums>,
    }
}

impl State {
    /// Nodal parameters, m.
    #[must_use]
    pub fn parameters(&self) -> &[[f64; 3]] {
        &self.moving.u
    }

    /// What holds each node.
    #[must_use]
    pub fn roles(&self) -> &[Role] {
        &self.constraints.role
    }

    /// Gives a node another role; an instrument node keeps its displacement until [`State::prescribe`] moves it.
    pub fn set_role(&mut self, node: usize, role: Role) {
        let u = self.moving.u[node];
        self.constraints.role[node] = role;
        self.constraints.path[node] = Path { start: u, end: u };
        self.moving.q[node] = [0.0; 3];
    }

    /// Prescribes the displacement of an instrument node at the end of the next advance, m.
    pub fn prescribe(&mut self, node: usize, displacement: [f64; 3]) {
        self.constraints.path[node] = Path { start: self.moving.u[node], end: displacement };
    }

    /// Angular frequency of the slowest mode, rad per step.
    #[must_use]
    pub fn slowest(&self) -> f64 {
        self.control.slowest / self.moving.mass_factor.sqrt()
    }
}
