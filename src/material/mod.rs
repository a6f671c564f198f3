//! Stress from deformation: energy density and first Piola-Kirchhoff stress.

pub mod neo_hookean;
