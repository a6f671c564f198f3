//! The scalar type of the internal-force kernel, f32 or f64, and the arithmetic that it shares with [`super::lanes`].

use std::fmt::Debug;
use std::marker::PhantomData;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use super::elementary;
use super::lanes::{self, Lanes};
use super::vector::Pass;

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
    /// x^(-1/3) for x > 0.
    #[must_use]
    fn inverse_cube_root(self) -> Self;
    /// Lane by lane: `self` where `condition` is above zero, else `other`.
    #[must_use]
    fn where_positive(self, condition: Self, other: Self) -> Self;
    /// exp(x) - 1, see `elementary.rs`.
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
    /// Iterations that take the estimate to round-off.
    const CUBE_ROOT_ITERATIONS: u32;
    /// As a double.
    fn get(self) -> f64;
    /// Number to store, whole if there is a [`Real::LARGEST_STORED`].
    fn store(x: f64) -> Self::Stored;
    /// What was stored.
    fn load(x: Self::Stored) -> Self;
    /// Adds up the lanes of three components each, and leaves zero in them.
    fn sum_and_clear(lanes: &mut [[Lanes<Self>; 3]], sums: &mut [[Self; 3]]) {
        lanes::sum_and_clear(lanes, sums);
    }
    /// Runs a pass (see `super::vector`).
    fn run_pass(pass: impl Pass<Self>) {
        lanes::run(Portable(pass, PhantomData::<Self>));
    }
    /// x^(-1/3) to a few percent, from the bits: log2(y) = -log2(x)/3.
    #[must_use]
    fn inverse_cube_root_estimate(self) -> Self;
}

/// A pass with arrays for vectors.
struct Portable<P, T>(P, PhantomData<T>);

impl<T: Real, P: Pass<T>> lanes::Loop for Portable<P, T> {
    #[inline(always)]
    fn go(self) {
        self.0.go::<Lanes<T>>();
    }
}

/// Newton on y^-3 = x: y + y/3 (1 - x y^3), of which no more than three operations wait for each other. Each iteration doubles the digits.
#[inline(always)]
pub(super) fn inverse_cube_root_iteration<N: Number>(x: N, y: N) -> N {
    let lack = (-(x * y)).product_sum(y * y, N::of(1.0));
    (y * N::of(1.0 / 3.0)).product_sum(lack, y)
}

macro_rules! real {
    (
        $t:ty, $stored:ty, $largest:expr, $iterations:literal, $bits:literal, $product_sum:expr,
        [$exp_m1:expr, $ln:expr, $two_thirds:expr] $(, $own:item)*
    ) => {
        impl Number for $t {
            const EPSILON: f64 = <$t>::EPSILON as f64;
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
            fn inverse_cube_root(self) -> Self {
                let mut y = self.inverse_cube_root_estimate();
                for _ in 0..$iterations {
                    y = inverse_cube_root_iteration(self, y);
                }
                y
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
            const CUBE_ROOT_ITERATIONS: u32 = $iterations;
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
            #[inline(always)]
            fn inverse_cube_root_estimate(self) -> Self {
                Self::from_bits($bits - self.to_bits() / 3)
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
        if lanes::has_avx2() {
            // SAFETY: the processor has the feature.
            return unsafe { lanes::sum_and_clear_avx2(lanes, sums) };
        }
        lanes::sum_and_clear(lanes, sums);
    },
    fn run_pass(pass: impl Pass<Self>) {
        #[cfg(target_arch = "x86_64")]
        if lanes::has_avx2() {
            // SAFETY: the processor has both features.
            return unsafe { super::vector::run_avx2(pass) };
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
