//! Exponential, logarithm and a cosine in single precision: sums, products and bits, so that arrays and registers have the same bits on every
//! processor. A double has the library's.
//!
//! ```text
//! exp x = 2^n exp r            n = round(x / ln 2)        |r| <= ln 2 / 2       exp r - 1 = r + r^2/2 + ... + r^7/7!
//! ln x  = e ln 2 + ln m        m in 1/2^1/2 .. 2^1/2      ln m = 2 (s + s^3/3 + ... + s^9/9),   s = (m - 1)/(m + 1)
//! ```
//!
//! What the series leave out is below 2e-8 of exp r - 1 and 1e-8 of ln m. With rounding: exp(x) - 1 within 3e-7 of itself for |x| < 1 and
//! within 3e-7 of exp x elsewhere, ln x within 3e-7 of itself.

use super::real::Number;

/// Bits of 1.0.
pub(super) const ONE: i32 = 0x3f80_0000;
/// Bits of 2^-1/2, rounded down.
pub(super) const LEAST_FRACTION: i32 = 0x3f35_04f3;
/// 1.5 2^23: a sum with it has no digits behind the point, and the whole part in its lowest bits.
const WHOLE: f64 = 12_582_912.0;
/// Exponents beyond count as this: products of their powers with moduli are finite.
const LARGEST: f64 = 60.0;
/// ln 2 in two parts, of which products of the first with whole numbers up to 128 are exact.
const LN_2: [f64; 2] = [0.693_359_375, -2.121_944_4e-4];
/// 1/2! to 1/7!.
const OF_EXP: [f64; 6] = [1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0];
/// 2/3 to 2/9.
const OF_LN: [f64; 4] = [2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0];
/// cos(2/3 acos u), u in 0..1: interpolation at the nine Chebyshev points, within 4e-9. (Analytic up to u = -1.)
const OF_ANGLE: [f64; 9] = [
    0.500_000_004,
    0.577_349_661,
    -0.111_094_493,
    0.053_279_350_9,
    -0.031_925_412_2,
    0.019_600_321,
    -0.010_237_508_5,
    0.003_654_119_65,
    -0.000_626_045_344,
];

/// What a number in single precision can do with its bits.
pub(super) trait Single: Number {
    /// 2^n from n + [`WHOLE`], n in -126..128.
    #[must_use]
    fn power_of_two(self) -> Self;
    /// m and e of x = m 2^e, m from 2^-1/2 to 2^1/2.
    fn split(self) -> [Self; 2];
}

impl Single for f32 {
    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self::from_bits((self.to_bits() << 23).wrapping_add(ONE.cast_unsigned()))
    }
    #[inline(always)]
    fn split(self) -> [Self; 2] {
        let bits = self.to_bits().cast_signed();
        let exponent = bits.wrapping_sub(LEAST_FRACTION) >> 23;
        [Self::from_bits(bits.wrapping_sub(exponent << 23).cast_unsigned()), exponent as Self]
    }
}

/// c_0 + c_1 x + ...
#[inline(always)]
fn polynomial<N: Number, const COUNT: usize>(c: &[f64; COUNT], x: N) -> N {
    let mut sum = N::of(c[COUNT - 1]);
    for i in (0..COUNT - 1).rev() {
        sum = sum.fma(x, N::of(c[i]));
    }
    sum
}

/// exp(x) - 1; beyond 60 as at 60.
#[inline(always)]
pub(super) fn exp_m1<N: Single>(x: N) -> N {
    let x = -(-x.max(N::of(-LARGEST))).max(N::of(-LARGEST));
    let shifted = x.fma(N::of(std::f64::consts::LOG2_E), N::of(WHOLE));
    let n = shifted - N::of(WHOLE);
    let r = n.fma(N::of(-LN_2[1]), n.fma(N::of(-LN_2[0]), x));
    let own = (r * r).fma(polynomial(&OF_EXP, r), r);
    let power = shifted.power_of_two();
    power.fma(own, power - N::of(1.0))
}

/// ln x, x > 0 and normal.
#[inline(always)]
pub(super) fn ln<N: Single>(x: N) -> N {
    let [m, e] = x.split();
    let one = N::of(1.0);
    let s = (m - one) / (m + one);
    let z = s * s;
    let of_m = (s * z).fma(polynomial(&OF_LN, z), s + s);
    e.fma(N::of(LN_2[0]), e.fma(N::of(LN_2[1]), of_m))
}

/// cos(2/3 acos u).
#[inline(always)]
pub(super) fn two_thirds_of_angle<N: Number>(u: N) -> N {
    polynomial(&OF_ANGLE, u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_precision_is_within_the_stated_bounds() {
        let (mut of_exp, mut of_ln, mut of_angle) = (0.0_f64, 0.0_f64, 0.0_f64);
        let count = if cfg!(miri) { 200 } else { 200_000 };
        for i in 0..=count {
            let share = f64::from(i) / f64::from(count);
            let x = (-60.0 + 120.0 * share) as f32;
            for x in [x, 0.01 * x, 1e-5 * x] {
                let exact = f64::from(x).exp_m1();
                let scale = if x.abs() < 1.0 { exact.abs() } else { f64::from(x).exp().max(1.0) };
                of_exp = of_exp.max((f64::from(exp_m1(x)) - exact).abs() / scale.max(1e-30));
            }
            let x = 10.0_f64.powf(-37.0 + 75.0 * share) as f32;
            for x in [x, 0.5 + 1.5 * share as f32, 1.0 + 1e-4 * share as f32] {
                let exact = f64::from(x).ln();
                of_ln = of_ln.max((f64::from(ln(x)) - exact).abs() / exact.abs().max(1e-30));
            }
            let u = share as f32;
            of_angle = of_angle.max((f64::from(two_thirds_of_angle(u)) - f64::from(u).two_thirds_of_angle()).abs());
        }
        assert!(of_exp < 3e-7 && of_ln < 3e-7 && of_angle < 1.5e-7, "{of_exp:e} {of_ln:e} {of_angle:e}");
        assert!(exp_m1(1000.0_f32).is_finite() && exp_m1(-1000.0_f32) == -1.0);
    }
}
