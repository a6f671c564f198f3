//! Mooney-Rivlin law (Mooney 1940, Rivlin 1948; ABAQUS *HYPERELASTIC, MOONEY-RIVLIN with C10, C01):
//!
//! ```text
//! W = C10 (J^-2/3 I1 - 3) + C01 (J^-4/3 I2 - 3)          mu = 2 (C10 + C01)
//! ```
//!
//! With C01 = 0 it is the neo-Hookean law.

use super::invariants::{IsochoricLaw, Slopes};
use crate::number::Number;

/// Constants of the law, Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MooneyRivlin {
    /// C10.
    pub c10: f64,
    /// C01.
    pub c01: f64,
}

impl IsochoricLaw<2> for MooneyRivlin {
    fn constants(&self) -> [f64; 2] {
        [self.c10, self.c01]
    }

    #[inline(always)]
    fn slopes<N: Number>(&[c10, c01]: &[N; 2], a: N, b: N) -> Slopes<N> {
        let three = N::of(3.0);
        let w = c10 * (a - three) + c01 * (b - three);
        Slopes { w, a: c10, b: c01, ..Slopes::default() }
    }
}
