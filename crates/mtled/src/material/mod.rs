//! Stress from deformation: energy density and first Piola-Kirchhoff stress, one file per law.
//!
//! A material is a distortional law ([`neo_hookean`] or [`ogden`]), a [`volumetric`] energy and, if it relaxes, a
//! [`prony`] series; [`Law`] puts them together. Everything is a function of the deformation gradient, row-major.

mod law;
pub mod neo_hookean;
pub mod ogden;
pub mod prony;
pub mod volumetric;

pub use law::{Distortional, Law};
pub use ogden::Ogden;
pub use prony::Prony;
pub use volumetric::Volumetric;
