//! Stiffness of a tube's section.

use std::f64::consts::PI;

/// A tube, or a wire whose inner diameter is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// D, m.
    pub outer_diameter: f64,
    /// d, m.
    pub inner_diameter: f64,
    /// E, Pa.
    pub youngs_modulus: f64,
}

/// Poisson's ratio of metals.
const POISSON: f64 = 0.3;

impl Section {
    /// E I with I = pi (D^4 - d^4) / 64, N m^2.
    #[must_use]
    pub fn bending_stiffness(&self) -> f64 {
        self.youngs_modulus * PI / 64.0 * (self.outer_diameter.powi(4) - self.inner_diameter.powi(4))
    }

    /// G J with G = E / (2 (1 + nu)), nu = 0.3 as metals have it, and J = pi (D^4 - d^4) / 32, N m^2.
    #[must_use]
    pub fn torsional_stiffness(&self) -> f64 {
        self.bending_stiffness() / (1.0 + POISSON)
    }

    /// E A with A = pi (D^2 - d^2) / 4, N.
    #[must_use]
    pub fn stretching_stiffness(&self) -> f64 {
        self.youngs_modulus * PI / 4.0 * (self.outer_diameter.powi(2) - self.inner_diameter.powi(2))
    }
}
