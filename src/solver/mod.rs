//! The explicit step: internal-force kernel, stable step, damping, essential boundary conditions, reactions.

pub mod block;
pub mod dilatation;
pub mod kernel;
pub mod pool;
pub mod real;
#[cfg(target_arch = "x86_64")]
mod simd;
mod state;
mod step;

pub use state::{Role, Solver, SolverSettings};
pub use step::{Advance, Balance};
