//! What changes from step to step, and what holds the nodes. Copied in one line, by `clone_from`, with no allocation.

use super::adaptive_damping::AdaptiveDamping;
use super::cloned::cloned_field_by_field;
use super::contact::{Moved, Surface, Touch};
use super::drag::Drag;
#[cfg(doc)]
use super::explicit::Solver;
use super::inertia::{Motion, Sums};
use super::kernel::Points;
use super::memory::Memory;
use super::model::Precise;
use super::slip::Slip;

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
    /// The instrument along z or along an oblique path; across that a spring pulls the node to its prescribed displacement
    /// ([`Solver::guide`], [`Solver::guide_along`]).
    Guided,
    /// Nothing, unless it meets a rigid surface. Its parameter has to be the field's value.
    Surface,
    /// A rod along its axis, which is z, up to limits of force ([`Solver::grip`]); in x and y a spring as of a guided node, or a hold
    /// where its spring is infinite.
    Dragged,
}

impl Role {
    /// Whether the component k of the node's displacement is a degree of freedom.
    pub(super) const fn frees(self, k: usize) -> bool {
        match self {
            Self::Free | Self::Surface | Self::Dragged => true,
            Self::Guided => k < 2,
            Self::Base | Self::Instrument => false,
        }
    }
}

/// Displacement of a node from where it was to where it shall be at the end of an advance, m.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Path {
    pub start: [f64; 3],
    pub end: [f64; 3],
    /// Spring of a guided node, N/m.
    pub spring: f64,
    /// Unit vector along which a guided node is held; zero: z.
    pub along: [f64; 3],
}

impl Path {
    /// Whether it is that of a node which is guided along an oblique line.
    #[inline]
    pub(super) fn is_oblique(&self) -> bool {
        self.along != [0.0; 3]
    }

    /// Where the node shall be after a share of the advance.
    #[inline]
    pub(super) fn at(&self, share: f64, k: usize) -> f64 {
        self.start[k] + share * (self.end[k] - self.start[k])
    }

    /// Where it is after a step of so many.
    pub(super) fn place(&self, step: u32, steps: u32) -> [f64; 3] {
        let share = f64::from(step) / f64::from(steps);
        std::array::from_fn(|k| self.at(share, k))
    }
}

cloned_field_by_field! {
    /// State of one model: another is a branch of it. Belongs to the model that made it.
    #[derive(Debug)]
    pub(super) struct State {
        pub(super) moving: Moving,
        pub(super) constraints: Constraints,
        pub(super) control: Control,
        pub(super) points: Precise<Points<f32>, Points<f64>>,
    }
}

/// Tangent motions of all nodes along x, y and z, each for itself: an instrument mostly moves along one of them.
#[derive(Debug, Default)]
pub(super) struct Tangent(pub [Vec<[f64; 3]>; 3]);

impl Tangent {
    /// Of one node.
    pub(super) fn of(&self, n: usize) -> [[f64; 3]; 3] {
        self.0.each_ref().map(|t| t[n])
    }

    pub(super) fn set(&mut self, n: usize, own: [[f64; 3]; 3]) {
        self.0.iter_mut().zip(own).for_each(|(all, own)| all[n] = own);
    }
}

impl Clone for Tangent {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }

    fn clone_from(&mut self, other: &Self) {
        self.0.clone_from(&other.0);
    }
}

cloned_field_by_field! {
    /// Where the tissue is, and how it moves.
    #[derive(Debug)]
    pub(super) struct Moving {
        /// Nodal parameters, m.
        pub u: Vec<[f64; 3]>,
        /// Velocity relative to the tangent motion, m per step.
        pub q: Vec<[f64; 3]>,
        /// Tangent motions: displacement per metre that the instrument travels along x, y and z.
        pub tangent: Tangent,
        /// Internal force at `u`, N.
        pub f: Vec<[f64; 3]>,
        /// Factor on every mass: 1, or more where the deformed tissue's stable step is smaller.
        pub mass_factor: f64,
        /// When the material's memory was last brought up to date, s; `None` before the first pose.
        pub time: Option<f64>,
        /// What the points of a relaxing material remember, by block.
        pub memory: Vec<Memory>,
        /// What surfaces do to each node.
        pub touch: Vec<Touch>,
        /// Displacement of the instrument's surface, m.
        pub offset: [f64; 3],
        /// Slip of what a rod drags.
        pub slip: Slip,
    }
}

cloned_field_by_field! {
    /// What is kept of where the tissue is, to come back to in trouble: velocities that led into it are not worth keeping, and forces and
    /// touches follow from the rest.
    #[derive(Debug, Default)]
    pub(super) struct Kept {
        u: Vec<[f64; 3]>,
        tangent: Tangent,
        mass_factor: f64,
        pub time: Option<f64>,
        memory: Vec<Memory>,
        offset: [f64; 3],
        slip: Slip,
    }
}

impl Kept {
    pub(super) fn of(moving: &Moving) -> Self {
        let mut kept = Self::default();
        kept.keep(moving);
        kept
    }

    /// Keeps another; allocates nothing.
    pub(super) fn keep(&mut self, moving: &Moving) {
        self.u.clone_from(&moving.u);
        self.tangent.clone_from(&moving.tangent);
        self.memory.clone_from(&moving.memory);
        self.slip.clone_from(&moving.slip);
        (self.mass_factor, self.time, self.offset) = (moving.mass_factor, moving.time, moving.offset);
    }

    /// Goes back to it, at rest; forces are those of [`super::Model::recover`].
    pub(super) fn give_back(&self, moving: &mut Moving) {
        moving.u.clone_from(&self.u);
        moving.tangent.clone_from(&self.tangent);
        moving.memory.clone_from(&self.memory);
        moving.slip.clone_from(&self.slip);
        (moving.mass_factor, moving.time, moving.offset) = (self.mass_factor, self.time, self.offset);
        moving.q.fill([0.0; 3]);
        moving.touch.fill(Touch::default());
    }
}

cloned_field_by_field! {
    /// What holds the nodes.
    #[derive(Debug)]
    pub(super) struct Constraints {
        pub role: Vec<Role>,
        pub path: Vec<Path>,
        /// The instrument's surface and its way, if it has one.
        pub instrument: Option<Surface>,
        pub way: Path,
        /// The surface that the body stands on, if it isn't held there.
        pub base: Option<Surface>,
        /// The rod that drags nodes.
        pub drag: Drag,
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
        /// Whether slow modes have less inertia at present (see [`super::slow_modes`]), and the frequency that is the slowest then, over that.
        pub light: bool,
        pub faster: f64,
        /// Present estimate of the eigenvector of the largest eigenvalue of M^-1 K.
        pub probe: Vec<[f64; 3]>,
        /// That eigenvalue at the last estimate, mass factor 1.
        pub largest: f64,
        /// What has happened since masses and largest eigenvalue were brought up to date, over what may.
        pub since_refresh: f64,
        /// Travel per step of late, m.
        pub usual_travel: f64,
        pub motion: Motion,
        pub damping: AdaptiveDamping,
        /// Of each chunk of nodes, after the last advance.
        pub sums: Vec<Sums>,
        /// Of the dragged nodes, along the rod.
        pub dragged: Sums,
    }
}

impl Control {
    /// Whether masses and largest eigenvalue are to be brought up to date.
    pub(super) fn is_due(&self) -> bool {
        self.since_refresh >= 1.0
    }
}

impl State {
    /// Angular frequency of the slowest mode, rad per step.
    pub(super) fn slowest(&self) -> f64 {
        self.control.faster * self.control.slowest / self.moving.mass_factor.sqrt()
    }
}

impl Constraints {
    /// The surfaces that a free node may meet in a step of so many.
    pub(super) fn surfaces(&self, step: u32, steps: u32) -> [Option<Moved<'_>>; 2] {
        let (from, to) = (self.way.place(step - 1, steps), self.way.place(step, steps));
        [
            self.instrument.as_ref().map(|surface| Moved { surface, from, to }),
            self.base.as_ref().map(|surface| Moved { surface, from: [0.0; 3], to: [0.0; 3] }),
        ]
    }
}
