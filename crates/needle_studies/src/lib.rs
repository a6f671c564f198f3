//! Studies of the method itself: what a discretisation costs and how near it comes to independent solutions.
//!
//! [`accuracy`] holds many discretisations of a scene against a [`reference_solution`], which is the finite elements of
//! [`mod@reference`] where there are any; [`tune`] picks one of them for a tolerance and a rate of poses, and [`correction`] learns what it lacks. [`stability`]
//! drives the indentation on until each method ends. [`verification`] holds the presets, as they ship, and [`composites`] to their targets.
//! [`sensitivity`] says which uncertain key matters. [`speed`] times the step, beside the [`mod@bounds`] of the machine, and
//! [`contention`] a needle beside other programs.
#![allow(non_snake_case)] // the code uses the formula's own symbols
#![forbid(unsafe_code)]

pub mod accuracy;
pub mod bounds;
mod clock;
pub mod composites;
pub mod contention;
pub mod correction;
mod csv;
pub mod reference;
pub mod reference_solution;
pub mod sensitivity;
pub mod speed;
pub mod stability;
pub mod tune;
pub mod verification;
