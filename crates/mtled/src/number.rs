//! Numbers: the kernel's scalar type, f32 or f64, and eight of them side by side.
//!
//! [`Lanes`] are arrays with plain loops, so the bits are the same everywhere; [`run`] compiles what it is given for AVX2 and FMA too, where each
//! loop is one instruction. Whether a compiler makes vectors of such loops is its own affair: it does for what is as simple as a sum, and stops
//! where a loop becomes long. What a [`Vector`] does is one instruction wherever it stands, if all that stands round it is inlined: so no closure
//! may have one in its hands, nor `array::map`. The bits are those of the arrays.

use std::fmt::Debug;
use std::marker::PhantomData;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

mod elementary {
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

    use super::Number;

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
}

/// What a material law needs of a number, or of several side by side.
pub trait Number:
    Copy
    + Debug
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// Rounds a double.
    fn of(x: f64) -> Self;
    /// The larger of two.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// The distance from 1 to the next larger number.
    const EPSILON: f64;
    /// Whether it is an array, of which compilers make long code.
    const IS_ARRAY: bool = false;
    /// self * b + c, rounded once: the same bits with and without hardware support.
    #[must_use]
    fn fma(self, b: Self, c: Self) -> Self;
    /// self * b + c: rounded once in single precision, twice in double, in which laws are evaluated where a fused product would be a call.
    #[must_use]
    fn product_sum(self, b: Self, c: Self) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// Iterations that take the estimate of an inverse cube root to round-off.
    const CUBE_ROOT_ITERATIONS: u32;
    /// x^(-1/3) to a few percent, from the bits: log2(y) = -log2(x)/3.
    #[must_use]
    fn inverse_cube_root_estimate(self) -> Self;
    /// x^(-1/3) for x > 0: Newton on y^-3 = x, y + y/3 (1 - x y^3), of which no more than three operations wait for each other. Each
    /// iteration doubles the digits.
    #[must_use]
    #[inline(always)]
    fn inverse_cube_root(self) -> Self {
        let mut y = self.inverse_cube_root_estimate();
        for _ in 0..Self::CUBE_ROOT_ITERATIONS {
            let lack = (-(self * y)).product_sum(y * y, Self::of(1.0));
            y = (y * Self::of(1.0 / 3.0)).product_sum(lack, y);
        }
        y
    }
    /// Lane by lane: `self` where `condition` is above zero, else `other`.
    #[must_use]
    fn where_positive(self, condition: Self, other: Self) -> Self;
    /// exp(x) - 1, see `elementary`.
    #[must_use]
    fn exp_m1(self) -> Self;
    /// ln x for x > 0, the same.
    #[must_use]
    fn ln(self) -> Self;
    /// cos(2/3 acos u) for u in 0..1, the same.
    #[must_use]
    fn two_thirds_of_angle(self) -> Self;
}

/// A floating-point type.
pub trait Real: Number + PartialOrd + Send + Sync + 'static {
    /// A gradient component in memory, over the scale of its point.
    type Stored: Copy + Debug + Default + PartialEq + Send + Sync + 'static;
    /// Largest magnitude of a stored number, if they are whole.
    const LARGEST_STORED: Option<f64>;
    /// As a double.
    fn get(self) -> f64;
    /// Number to store, whole if there is a [`Real::LARGEST_STORED`].
    fn store(x: f64) -> Self::Stored;
    /// What was stored.
    fn load(x: Self::Stored) -> Self;
    /// Adds up the lanes of three components each, and leaves zero in them.
    fn sum_and_clear(lanes: &mut [[Lanes<Self>; 3]], sums: &mut [[Self; 3]]) {
        sum_and_clear(lanes, sums);
    }
    /// Runs a pass (see [`Vector`]).
    fn run_pass(pass: impl Pass<Self>) {
        run(Portable(pass, PhantomData::<Self>));
    }
}

/// A pass with arrays for vectors.
struct Portable<P, T>(P, PhantomData<T>);

impl<T: Real, P: Pass<T>> Loop for Portable<P, T> {
    #[inline(always)]
    fn go(self) {
        self.0.go::<Lanes<T>>();
    }
}

macro_rules! real {
    (
        $t:ty, $stored:ty, $largest:expr, $iterations:literal, $bits:literal, $product_sum:expr,
        [$exp_m1:expr, $ln:expr, $two_thirds:expr] $(, $own:item)*
    ) => {
        impl Number for $t {
            const EPSILON: f64 = <$t>::EPSILON as f64;
            const CUBE_ROOT_ITERATIONS: u32 = $iterations;
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as Self
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn fma(self, b: Self, c: Self) -> Self {
                self.mul_add(b, c)
            }
            #[inline(always)]
            fn product_sum(self, b: Self, c: Self) -> Self {
                $product_sum(self, b, c)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }
            #[inline(always)]
            fn inverse_cube_root_estimate(self) -> Self {
                Self::from_bits($bits - self.to_bits() / 3)
            }
            #[inline(always)]
            fn where_positive(self, condition: Self, other: Self) -> Self {
                if condition > 0.0 { self } else { other }
            }
            #[inline(always)]
            fn exp_m1(self) -> Self {
                $exp_m1(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                $ln(self)
            }
            #[inline(always)]
            fn two_thirds_of_angle(self) -> Self {
                $two_thirds(self)
            }
        }

        impl Real for $t {
            type Stored = $stored;
            const LARGEST_STORED: Option<f64> = $largest;
            #[inline(always)]
            fn store(x: f64) -> $stored {
                x as $stored
            }
            #[inline(always)]
            fn load(x: $stored) -> Self {
                Self::from(x)
            }
            #[inline(always)]
            fn get(self) -> f64 {
                f64::from(self)
            }
            $($own)*
        }
    };
}

real!(
    f32,
    i16,
    Some(32_767.0),
    3,
    0x54a2_1f14,
    f32::mul_add,
    [elementary::exp_m1, elementary::ln, elementary::two_thirds_of_angle],
    fn sum_and_clear(lanes: &mut [[Lanes<f32>; 3]], sums: &mut [[f32; 3]]) {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            // SAFETY: the processor has the feature.
            return unsafe { sum_and_clear_avx2(lanes, sums) };
        }
        sum_and_clear(lanes, sums);
    },
    fn run_pass(pass: impl Pass<Self>) {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            // SAFETY: the processor has both features.
            return unsafe { run_avx2(pass) };
        }
        pass.go::<Lanes<Self>>();
    }
);
real!(
    f64,
    f64,
    None,
    4,
    0x553e_f0ff_289d_d796,
    |a: f64, b, c| a * b + c,
    [f64::exp_m1, f64::ln, |u: f64| (u.min(1.0).acos() * (2.0 / 3.0)).cos()]
);

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

/// Functions of a number, lane by lane.
macro_rules! by_lane {
    ($($name:ident),+) => {$(
        #[inline(always)]
        fn $name(self) -> Self {
            self.map(Number::$name)
        }
    )+};
}

impl<T: Real> Number for Lanes<T> {
    const EPSILON: f64 = T::EPSILON;
    const CUBE_ROOT_ITERATIONS: u32 = T::CUBE_ROOT_ITERATIONS;
    const IS_ARRAY: bool = true;
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(T::of(x))
    }
    by_lane!(sqrt, inverse_cube_root_estimate, exp_m1, ln, two_thirds_of_angle);
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
    fn where_positive(self, condition: Self, other: Self) -> Self {
        let mut out = other;
        for i in 0..LANES {
            out.0[i] = if condition.0[i] > T::default() { self.0[i] } else { other.0[i] };
        }
        out
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
        return unsafe { run_loop_avx2(l) };
    }
    l.go();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_loop_avx2(l: impl Loop) {
    l.go();
}

/// Adds up the lanes of three components each, and leaves zero in them.
fn sum_and_clear<T: Real>(lanes: &mut [[Lanes<T>; 3]], sums: &mut [[T; 3]]) {
    for (lanes, sums) in lanes.iter_mut().zip(sums) {
        *sums = lanes.map(Lanes::sum);
        *lanes = [Lanes::default(); 3];
    }
}

/// [`sum_and_clear`] in single precision: the same sums in the same order, hence the same bits.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn sum_and_clear_avx2(lanes: &mut [[Lanes<f32>; 3]], sums: &mut [[f32; 3]]) {
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
fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

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
        let mut out = Self::default();
        for i in 0..LANES {
            out.0[i] = T::load(stored[i]);
        }
        out
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
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
use avx2::run_avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64 as x86;
    use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

    use super::elementary::{self, LEAST_FRACTION, ONE, Single};
    use super::{LANES, Lanes, Number, Pass, Vector};

    /// Runs a pass in single precision.
    #[target_feature(enable = "avx2,fma")]
    pub(super) fn run_avx2(pass: impl Pass<f32>) {
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
        const CUBE_ROOT_ITERATIONS: u32 = f32::CUBE_ROOT_ITERATIONS;
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
        fn inverse_cube_root_estimate(self) -> Self {
            instruction!(estimate(self.0))
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

    /// [`Number::inverse_cube_root_estimate`]: a third of the bits is the upper half of their product with 2/3 of 2^32, halved; that from the estimate of zero, whose bits are zero.
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
    use super::elementary::{exp_m1, ln, two_thirds_of_angle};
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

    #[test]
    fn inverse_cube_root_is_exact_to_round_off() {
        let mut x = 0.02;
        while x < 8.0 {
            let exact: f64 = 1.0 / f64::cbrt(x);
            assert!((x.inverse_cube_root() / exact - 1.0).abs() < 1e-15, "{x}");
            let single = (x as f32).inverse_cube_root();
            assert!((f64::from(single) / exact - 1.0).abs() < 4e-7, "{x}");
            assert_eq!(Lanes::splat(x as f32).inverse_cube_root(), Lanes::splat(single));
            x *= 1.01;
        }
    }

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

    struct EveryOperation<'a>(&'a [[i16; LANES]], &'a mut Vec<Lanes<f32>>);

    impl Pass<f32> for EveryOperation<'_> {
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
        EveryOperation(&stored, &mut arrays).go::<Lanes<f32>>();
        run_pass(EveryOperation(&stored, &mut registers));
        assert_eq!(arrays, registers);
        assert!(arrays.iter().skip(7).step_by(8).all(|x| *x == Lanes::splat(1.0)));
    }
}
