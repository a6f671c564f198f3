//! Studies of the method itself: the cost of a discretisation and its error relative to independent solutions.
//!
//! - [`accuracy`] compares many discretisations of a scene with a [`reference_solution`]: the finite elements of
//!   [`mod@reference`] if there are any.
//! - [`tune`] selects one of them for a tolerance and a rate of poses, and [`correction`] learns a correction of its
//!   error. [`progress`] says how far they are.
//! - [`stability`] continues the indentation until each method fails.
//! - [`verification`] compares the shipped presets and the [`composites`] with their targets.
//! - [`matrix`] runs every instrument with every dimension, law and sample.
//! - [`sensitivity`] finds the uncertain keys that matter.
//! - [`speed`] measures the time of a step, with the [`mod@bounds`] of the machine, and [`contention`] a needle
//!   insertion under the load of other programs.
#![allow(non_snake_case)] // the code uses the formula's own symbols
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

pub mod accuracy;
pub mod bounds;
mod clock;
pub mod composites;
pub mod contention;
pub mod correction;
mod csv;
pub mod matrix;
pub mod progress;
pub mod reference;
pub mod reference_solution;
pub mod sensitivity;
pub mod speed;
pub mod stability;
pub mod tune;
pub mod verification;
