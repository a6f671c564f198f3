//! The explicit step: internal-force kernel, stable step, damping, essential boundary conditions, reactions.

mod adaptive_damping;
mod aside;
mod backoff;
mod block;
mod cloned;
mod collapse;
mod contact;
mod dilatation;
#[allow(unsafe_code)] // parts of a slice for several threads
mod disjoint;
mod drag;
mod explicit;
mod free;
#[allow(unsafe_code)] // what the owner of a phase tells its helpers
mod gate;
mod half;
mod inertia;
mod kernel;
mod mass;
mod memory;
mod mixed;
mod model;
mod nodes;
mod passes;
mod points;
#[allow(unsafe_code)] // threads that run a borrowed closure
mod pool;
mod projection;
mod relax;
mod rest;
mod settings;
mod slide;
mod slip;
mod slow_modes;
mod state;
mod step;
mod strip;
mod surface;
mod sync;
mod team;
mod vertices;
mod work;

pub use contact::Surface;
pub use drag::{End, Grip, Wall};
pub use explicit::Solver;
pub use kernel::{InternalForce, Kernel};
pub use model::Model;
pub use pool::Pool;
pub use settings::{Precision, SolverSettings, VolumeRatio};
pub use slide::Rate;
pub use state::Role;
pub use step::{Advance, Balance};
pub use surface::{Inside, Shape};
pub use team::{Members, Team};
pub use work::StepWork;
