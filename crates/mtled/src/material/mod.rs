//! Stress from deformation: energy density and first Piola-Kirchhoff stress, one file per law.
//!
//! A material is a distortional law ([`neo_hookean`], [`ogden`], `mooney_rivlin`, `yeoh`, `veronda_westmann`,
//! or any [`IsochoricLaw`]), a
//! `volumetric` energy and, if it relaxes, a [`prony`] series; [`Law`] puts them together. Everything is a function of the deformation gradient, row-major.

pub(crate) mod invariants;
mod law;
pub(crate) mod mooney_rivlin;
pub mod neo_hookean;
pub mod ogden;
pub(crate) mod own;
pub mod prony;
pub(crate) mod shape;
pub(crate) mod stretches;
pub(crate) mod veronda_westmann;
pub(crate) mod volumetric;
pub(crate) mod yeoh;

pub use invariants::{IsochoricLaw, Slopes};
pub use law::{Distortional, Law};
pub use mooney_rivlin::MooneyRivlin;
pub use ogden::Ogden;
pub use own::{MOST_CONSTANTS, Own};
pub use prony::Prony;
pub use veronda_westmann::VerondaWestmann;
pub use volumetric::Volumetric;
pub use yeoh::Yeoh;
