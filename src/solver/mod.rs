//! The explicit step: internal-force kernel, stable step, damping, essential boundary conditions, reactions.

pub mod block;
pub mod dilatation;
mod double;
mod fold;
mod group;
mod inertia;
pub mod kernel;
pub mod lanes;
mod mass;
mod memory;
mod passes;
mod points;
pub mod pool;
pub mod real;
mod relax;
mod state;
mod step;
mod strip;
mod work;

pub use state::{Role, Solver, SolverSettings};
pub use step::{Advance, Balance};
pub use work::StepWork;
