//! Mooney-Rivlin law (Mooney 1940, Rivlin 1948; ABAQUS *HYPERELASTIC, MOONEY-RIVLIN with C10, C01):
//!
//! ```text
//! W = C10 (J^-2/3 I1 - 3) + C01 (J^-4/3 I2 - 3)          mu = 2 (C10 + C01)
//! ```
//!
//! With C01 = 0 it is the neo-Hookean law.

use super::invariants::{OfInvariants, Slopes};
use crate::number::Number;

/// Constants of the law, Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MooneyRivlin<N = f64> {
    /// C10.
    pub c10: N,
    /// C01.
    pub c01: N,
}

impl MooneyRivlin {
    /// Initial shear modulus, Pa.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        2.0 * (self.c10 + self.c01)
    }
}

impl<N: Number> OfInvariants<N> for MooneyRivlin<N> {
    const SECOND: bool = true;

    #[inline(always)]
    fn slopes(&self, a: N, b: N) -> Slopes<N> {
        let three = N::of(3.0);
        let w = self.c10 * (a - three) + self.c01 * (b - three);
        Slopes { w, a: self.c10, b: self.c01, ..Slopes::default() }
    }
}
