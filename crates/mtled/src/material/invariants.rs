//! Stress of a law in the isochoric invariants a = J^-2/3 I1 and b = J^-4/3 I2, with I1 = F : F, I2 = cof F : cof F:
//!
//! ```text
//! P = 2 w_a J^-2/3 F + 2 w_b J^-4/3 (I1 F - F F^T F) - (2 a w_a + 4 b w_b) / (3 J) cof F
//! ```
//!
//! Below J_m ([`MIN_JACOBIAN`]) W goes on along its tangent in J, with J_m for J in a and b and e = 2 (J_m - J) / (3 J_m):
//!
//! ```text
//! W = w + e (a w_a + 2 b w_b)       w_a -> w_a + e (w_a + a w_aa + 2 b w_ab)     w_b -> w_b + e (2 w_b + a w_ab + 2 b w_bb)
//! ```
//!
//! in the first two terms of P.

#[cfg(doc)]
use super::neo_hookean::MIN_JACOBIAN;
use super::neo_hookean::{Gradient, clamped};
use crate::number::Number;

/// Energy density of a law and its derivatives with respect to a and b, Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slopes {
    /// w.
    pub w: f64,
    /// dw/da.
    pub a: f64,
    /// dw/db.
    pub b: f64,
    /// d2w/da2.
    pub aa: f64,
    /// d2w/da db.
    pub ab: f64,
    /// d2w/db2.
    pub bb: f64,
}

/// J^-2/3, a and b.
fn invariants(f: &Gradient<f64>, cof: &Gradient<f64>, j: f64) -> (f64, [f64; 2]) {
    let r = j.inverse_cube_root();
    let square = |m: &Gradient<f64>| m.iter().map(|x| x * x).sum::<f64>();
    let scale = r * r;
    (scale, [scale * square(f), scale * scale * square(cof)])
}

/// Distortional energy density and first Piola-Kirchhoff stress without pressure, Pa, of a law w(a, b).
#[must_use]
pub fn evaluate(
    law: impl Fn(f64, f64) -> Slopes,
    f: &Gradient<f64>,
    cof: &Gradient<f64>,
    j: f64,
) -> (f64, Gradient<f64>) {
    let (j, lack) = clamped(j);
    let (scale, [a, b]) = invariants(f, cof, j);
    let s = law(a, b);
    let e = 2.0 * lack / (3.0 * j);
    let by_volume = a * s.a + 2.0 * b * s.b;
    let w_a = s.a + e * (s.a + a * s.aa + 2.0 * b * s.ab);
    let w_b = s.b + e * (2.0 * s.b + a * s.ab + 2.0 * b * s.bb);
    let i1 = a / scale;
    // F F^T F
    let cube: Gradient<f64> = if w_b == 0.0 { [0.0; 9] } else { cube(f) };
    let (along, across) = (2.0 * scale * w_a, 2.0 * scale * scale * w_b);
    let pressure = 2.0 * by_volume / (3.0 * j);
    let stress = std::array::from_fn(|n| along * f[n] + across * (i1 * f[n] - cube[n]) - pressure * cof[n]);
    (s.w + e * by_volume, stress)
}

fn cube(f: &Gradient<f64>) -> Gradient<f64> {
    let dot = |i: usize, k: usize| (0..3).map(|m| f[3 * i + m] * f[3 * k + m]).sum::<f64>();
    let left: Gradient<f64> = std::array::from_fn(|n| dot(n / 3, n % 3));
    std::array::from_fn(|n| (0..3).map(|m| left[n / 3 * 3 + m] * f[3 * m + n % 3]).sum())
}

/// A bound on the stiffness (Pa) of a plane wave a (x) N of the law, with `largest` the square of the largest singular
/// value of F, `c2` that of cof F and J clamped:
///
/// ```text
/// 2 w_a J^-2/3 (1 + 5/9 I1 c^2 / J^2) + 2 w_b J^-4/3 (2 l^2 + 14/9 I2 c^2 / J^2) + w_aa (a')^2 + 2 w_ab a' b' + w_bb (b')^2
/// a' = 2 J^-2/3 (l + I1 c / (3 J)),    b' = 2 J^-4/3 (l I1 + 2 I2 c / (3 J))
/// ```
///
/// from |dF : N (x) a| <= l for F and the linearity of cof F along a (x) N. Negative curvature is left out.
#[must_use]
pub fn stiffness(
    law: impl Fn(f64, f64) -> Slopes,
    f: &Gradient<f64>,
    cof: &Gradient<f64>,
    j: f64,
    largest: f64,
    c2: f64,
) -> f64 {
    let (scale, [a, b]) = invariants(f, cof, j);
    let s = law(a, b);
    let (i1, i2, l, c) = (a / scale, b / (scale * scale), largest.sqrt(), c2.sqrt() / j);
    let first = 2.0 * scale * (l + i1 * c / 3.0);
    let second = 2.0 * scale * scale * (l * i1 + 2.0 * i2 * c / 3.0);
    2.0 * s.a.abs() * scale * (1.0 + 5.0 / 9.0 * i1 * c * c)
        + 2.0 * s.b.abs() * scale * scale * (2.0 * largest + 14.0 / 9.0 * i2 * c * c)
        + s.aa.max(0.0) * first * first
        + 2.0 * s.ab.max(0.0) * first * second
        + s.bb.max(0.0) * second * second
}
