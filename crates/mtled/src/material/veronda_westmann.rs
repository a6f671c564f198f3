//! Veronda and Westmann's exponential law (1970, skin), its distortional part in isochoric invariants:
//!
//! ```text
//! W = mu/c (exp(c (J^-2/3 I1 - 3)) - 1) - mu/2 (J^-4/3 I2 - 3)
//! ```
//!
//! In the paper's constants C1 = mu/c and C2 = c: W = C1 (exp(C2 (I1 - 3)) - 1) - C1 C2 / 2 (I2 - 3). The initial shear
//! modulus is 2 (mu - mu/2) = mu. From an exponent of [`LARGEST`] on the exponential goes on as its parabola, so that
//! the arithmetic stays finite until the health check sees the point.

use super::invariants::{IsochoricLaw, Slopes};
use crate::number::Number;

/// Largest exponent that is taken.
pub(crate) const LARGEST: f64 = 40.0;

/// Constants of the law.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VerondaWestmann {
    /// mu, Pa.
    pub shear_modulus: f64,
    /// c, which says how fast the tissue stiffens.
    pub exponent: f64,
}

impl IsochoricLaw<2> for VerondaWestmann {
    fn constants(&self) -> [f64; 2] {
        [self.shear_modulus, self.exponent]
    }

    #[inline(always)]
    fn slopes<N: Number>(&[mu, c]: &[N; 2], a: N, b: N) -> Slopes<N> {
        let (zero, half, one, three) = (N::default(), N::of(0.5), N::of(1.0), N::of(3.0));
        let x = c * (a - three);
        let beyond = (x - N::of(LARGEST)).max(zero);
        // exp(x) - 1, whose digits survive at small strain
        let excess = (x - beyond).exp_m1();
        let top = one + excess;
        Slopes {
            w: mu / c * (excess + top * beyond * (one + half * beyond)) - half * mu * (b - three),
            a: mu * top * (one + beyond),
            b: -(half * mu),
            aa: mu * c * top,
            ..Slopes::default()
        }
    }
}
