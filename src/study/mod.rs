//! Studies of the method itself: what a discretisation costs and how near it comes to independent solutions.
//!
//! [`accuracy`] refines the clouds of the presets and compares forces and displacements, at rest, with the finite
//! elements of [`mod@reference`].

pub mod accuracy;
pub mod reference;
