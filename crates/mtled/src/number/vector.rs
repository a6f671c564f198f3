//! Vectors in the processor's registers, for the loops over points.
//!
//! [`Lanes`] are arrays, and whether a compiler makes vectors of loops over them is its own affair: it does for what is as simple as a sum,
//! and stops where a loop becomes long. What a [`Vector`] does is one instruction wherever it stands, if all that stands round it is inlined: so no
//! closure may have one in its hands, nor `array::map`. The bits are those of the arrays.

use super::lanes::{LANES, Lanes};
use super::real::{Number, Real};

/// Eight numbers in a register.
pub trait Vector<T: Real>: Number {
    /// The same number in every lane.
    fn splat(x: T) -> Self;
    /// From memory.
    fn load(from: &Lanes<T>) -> Self;
    /// To memory.
    fn store(self) -> Lanes<T>;
    /// Of numbers as they are kept in memory.
    fn widen(stored: &[T::Stored; LANES]) -> Self;
    /// The smaller of two; `other` where either is not a number.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// Whether every lane is zero.
    fn is_zero(self) -> bool;
}

impl<T: Real> Vector<T> for Lanes<T> {
    #[inline(always)]
    fn splat(x: T) -> Self {
        Self::splat(x)
    }
    #[inline(always)]
    fn load(from: &Lanes<T>) -> Self {
        *from
    }
    #[inline(always)]
    fn store(self) -> Lanes<T> {
        self
    }
    #[inline(always)]
    fn widen(stored: &[T::Stored; LANES]) -> Self {
        Self::load(stored)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn is_zero(self) -> bool {
        self == Self::default()
    }
}

/// Vectors of several components each.
#[inline(always)]
pub(crate) fn load_all<T: Real, V: Vector<T>, const N: usize>(from: &[Lanes<T>; N]) -> [V; N] {
    let mut out = [V::default(); N];
    for i in 0..N {
        out[i] = V::load(&from[i]);
    }
    out
}

/// A loop over points. Everything that `go` calls in it must be inlined.
pub trait Pass<T: Real> {
    /// Runs it with one kind of vectors.
    fn go<V: Vector<T>>(self);
}

/// Runs a pass with the widest vectors of eight that the processor has.
#[inline]
pub(crate) fn run_pass<T: Real>(pass: impl Pass<T>) {
    T::run_pass(pass);
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::run_avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64 as x86;
    use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

    use super::super::elementary::{self, LEAST_FRACTION, ONE, Single};
    use super::{LANES, Lanes, Number, Pass, Real, Vector};

    /// Runs a pass in single precision.
    #[target_feature(enable = "avx2,fma")]
    pub(crate) fn run_avx2(pass: impl Pass<f32>) {
        pass.go::<Eight>();
    }

    /// Numbers in one register. There is none outside [`run_avx2`], so that the processor has the instructions.
    #[derive(Clone, Copy, Debug)]
    struct Eight(x86::__m256);

    /// A number's instruction.
    macro_rules! instruction {
        ($($call:expr),+) => {
            // SAFETY: the processor has AVX2 and FMA, see [`Eight`].
            Eight(unsafe { $($call),+ })
        };
    }

    impl Default for Eight {
        #[inline(always)]
        fn default() -> Self {
            instruction!(x86::_mm256_setzero_ps())
        }
    }

    /// Operators, each an instruction of two registers.
    macro_rules! operators {
        ($($operator:ident::$method:ident: $instruction:ident,)+) => {$(
            impl $operator for Eight {
                type Output = Self;
                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    instruction!(x86::$instruction(self.0, other.0))
                }
            }
        )+};
    }

    operators! {
        Add::add: _mm256_add_ps,
        Sub::sub: _mm256_sub_ps,
        Mul::mul: _mm256_mul_ps,
        Div::div: _mm256_div_ps,
    }

    impl Neg for Eight {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            instruction!(negative(self.0))
        }
    }

    impl AddAssign for Eight {
        #[inline(always)]
        fn add_assign(&mut self, other: Self) {
            *self = *self + other;
        }
    }

    impl Number for Eight {
        const EPSILON: f64 = f32::EPSILON as f64;
        #[inline(always)]
        fn of(x: f64) -> Self {
            Self::splat(x as f32)
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            instruction!(x86::_mm256_max_ps(self.0, other.0))
        }
        #[inline(always)]
        fn fma(self, b: Self, c: Self) -> Self {
            instruction!(x86::_mm256_fmadd_ps(self.0, b.0, c.0))
        }
        #[inline(always)]
        fn product_sum(self, b: Self, c: Self) -> Self {
            self.fma(b, c)
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            instruction!(x86::_mm256_sqrt_ps(self.0))
        }
        #[inline(always)]
        fn inverse_cube_root(self) -> Self {
            let mut y = self.inverse_cube_root_estimate();
            for _ in 0..f32::CUBE_ROOT_ITERATIONS {
                y = super::super::real::inverse_cube_root_iteration(self, y);
            }
            y
        }
        #[inline(always)]
        fn where_positive(self, condition: Self, other: Self) -> Self {
            instruction!(select(condition.0, self.0, other.0))
        }
        #[inline(always)]
        fn exp_m1(self) -> Self {
            elementary::exp_m1(self)
        }
        #[inline(always)]
        fn ln(self) -> Self {
            elementary::ln(self)
        }
        #[inline(always)]
        fn two_thirds_of_angle(self) -> Self {
            elementary::two_thirds_of_angle(self)
        }
    }

    impl Single for Eight {
        #[inline(always)]
        fn power_of_two(self) -> Self {
            instruction!(power_of_two(self.0))
        }
        #[inline(always)]
        fn split(self) -> [Self; 2] {
            // SAFETY: the processor has AVX2, see [`Eight`].
            let [fraction, exponent] = unsafe { split(self.0) };
            [Eight(fraction), Eight(exponent)]
        }
    }

    /// [`Single::power_of_two`].
    #[inline]
    #[target_feature(enable = "avx2")]
    fn power_of_two(x: x86::__m256) -> x86::__m256 {
        let bits = x86::_mm256_slli_epi32::<23>(x86::_mm256_castps_si256(x));
        x86::_mm256_castsi256_ps(x86::_mm256_add_epi32(bits, x86::_mm256_set1_epi32(ONE)))
    }

    /// [`Single::split`].
    #[inline]
    #[target_feature(enable = "avx2")]
    fn split(x: x86::__m256) -> [x86::__m256; 2] {
        let bits = x86::_mm256_castps_si256(x);
        let exponent =
            x86::_mm256_srai_epi32::<23>(x86::_mm256_sub_epi32(bits, x86::_mm256_set1_epi32(LEAST_FRACTION)));
        let fraction = x86::_mm256_sub_epi32(bits, x86::_mm256_slli_epi32::<23>(exponent));
        [x86::_mm256_castsi256_ps(fraction), x86::_mm256_cvtepi32_ps(exponent)]
    }

    impl Eight {
        /// [`Real::inverse_cube_root_estimate`].
        #[inline(always)]
        fn inverse_cube_root_estimate(self) -> Self {
            instruction!(estimate(self.0))
        }
    }

    /// A third of the bits is the upper half of their product with 2/3 of 2^32, halved; that from the estimate of zero, whose bits are zero.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn estimate(x: x86::__m256) -> x86::__m256 {
        let all = x86::_mm256_set1_epi32(0.0_f32.inverse_cube_root_estimate().to_bits().cast_signed());
        let (bits, two_thirds) = (x86::_mm256_castps_si256(x), x86::_mm256_set1_epi64x(0xaaaa_aaab));
        let even = x86::_mm256_srli_epi64::<33>(x86::_mm256_mul_epu32(bits, two_thirds));
        let odd = x86::_mm256_mul_epu32(x86::_mm256_srli_epi64::<32>(bits), two_thirds);
        let third = x86::_mm256_blend_epi32::<0b1010_1010>(even, x86::_mm256_srli_epi64::<1>(odd));
        x86::_mm256_castsi256_ps(x86::_mm256_sub_epi32(all, third))
    }

    /// `a` where `condition` is above zero, else `b`.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn select(condition: x86::__m256, a: x86::__m256, b: x86::__m256) -> x86::__m256 {
        x86::_mm256_blendv_ps(b, a, x86::_mm256_cmp_ps::<{ x86::_CMP_GT_OQ }>(condition, x86::_mm256_setzero_ps()))
    }

    /// One bit for each lane that is not zero.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn other_than_zero(x: x86::__m256) -> i32 {
        x86::_mm256_movemask_ps(x86::_mm256_cmp_ps::<{ x86::_CMP_NEQ_UQ }>(x, x86::_mm256_setzero_ps()))
    }

    /// Whole numbers from memory.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn widened(stored: &[i16; LANES]) -> x86::__m256 {
        // SAFETY: eight numbers, which need not be aligned.
        let stored = unsafe { x86::_mm_loadu_si128(stored.as_ptr().cast()) };
        x86::_mm256_cvtepi32_ps(x86::_mm256_cvtepi16_epi32(stored))
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn negative(x: x86::__m256) -> x86::__m256 {
        x86::_mm256_xor_ps(x, x86::_mm256_set1_ps(-0.0))
    }

    impl Vector<f32> for Eight {
        #[inline(always)]
        fn splat(x: f32) -> Self {
            instruction!(x86::_mm256_set1_ps(x))
        }
        #[inline(always)]
        fn load(from: &Lanes<f32>) -> Self {
            instruction!(x86::_mm256_loadu_ps(from.0.as_ptr()))
        }
        #[inline(always)]
        fn store(self) -> Lanes<f32> {
            let mut out = Lanes::default();
            // SAFETY: room for eight numbers, which need not be aligned; the instruction as above.
            unsafe { x86::_mm256_storeu_ps(out.0.as_mut_ptr(), self.0) };
            out
        }
        #[inline(always)]
        fn widen(stored: &[i16; LANES]) -> Self {
            instruction!(widened(stored))
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            instruction!(x86::_mm256_min_ps(self.0, other.0))
        }
        #[inline(always)]
        fn is_zero(self) -> bool {
            // SAFETY: the processor has AVX2, see [`Eight`].
            unsafe { other_than_zero(self.0) == 0 }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation once.
    struct Sample<'a>(&'a [[i16; LANES]], &'a mut Vec<Lanes<f32>>);

    impl Pass<f32> for Sample<'_> {
        #[inline(always)]
        fn go<V: Vector<f32>>(self) {
            let Self(stored, out) = self;
            let mut sum = V::default();
            for stored in stored {
                let x = V::widen(stored) * V::of(1e-3);
                let positive = x.fma(x, V::splat(0.01));
                sum += x.where_positive(x - V::of(0.2), -x).min(V::of(0.9)) / positive.inverse_cube_root();
                out.extend([
                    sum.store(),
                    x.max(sum).store(),
                    positive.sqrt().store(),
                    (x * V::of(80.0)).exp_m1().store(),
                    positive.ln().store(),
                    x.max(V::of(0.0)).two_thirds_of_angle().store(),
                    load_all::<f32, V, 1>(&[Lanes(stored.map(f32::from))])[0].store(),
                ]);
                out.push(Lanes::splat(if V::of(0.0).is_zero() && !positive.is_zero() { 1.0 } else { 0.0 }));
            }
        }
    }

    #[test]
    fn registers_and_arrays_give_the_same_bits() {
        let stored: Vec<[i16; LANES]> =
            (0..60).map(|i| std::array::from_fn(|k| ((i * 37 + k * 101) % 1999) as i16 - 999)).collect();
        let (mut arrays, mut registers) = (Vec::new(), Vec::new());
        Sample(&stored, &mut arrays).go::<Lanes<f32>>();
        run_pass(Sample(&stored, &mut registers));
        assert_eq!(arrays, registers);
        assert!(arrays.iter().skip(7).step_by(8).all(|x| *x == Lanes::splat(1.0)));
    }
}
