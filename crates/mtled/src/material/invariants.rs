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

use std::fmt::Debug;

#[cfg(doc)]
use super::neo_hookean::MIN_JACOBIAN;
use super::neo_hookean::{Gradient, clamped, first_invariant_in, is_there};
use crate::number::Number;

/// Distortional energy density (J/m^3) and first Piola-Kirchhoff stress `stress + across cof F` (Pa), without pressure.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Distortion<N> {
    pub energy: N,
    pub stress: Gradient<N>,
    pub across: N,
}

impl Distortion<f64> {
    /// Both parts of the stress.
    pub(crate) fn summed(self, cof: &Gradient<f64>) -> (f64, Gradient<f64>) {
        (self.energy, std::array::from_fn(|n| self.stress[n] + self.across * cof[n]))
    }
}

/// Energy density of a law and its derivatives with respect to a and b, Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slopes<N> {
    /// w.
    pub w: N,
    /// dw/da.
    pub a: N,
    /// dw/db.
    pub b: N,
    /// d2w/da2.
    pub aa: N,
    /// d2w/da db.
    pub ab: N,
    /// d2w/db2.
    pub bb: N,
}

/// A law of the change of shape, w(a, b) with C constants, in the isochoric invariants a = J^-2/3 I1 and b = J^-4/3 I2; both are 3 in the
/// undeformed state, where w is 0.
///
/// All built-in laws but Ogden's are implementations; [`Own`](super::Own) makes a material of any other. Its
/// [`slopes`](Self::slopes) are compiled for numbers that stand eight side by side in a register, so that there is no choice between
/// points. `tests/material.rs` checks one by differences as it does the built-in ones.
pub trait IsochoricLaw<const C: usize>: Copy + Debug + Send + Sync + 'static {
    /// Whether w depends on b.
    const SECOND: bool = true;
    /// The constants, of which [`slopes`](Self::slopes) gets each as often as there are points side by side.
    fn constants(&self) -> [f64; C];
    /// w with its derivatives, J/m^3. Must be inlined to be fast: `#[inline(always)]`.
    fn slopes<N: Number>(constants: &[N; C], a: N, b: N) -> Slopes<N>;

    /// Initial shear modulus 2 (w_a + w_b), Pa.
    fn shear_modulus(&self) -> f64 {
        let at_rest = Self::slopes(&self.constants(), 3.0, 3.0);
        2.0 * (at_rest.a + at_rest.b)
    }
}

/// J^-2/3, a, and b if it is asked for.
#[inline(always)]
fn invariants<N: Number, const AXISYMMETRIC: bool>(f: &Gradient<N>, cof: &Gradient<N>, j: N, second: bool) -> [N; 3] {
    let r = j.inverse_cube_root();
    let scale = r * r;
    let b = if second { scale * scale * first_invariant_in::<N, AXISYMMETRIC>(cof) } else { N::default() };
    [scale, scale * first_invariant_in::<N, AXISYMMETRIC>(f), b]
}

/// Distortional energy density and first Piola-Kirchhoff stress without pressure, Pa.
#[inline(always)]
pub(crate) fn evaluate<N: Number, L: IsochoricLaw<C>, const C: usize, const AXISYMMETRIC: bool>(
    constants: &[N; C],
    f: &Gradient<N>,
    cof: &Gradient<N>,
    j: N,
) -> Distortion<N> {
    let (j, lack) = clamped(j);
    let [scale, a, b] = invariants::<N, AXISYMMETRIC>(f, cof, j, L::SECOND);
    let s = L::slopes(constants, a, b);
    let two = N::of(2.0);
    let third = N::of(1.0 / 3.0) / j;
    let e = two * lack * third;
    let (mut by_volume, mut w_a) = (a * s.a, s.a + e * a.product_sum(s.aa, s.a));
    let mut w_b = N::default();
    if L::SECOND {
        by_volume = (two * b).product_sum(s.b, by_volume);
        w_a += two * e * b * s.ab;
        w_b = s.b + e * (two * s.b + a * s.ab + two * b * s.bb);
    }
    let mut stress = *f;
    let along = two * scale * w_a;
    if L::SECOND {
        // I1 F - F F^T F
        let across = two * scale * scale * w_b;
        let along = across.product_sum(first_invariant_in::<N, AXISYMMETRIC>(f), along);
        let cube = cube::<N, AXISYMMETRIC>(f);
        for n in 0..9 {
            if is_there::<AXISYMMETRIC>(n) {
                stress[n] = along.product_sum(f[n], -(across * cube[n]));
            }
        }
    } else {
        for n in 0..9 {
            if is_there::<AXISYMMETRIC>(n) {
                stress[n] = along * f[n];
            }
        }
    }
    Distortion { energy: s.w + e * by_volume, stress, across: -(two * by_volume * third) }
}

/// F F^T F.
#[inline(always)]
fn cube<N: Number, const AXISYMMETRIC: bool>(f: &Gradient<N>) -> Gradient<N> {
    let mut out = *f;
    if AXISYMMETRIC {
        let (a, b, c) = (dot(f, 0, 0), dot(f, 6, 6), dot(f, 0, 6));
        for k in [0, 2] {
            out[k] = a.product_sum(f[k], c * f[6 + k]);
            out[6 + k] = c.product_sum(f[k], b * f[6 + k]);
        }
        out[4] = f[4] * f[4] * f[4];
        return out;
    }
    let [xx, yy, zz] = [full_dot(f, 0, 0), full_dot(f, 3, 3), full_dot(f, 6, 6)];
    let [xy, yz, zx] = [full_dot(f, 0, 3), full_dot(f, 3, 6), full_dot(f, 6, 0)];
    for k in 0..3 {
        let [x, y, z] = [f[k], f[3 + k], f[6 + k]];
        out[k] = xx.product_sum(x, xy.product_sum(y, zx * z));
        out[3 + k] = xy.product_sum(x, yy.product_sum(y, yz * z));
        out[6 + k] = zx.product_sum(x, yz.product_sum(y, zz * z));
    }
    out
}

/// Inner product of two rows of F, by their first components, of the half plane.
#[inline(always)]
fn dot<N: Number>(f: &Gradient<N>, a: usize, b: usize) -> N {
    f[a].product_sum(f[b], f[a + 2] * f[b + 2])
}

/// The same of all three.
#[inline(always)]
pub(super) fn full_dot<N: Number>(f: &Gradient<N>, a: usize, b: usize) -> N {
    f[a].product_sum(f[b], f[a + 1].product_sum(f[b + 1], f[a + 2] * f[b + 2]))
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
#[inline(always)]
pub(crate) fn stiffness<N: Number, L: IsochoricLaw<C>, const C: usize>(
    constants: &[N; C],
    f: &Gradient<N>,
    cof: &Gradient<N>,
    j: N,
    largest: N,
    c2: N,
) -> N {
    let [scale, a, b] = invariants::<N, false>(f, cof, j, true);
    let s = L::slopes(constants, a, b);
    let (zero, one, two) = (N::default(), N::of(1.0), N::of(2.0));
    let (i1, i2, l, c) = (a / scale, b / (scale * scale), largest.sqrt(), c2.sqrt() / j);
    let first = two * scale * (l + i1 * c * N::of(1.0 / 3.0));
    let second = two * scale * scale * (l * i1 + two * i2 * c * N::of(1.0 / 3.0));
    two * s.a.max(-s.a) * scale * (one + N::of(5.0 / 9.0) * i1 * c * c)
        + two * s.b.max(-s.b) * scale * scale * (two * largest + N::of(14.0 / 9.0) * i2 * c * c)
        + s.aa.max(zero) * first * first
        + two * s.ab.max(zero) * first * second
        + s.bb.max(zero) * second * second
}
