//! Veronda and Westmann's exponential law (1970, skin), its distortional part in isochoric invariants:
//!
//! ```text
//! W = mu/c (exp(c (J^-2/3 I1 - 3)) - 1) - mu/2 (J^-4/3 I2 - 3)
//! ```
//!
//! In the paper's constants C1 = mu/c and C2 = c: W = C1 (exp(C2 (I1 - 3)) - 1) - C1 C2 / 2 (I2 - 3). The initial shear
//! modulus is 2 (mu - mu/2) = mu. From an exponent of [`LARGEST`] on the exponential goes on as its parabola, so that
//! the arithmetic stays finite until the health check sees the point.

use super::invariants::Slopes;

/// Largest exponent that is taken.
pub const LARGEST: f64 = 40.0;

/// Constants of the law.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VerondaWestmann {
    /// mu, Pa.
    pub shear_modulus: f64,
    /// c, which says how fast the tissue stiffens.
    pub exponent: f64,
}

impl VerondaWestmann {
    /// w(a, b) with its derivatives.
    #[must_use]
    pub fn slopes(&self, a: f64, b: f64) -> Slopes {
        let Self { shear_modulus: mu, exponent: c } = *self;
        let x = c * (a - 3.0);
        let beyond = (x - LARGEST).max(0.0);
        let top = x.min(LARGEST).exp();
        // exp(x) - 1, whose digits survive at small strain
        let excess = x.min(LARGEST).exp_m1() + top * beyond * (1.0 + 0.5 * beyond);
        Slopes {
            w: mu / c * excess - 0.5 * mu * (b - 3.0),
            a: mu * top * (1.0 + beyond),
            b: -0.5 * mu,
            aa: mu * c * top,
            ..Slopes::default()
        }
    }
}
