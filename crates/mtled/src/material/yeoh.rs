//! Yeoh's law (Yeoh 1990, 1993; ABAQUS *HYPERELASTIC, YEOH with C10, C20, C30):
//!
//! ```text
//! W = C10 x + C20 x^2 + C30 x^3,    x = J^-2/3 I1 - 3          mu = 2 C10
//! ```

use super::invariants::{IsochoricLaw, Slopes};
use crate::number::Number;

/// Constants of the law, Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Yeoh {
    /// C10.
    pub c10: f64,
    /// C20.
    pub c20: f64,
    /// C30.
    pub c30: f64,
}

impl IsochoricLaw<3> for Yeoh {
    const SECOND: bool = false;

    fn constants(&self) -> [f64; 3] {
        [self.c10, self.c20, self.c30]
    }

    #[inline(always)]
    fn slopes<N: Number>(&[c10, c20, c30]: &[N; 3], a: N, _: N) -> Slopes<N> {
        let (x, two, three) = (a - N::of(3.0), N::of(2.0), N::of(3.0));
        Slopes {
            w: x * (c10 + x * (c20 + x * c30)),
            a: c10 + x * (two * c20 + three * c30 * x),
            aa: two * c20 + N::of(6.0) * c30 * x,
            ..Slopes::default()
        }
    }
}

impl Yeoh {
    /// Whether the stress in shear grows with the strain at every strain: dW/dx > 0 for all x >= 0.
    #[must_use]
    pub fn is_stable(&self) -> bool {
        let Self { c10, c20, c30 } = *self;
        // the least slope of a parabola that opens upwards is at x = -C20 / (3 C30)
        c10 > 0.0 && c30 >= 0.0 && (c20 >= 0.0 || (c30 > 0.0 && c10 - c20 * c20 / (3.0 * c30) > 0.0))
    }
}
