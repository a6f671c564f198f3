//! The explicit step: internal-force kernel, stable step, damping, essential boundary conditions, reactions.

pub mod block;
pub mod dilatation;
mod double;
mod fold;
mod group;
mod inertia;
pub mod kernel;
mod mass;
mod memory;
mod passes;
mod points;
pub mod pool;
mod relax;
mod settings;
mod state;
mod step;
mod strip;
mod work;

pub use settings::{Precision, SolverSettings, VolumeRatio};
pub use state::{Role, Solver};
pub use step::{Advance, Balance};
pub use work::StepWork;
