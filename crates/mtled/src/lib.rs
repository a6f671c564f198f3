//! MTLED: Meshless Total Lagrangian Explicit Dynamics for soft tissue (Horton, Wittek, Joldes, Miller 2010; Joldes et al.
//! 2019), as a library that knows no needle, no file format of a scene and no middleware.
//!
//! ```text
//! cloud ─► approximation ─► material ─► solver
//! points     shape table      stress     explicit steps
//! ```
//!
//! Everything is in metres, pascals, newtons; a step has no unit of time, since the motion is quasi-static and masses are
//! scaled until one step is stable.
#![allow(non_snake_case)] // the code uses the formula's own symbols: F, P, J
#![deny(unsafe_code, clippy::undocumented_unsafe_blocks, clippy::multiple_unsafe_ops_per_block)]

pub mod approximation;
pub mod cloud;
pub mod material;
pub mod number;
pub mod solver;
