//! [Ogden's law](super::ogden) for numbers side by side, in single precision as well: no branches, and no digits lost where stretches meet or lie
//! far apart.
//!
//! With h(c) = c g(c) and F^-T = cof F / J the stress without pressure is
//!
//! ```text
//! P = h(b) F^-T = h_2 F^-T + h_21 E + h_210 (b - c_1) E        E = (b - c_2) F^-T = F - c_2 F^-T
//! ```
//!
//! with Newton's divided differences of h at the eigenvalues c_0 >= c_1 >= c_2 of b, from the smallest on. A power with a negative exponent is
//! largest there, and F^-T has the smallest stretch's direction to all digits, which b has not. A constant taken from h adds to the
//! pressure alone: h is a sum of (J^-2/3 c)^(a_k/2) - 1.
//!
//! Largest eigenvalues are sums of positive numbers, so c_0 is that of b, and c_1 and c_2 follow from that of cof F cof F^T, which is c_0 c_1,
//! and from J^2. Two that meet come out apart by the square root of the round-off, one as much too large as the other too small, which
//! an interpolation at them does not feel; differences that are less than round-off count as round-off.
//!
//! In a half plane b is a block of two and the hoop, whose stretches are those of F in closed form: s_0 +- s_1 are the lengths of
//! (F_xx +- F_zz, F_xz -+ F_zx).

use super::invariants::Distortion;
use super::invariants::full_dot;
use super::neo_hookean::{Gradient, clamped};
use super::ogden::{LEAST, MOST_TERMS, Ogden};
use super::shape::{Shape, Wave};
use crate::number::Number;

/// Differences of eigenvalues over the larger, in units of round-off, below which they count as this.
const ROUND_OFF: f64 = 4.0;

/// One term of the law.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Term<N> {
    /// a_k / 2.
    pub half: N,
    /// 2 mu_k / a_k, Pa.
    pub factor: N,
    /// 2 mu_k / a_k^2, Pa.
    pub energy: N,
    /// |mu_k|, Pa.
    pub modulus: N,
}

/// Constants of the law; terms beyond `count` are zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretches<N> {
    pub terms: [Term<N>; MOST_TERMS],
    pub count: usize,
}

impl<N: Number> Stretches<N> {
    pub(crate) fn of(law: &Ogden) -> Self {
        let mut terms = [Term::default(); MOST_TERMS];
        for (to, t) in terms.iter_mut().zip(law.terms()) {
            let factor = 2.0 * t.shear_modulus / t.exponent;
            *to = Term {
                half: N::of(0.5 * t.exponent),
                factor: N::of(factor),
                energy: N::of(factor / t.exponent),
                modulus: N::of(t.shear_modulus.abs()),
            };
        }
        Self { terms, count: law.terms().len() }
    }
}

/// Where the terms of a law come from.
pub(crate) trait Terms<N: Number>: Copy {
    fn count(&self) -> usize;
    fn term(&self, k: usize) -> Term<N>;

    /// h at each eigenvalue, tr h and the energy density, from ln(J^-2/3 c) and (J_m - J) / (3 J_m).
    #[inline(always)]
    fn powers(&self, log: &[N; 3], lack: N) -> ([N; 3], N, N) {
        let (zero, one, two) = (N::default(), N::of(1.0), N::of(2.0));
        let (mut h, mut trace, mut energy) = ([zero; 3], zero, zero);
        // what h and its mean leave out, which differ below J_m
        let (mut base, mut mean) = (zero, zero);
        for k in 0..self.count() {
            let t = self.term(k);
            let beyond = t.factor * (one + two * t.half * lack);
            let mut sum = zero;
            for i in 0..3 {
                let excess = (t.half * log[i]).exp_m1();
                h[i] = beyond.product_sum(excess, h[i]);
                sum += excess;
            }
            trace = t.factor.product_sum(sum, trace);
            energy = t.energy.product_sum(sum, energy);
            base += beyond;
            mean += t.factor;
        }
        base = base.where_positive(lack, zero);
        for i in 0..3 {
            h[i] += base;
        }
        trace += N::of(3.0) * mean.where_positive(lack, zero);
        (h, trace, trace.product_sum(lack, energy))
    }
}

/// The larger of a difference and round-off of the larger number.
#[inline(always)]
fn gap<N: Number>(difference: N, larger: N) -> N {
    difference.max(N::of(ROUND_OFF * N::EPSILON) * larger)
}

impl<N: Number> Terms<N> for &Stretches<N> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.count
    }

    #[inline(always)]
    fn term(&self, k: usize) -> Term<N> {
        self.terms[k]
    }
}

/// The law of these terms.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OfTerms<S>(pub S);

impl<N: Number, S: Terms<N>> Shape<N> for OfTerms<S> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, cof: &Gradient<N>, j: N) -> Distortion<N> {
        let (larger, lack) = clamped(j);
        let third = N::of(1.0 / 3.0) / larger;
        let lack = lack * third;
        let root = larger.inverse_cube_root();
        let scale = root * root;
        let least = N::of(LEAST);
        let mut stress = *f;
        let (trace, energy);
        if AXISYMMETRIC {
            let det = f[0].product_sum(f[8], -(f[2] * f[6]));
            let (along, across) = (f[0] + f[8], f[2] - f[6]);
            let sum = along.product_sum(along, across * across).sqrt();
            let (along, across) = (f[0] - f[8], f[2] + f[6]);
            let difference = along.product_sum(along, across * across).sqrt();
            let s0 = N::of(0.5) * (sum + difference);
            let c0 = (s0 * s0).max(least);
            let c2 = (det * det / c0).max(least);
            let hoop = (f[4] * f[4]).max(least);
            let h;
            (h, trace, energy) = self.0.powers(&[(scale * c0).ln(), (scale * c2).ln(), (scale * hoop).ln()], lack);
            let [h0, h2, of_hoop] = h;
            let slope = (h0 - h2) / gap(sum * difference, c0);
            let inverse = det / (c0 * c2);
            let cofactor = [f[8], f[6], f[2], f[0]];
            for (i, n) in [0, 2, 6, 8].into_iter().enumerate() {
                let own = if i == 0 || i == 3 { inverse * cofactor[i] } else { -(inverse * cofactor[i]) };
                let e = (-c2).product_sum(own, f[n]);
                stress[n] = h2.product_sum(own, slope * e);
            }
            stress[4] = of_hoop * (f[4] / hoop);
        } else {
            let b = of_rows(f);
            let c0 = largest_eigenvalue(&b).max(least);
            let c01 = largest_eigenvalue(&of_rows(cof)).max(least * least);
            let c1 = (c01 / c0).max(least);
            let c2 = (j * j / c01).max(least);
            let h;
            (h, trace, energy) = self.0.powers(&[(scale * c0).ln(), (scale * c1).ln(), (scale * c2).ln()], lack);
            let [h0, h1, h2] = h;
            let (first, other) = ((h1 - h2) / gap(c1 - c2, c1), (h0 - h1) / gap(c0 - c1, c0));
            let second = (other - first) / gap(c0 - c2, c0);
            let inverse = j / (c01 * c2);
            let (mut own, mut e) = (*f, *f);
            for n in 0..9 {
                own[n] = inverse * cof[n];
                e[n] = (-c2).product_sum(own[n], f[n]);
            }
            let d = [b[0] - c1, b[1] - c1, b[2] - c1];
            for k in 0..3 {
                let [x, y, z] = [e[k], e[3 + k], e[6 + k]];
                let product = [
                    d[0].product_sum(x, b[3].product_sum(y, b[5] * z)),
                    b[3].product_sum(x, d[1].product_sum(y, b[4] * z)),
                    b[5].product_sum(x, b[4].product_sum(y, d[2] * z)),
                ];
                for i in 0..3 {
                    let n = 3 * i + k;
                    stress[n] = h2.product_sum(own[n], first.product_sum(e[n], second * product[i]));
                }
            }
        }
        Distortion { energy, stress, across: -(trace * third) }
    }

    /// As [`Ogden::stiffness`].
    #[inline(always)]
    fn stiffness(&self, wave: &Wave<'_, N>) -> N {
        let root = wave.j.inverse_cube_root();
        let (cube, least, one) = (root * root, N::of(LEAST), N::of(1.0));
        let largest = (cube * wave.largest).max(least).ln();
        let smallest = (cube * wave.j * wave.j / wave.c2).max(least).ln();
        let mut modulus = N::default();
        for k in 0..self.0.count() {
            let t = self.0.term(k);
            let power = t.half - one;
            let (a, b) = ((power * largest).exp_m1(), (power * smallest).exp_m1());
            modulus = t.modulus.product_sum(one + a.max(b), modulus);
        }
        wave.of_modulus(modulus)
    }
}

impl<N: Number> Shape<N> for Stretches<N> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, cof: &Gradient<N>, j: N) -> Distortion<N> {
        OfTerms(self).distortion::<AXISYMMETRIC>(f, cof, j)
    }

    #[inline(always)]
    fn stiffness(&self, wave: &Wave<'_, N>) -> N {
        OfTerms(self).stiffness(wave)
    }
}

/// A A^T: 11, 22, 33, 12, 23, 31.
#[inline(always)]
fn of_rows<N: Number>(a: &Gradient<N>) -> [N; 6] {
    [full_dot(a, 0, 0), full_dot(a, 3, 3), full_dot(a, 6, 6), full_dot(a, 0, 3), full_dot(a, 3, 6), full_dot(a, 6, 0)]
}

/// Largest eigenvalue of a symmetric tensor that has none below zero: that of [`super::ogden::eigenvalues`], m + 2 p cos(acos(r)/3) with
/// cos(acos(r)/3) = cos(2/3 acos u), u^2 = (1 + r)/2.
#[inline(always)]
fn largest_eigenvalue<N: Number>(a: &[N; 6]) -> N {
    let (half, one) = (N::of(0.5), N::of(1.0));
    let mean = (a[0] + a[1] + a[2]) * N::of(1.0 / 3.0);
    let mut d = [a[0] - mean, a[1] - mean, a[2] - mean, a[3], a[4], a[5]];
    let off = d[3].product_sum(d[3], d[4].product_sum(d[4], d[5] * d[5]));
    let squares = d[0].product_sum(d[0], d[1].product_sum(d[1], d[2].product_sum(d[2], off + off)));
    // all equal to round-off
    let floor = (N::of(N::EPSILON) * mean).max(N::of(f64::from(f32::MIN_POSITIVE)));
    let p = (squares * N::of(1.0 / 6.0)).sqrt().max(floor);
    let inverse = one / p;
    for x in &mut d {
        *x = *x * inverse;
    }
    let det = d[0].product_sum(
        d[1].product_sum(d[2], -(d[4] * d[4])),
        (-d[3]).product_sum(d[3].product_sum(d[2], -(d[4] * d[5])), d[5] * d[3].product_sum(d[4], -(d[1] * d[5]))),
    );
    // (1 + r)/2 in 0..1
    let square = half.product_sum(half * det, half).max(N::default());
    let square = -(-square).max(-one);
    (p + p).product_sum(square.sqrt().two_thirds_of_angle(), mean)
}
