//! Eight numbers side by side: eight integration points, or eight rows of a matrix, in one vector of the processor.
//!
//! Arrays and plain loops, so the bits are the same everywhere; [`run`] compiles what it is given for AVX2 and FMA
//! too, where each loop is one instruction, and takes that where the processor has both.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use super::real::{Number, Real};

/// Numbers side by side.
pub const LANES: usize = 8;

/// Eight numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Lanes<T>(pub [T; LANES]);

impl<T: Real> Lanes<T> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(x: T) -> Self {
        Self([x; LANES])
    }

    /// Numbers as they are kept in memory.
    #[inline(always)]
    pub fn load(stored: &[T::Stored; LANES]) -> Self {
        let mut out = Self::default();
        for i in 0..LANES {
            out.0[i] = T::load(stored[i]);
        }
        out
    }

    /// In double precision.
    #[inline(always)]
    pub(crate) fn wide(self) -> Lanes<f64> {
        let mut out = Lanes::default();
        for i in 0..LANES {
            out.0[i] = self.0[i].get();
        }
        out
    }

    /// Rounded from double precision.
    #[inline(always)]
    pub(crate) fn narrow(wide: Lanes<f64>) -> Self {
        let mut out = Self::default();
        for i in 0..LANES {
            out.0[i] = T::of(wide.0[i]);
        }
        out
    }

    /// Several numbers for each lane out of a table that has them side by side.
    #[inline(always)]
    pub(crate) fn look_up<const N: usize>(table: &[[T; N]], at: &[u16; LANES]) -> [Self; N] {
        let mut out = [Self::default(); N];
        for i in 0..LANES {
            let found = table[usize::from(at[i])];
            (0..N).for_each(|k| out[k].0[i] = found[k]);
        }
        out
    }

    #[inline(always)]
    fn map(self, f: impl Fn(T) -> T) -> Self {
        let mut out = self;
        for i in 0..LANES {
            out.0[i] = f(self.0[i]);
        }
        out
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        let mut out = self;
        for i in 0..LANES {
            out.0[i] = f(self.0[i], other.0[i]);
        }
        out
    }

    /// The lanes whose bit is set, zero in the others.
    #[inline(always)]
    pub(crate) fn where_bit(self, bits: u8) -> Self {
        let mut out = Self::default();
        for i in 0..LANES {
            out.0[i] = if bits & (1 << i) == 0 { T::default() } else { self.0[i] };
        }
        out
    }

    /// The smaller of two; `other` where either is not a number.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// Sum of eight, in the order of [`Lanes::sum`].
    #[inline(always)]
    pub(crate) fn sum_of(a: &[Self; LANES]) -> Self {
        ((a[0] + a[1]) + (a[2] + a[3])) + ((a[4] + a[5]) + (a[6] + a[7]))
    }

    /// Sum of the lanes, always in the same order.
    #[inline(always)]
    pub fn sum(self) -> T {
        let a = self.0;
        ((a[0] + a[1]) + (a[2] + a[3])) + ((a[4] + a[5]) + (a[6] + a[7]))
    }
}

impl<T: Real> Number for Lanes<T> {
    const EPSILON: f64 = T::EPSILON;
    const IS_ARRAY: bool = true;
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(T::of(x))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, Number::max)
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        let mut out = c;
        for i in 0..LANES {
            out.0[i] = self.0[i].fma(b.0[i], c.0[i]);
        }
        out
    }
    #[inline(always)]
    fn product_sum(self, b: Self, c: Self) -> Self {
        let mut out = c;
        for i in 0..LANES {
            out.0[i] = self.0[i].product_sum(b.0[i], c.0[i]);
        }
        out
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(Number::sqrt)
    }
    #[inline(always)]
    fn inverse_cube_root(self) -> Self {
        let mut y = self.map(T::inverse_cube_root_estimate);
        for _ in 0..T::CUBE_ROOT_ITERATIONS {
            y = super::real::inverse_cube_root_iteration(self, y);
        }
        y
    }
    #[inline(always)]
    fn where_positive(self, condition: Self, other: Self) -> Self {
        let mut out = other;
        for i in 0..LANES {
            out.0[i] = if condition.0[i] > T::default() { self.0[i] } else { other.0[i] };
        }
        out
    }
    #[inline(always)]
    fn exp_m1(self) -> Self {
        self.map(Number::exp_m1)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.map(Number::ln)
    }
    #[inline(always)]
    fn two_thirds_of_angle(self) -> Self {
        self.map(Number::two_thirds_of_angle)
    }
}

macro_rules! operators {
    ($($operator:ident::$method:ident: $of:tt,)+) => {$(
        impl<T: Real> $operator for Lanes<T> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $of b)
            }
        }
    )+};
}

operators! {
    Add::add: +,
    Sub::sub: -,
    Mul::mul: *,
    Div::div: /,
}

impl<T: Real> Neg for Lanes<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl<T: Real> AddAssign for Lanes<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// A loop of the kernel that is worth the processor's own vectors. Everything that `go` calls in it must be inlined.
pub trait Loop {
    /// Runs it.
    fn go(self);
}

/// Runs a loop, compiled for AVX2 and FMA where the processor has them. The same bits either way: products are only
/// fused where the code says so.
#[inline]
pub fn run(l: impl Loop) {
    #[cfg(target_arch = "x86_64")]
    if has_avx2() {
        // SAFETY: the processor has both features.
        return unsafe { run_avx2(l) };
    }
    l.go();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2(l: impl Loop) {
    l.go();
}

/// Adds up the lanes of three components each, and leaves zero in them.
pub(super) fn sum_and_clear<T: Real>(lanes: &mut [[Lanes<T>; 3]], sums: &mut [[T; 3]]) {
    for (lanes, sums) in lanes.iter_mut().zip(sums) {
        *sums = lanes.map(Lanes::sum);
        *lanes = [Lanes::default(); 3];
    }
}

/// [`sum_and_clear`] in single precision: the same sums in the same order, hence the same bits.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(super) fn sum_and_clear_avx2(lanes: &mut [[Lanes<f32>; 3]], sums: &mut [[f32; 3]]) {
    use std::arch::x86_64::{
        _mm_add_ps, _mm_storeu_ps, _mm256_castps256_ps128, _mm256_extractf128_ps, _mm256_hadd_ps, _mm256_loadu_ps,
    };
    for (lanes, sums) in lanes.iter_mut().zip(sums) {
        // SAFETY: a component has eight numbers, and need not be aligned.
        let [x, y, z] = [0, 1, 2].map(|k| unsafe { _mm256_loadu_ps(lanes[k].0.as_ptr()) });
        let quarters = _mm256_hadd_ps(_mm256_hadd_ps(x, y), _mm256_hadd_ps(z, z));
        let sum = _mm_add_ps(_mm256_castps256_ps128(quarters), _mm256_extractf128_ps::<1>(quarters));
        let mut four = [0.0; 4];
        // SAFETY: room for four numbers, which need not be aligned.
        unsafe { _mm_storeu_ps(four.as_mut_ptr(), sum) };
        sums.copy_from_slice(&four[..3]);
        *lanes = [Lanes::default(); 3];
    }
}

/// The vector instructions that [`run`] takes on this processor; none where its loops stay as they were built.
#[must_use]
pub fn instructions() -> Option<&'static str> {
    #[cfg(target_arch = "x86_64")]
    if has_avx2() {
        return Some("AVX2 and FMA");
    }
    None
}

/// Whether [`run`] finds vectors of eight here. The library caches the answer.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sample<'a>(&'a mut [Lanes<f32>]);

    impl Loop for Sample<'_> {
        #[inline(always)]
        fn go(self) {
            let mut sum = Lanes::default();
            for x in self.0 {
                sum = x.fma(*x, sum).where_positive(*x - Lanes::of(0.25), sum - *x);
                *x = sum / (Lanes::of(1.0) + *x * *x) + (*x + Lanes::of(0.01)).inverse_cube_root();
            }
        }
    }

    #[test]
    fn both_ways_give_the_same_bits() {
        let numbers: Vec<Lanes<f32>> =
            (0..50).map(|i| Lanes(std::array::from_fn(|k| ((i * 37 + k * 101) % 97) as f32 / 97.0))).collect();
        let (mut portable, mut vectors) = (numbers.clone(), numbers);
        Sample(&mut portable).go();
        run(Sample(&mut vectors));
        assert_eq!(portable, vectors);
        let three =
            |v: &[Lanes<f32>]| -> Vec<[Lanes<f32>; 3]> { v.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect() };
        let mut lanes = three(&vectors);
        let (mut sums, mut other) = (vec![[0.0; 3]; lanes.len()], vec![[0.0; 3]; lanes.len()]);
        sum_and_clear(&mut lanes, &mut sums);
        assert!(lanes.iter().flatten().all(|l| *l == Lanes::default()));
        f32::sum_and_clear(&mut three(&vectors), &mut other);
        assert_eq!(sums, other);
    }
}
