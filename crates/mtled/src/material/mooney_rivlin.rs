//! Mooney-Rivlin law (Mooney 1940, Rivlin 1948; ABAQUS *HYPERELASTIC, MOONEY-RIVLIN with C10, C01):
//!
//! ```text
//! W = C10 (J^-2/3 I1 - 3) + C01 (J^-4/3 I2 - 3)          mu = 2 (C10 + C01)
//! ```
//!
//! With C01 = 0 it is the neo-Hookean law.

use super::invariants::Slopes;

/// Constants of the law, Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MooneyRivlin {
    /// C10.
    pub c10: f64,
    /// C01.
    pub c01: f64,
}

impl MooneyRivlin {
    /// Initial shear modulus, Pa.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        2.0 * (self.c10 + self.c01)
    }

    /// w(a, b) with its derivatives.
    #[must_use]
    pub fn slopes(&self, a: f64, b: f64) -> Slopes {
        let w = self.c10 * (a - 3.0) + self.c01 * (b - 3.0);
        Slopes { w, a: self.c10, b: self.c01, ..Slopes::default() }
    }
}
