//! Studies of the method itself: what a discretisation costs and how near it comes to independent solutions.
//!
//! [`accuracy`] refines the clouds of the presets and compares forces and displacements, at rest, with the finite
//! elements of [`mod@reference`]. [`stability`] drives the indentation
//! on until each method ends. [`verification`] holds the presets, as they ship, to their targets. [`speed`]
//! times the step, beside the [`mod@bounds`] of the machine.

pub mod accuracy;
pub mod bounds;
pub mod reference;
pub mod speed;
pub mod stability;
pub mod verification;
