//! The explicit step: internal-force kernel, stable step, damping, essential boundary conditions, reactions.

pub mod block;
pub mod dilatation;
pub mod kernel;
mod mass;
mod memory;
mod points;
pub mod pool;
pub mod real;
mod relax;
#[cfg(target_arch = "x86_64")]
mod simd;
mod state;
mod step;

pub use state::{Role, Solver, SolverSettings};
pub use step::{Advance, Balance};
