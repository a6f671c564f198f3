//! The scalar type of the internal-force kernel: f32 or f64.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use super::block::Block;
use super::points::{Constants, PointLaw};
use crate::approximation::Form;

/// What the kernel needs of a floating-point type.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + 'static
{
    /// Rounds a double.
    fn of(x: f64) -> Self;
    /// As a double.
    fn get(self) -> f64;
    /// The larger of two.
    fn max(self, other: Self) -> Self;
    /// self * b + c, rounded once: the same bits with and without hardware support.
    fn fma(self, b: Self, c: Self) -> Self;
    /// x^(-1/3) for x > 0.
    fn inverse_cube_root(self) -> Self;
    /// sum_j u_j (x) grad phi_j by columns: the inner loop of pass 1.
    fn gather(local: &[u16], gradient: &[[Self; 3]], u: &[[Self; 4]]) -> [[Self; 4]; 3];
    /// f_j += V P grad phi_j, with V P by columns: the inner loop of pass 2.
    fn scatter(local: &[u16], gradient: &[[Self; 3]], columns: &[[Self; 4]; 3], force: &mut [[Self; 4]]);
    /// `Block::deform_points` compiled for this machine.
    fn dispatch_deform(block: &mut Block<Self>);
    /// `Block::stress_points` compiled for this machine.
    fn dispatch_stress<L: PointLaw<Self>>(block: &mut Block<Self>, law: &L);
    /// `Block::bound_points` compiled for this machine.
    fn dispatch_bound(block: &mut Block<Self>, constants: &Constants);
}

macro_rules! real {
    ($t:ty, $iterations:literal, $deform:ident, $stress:ident, $bound:ident, $($loops:item),*) => {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn $deform<const AXISYMMETRIC: bool>(block: &mut Block<$t>) {
            block.deform_points::<AXISYMMETRIC>();
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn $stress<L: PointLaw<$t>, const AXISYMMETRIC: bool>(block: &mut Block<$t>, law: &L) {
            block.stress_points::<L, AXISYMMETRIC>(law);
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn $bound(block: &mut Block<$t>, constants: &Constants) {
            block.bound_points(constants);
        }

        impl Real for $t {
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as Self
            }
            #[inline(always)]
            fn get(self) -> f64 {
                f64::from(self)
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
            fn inverse_cube_root(self) -> Self {
                // Newton on y^-3 = x: multiplications only. Each iteration doubles the digits of the 5% estimate.
                let mut y = start(f64::from(self)) as Self;
                for _ in 0..$iterations {
                    y = y * (4.0 - self * y * y * y) * (1.0 / 3.0);
                }
                y
            }
            $($loops)*
            fn dispatch_deform(block: &mut Block<Self>) {
                #[cfg(target_arch = "x86_64")]
                if has_fma() {
                    // SAFETY: the processor has both features.
                    return unsafe {
                        match block.form {
                            Form::Full => $deform::<false>(block),
                            Form::Axisymmetric => $deform::<true>(block),
                        }
                    };
                }
                match block.form {
                    Form::Full => block.deform_points::<false>(),
                    Form::Axisymmetric => block.deform_points::<true>(),
                }
            }
            fn dispatch_stress<L: PointLaw<Self>>(block: &mut Block<Self>, law: &L) {
                #[cfg(target_arch = "x86_64")]
                if has_fma() {
                    // SAFETY: the processor has both features.
                    return unsafe {
                        match block.form {
                            Form::Full => $stress::<L, false>(block, law),
                            Form::Axisymmetric => $stress::<L, true>(block, law),
                        }
                    };
                }
                match block.form {
                    Form::Full => block.stress_points::<L, false>(law),
                    Form::Axisymmetric => block.stress_points::<L, true>(law),
                }
            }
            fn dispatch_bound(block: &mut Block<Self>, constants: &Constants) {
                #[cfg(target_arch = "x86_64")]
                if has_fma() {
                    // SAFETY: the processor has both features.
                    return unsafe { $bound(block, constants) };
                }
                block.bound_points(constants);
            }
        }
    };
}

/// Rough x^(-1/3) from the bits: log2(y) = -log2(x)/3, good to 5%.
#[inline(always)]
fn start(x: f64) -> f64 {
    f64::from_bits(0x553e_f0ff_289d_d796 - x.to_bits() / 3)
}

/// Whether the loops for AVX2 and FMA can run here. The library caches the answer.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn has_fma() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

real!(
    f32,
    3,
    deform_f32,
    stress_f32,
    bound_f32,
    #[inline(always)]
    fn gather(local: &[u16], gradient: &[[f32; 3]], u: &[[f32; 4]]) -> [[f32; 4]; 3] {
        #[cfg(target_arch = "x86_64")]
        if has_fma() {
            // SAFETY: features checked; local indices are positions in the block's node list, as long as `u`.
            return unsafe { super::simd::gather(local, gradient, u) };
        }
        super::kernel::gather(local, gradient, u)
    },
    #[inline(always)]
    fn scatter(local: &[u16], gradient: &[[f32; 3]], columns: &[[f32; 4]; 3], force: &mut [[f32; 4]]) {
        #[cfg(target_arch = "x86_64")]
        if has_fma() {
            // SAFETY: as in `gather`.
            return unsafe { super::simd::scatter(local, gradient, columns, force) };
        }
        super::kernel::scatter(local, gradient, columns, force);
    }
);
real!(
    f64,
    4,
    deform_f64,
    stress_f64,
    bound_f64,
    #[inline(always)]
    fn gather(local: &[u16], gradient: &[[f64; 3]], u: &[[f64; 4]]) -> [[f64; 4]; 3] {
        super::kernel::gather(local, gradient, u)
    },
    #[inline(always)]
    fn scatter(local: &[u16], gradient: &[[f64; 3]], columns: &[[f64; 4]; 3], force: &mut [[f64; 4]]) {
        super::kernel::scatter(local, gradient, columns, force);
    }
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
            assert!((f64::from((x as f32).inverse_cube_root()) / exact - 1.0).abs() < 4e-7, "{x}");
            x *= 1.01;
        }
    }
}
