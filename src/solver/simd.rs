//! The two loops of the kernel for single precision on x86-64 with AVX2 and FMA: one node's three components in one
//! 128-bit register. Same operations in the same order as the portable loops, so the same bits; a test compares them.

use std::arch::x86_64::{
    __m128, _mm_add_ps, _mm_broadcast_ss, _mm_fmadd_ps, _mm_loadu_ps, _mm_setzero_ps, _mm_storeu_ps,
};

/// sum_j u_j (x) grad phi_j by columns, in two sets of accumulators (even and odd entries) that are added at the end.
///
/// # Safety
/// The processor must have AVX2 and FMA; every index in `local` must be below `u.len()`, and `gradient` must be as long
/// as `local`.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub unsafe fn gather(local: &[u16], gradient: &[[f32; 3]], u: &[[f32; 4]]) -> [[f32; 4]; 3] {
    let mut sets = [[_mm_setzero_ps(); 3]; 2];
    // SAFETY: `i < local.len()` throughout; indices are in bounds by the caller's promise.
    let add = |set: &mut [__m128; 3], i: usize| unsafe {
        let g = gradient.get_unchecked(i);
        let v = _mm_loadu_ps(u.as_ptr().add(usize::from(*local.get_unchecked(i))).cast());
        set[0] = _mm_fmadd_ps(v, _mm_broadcast_ss(&g[0]), set[0]);
        set[1] = _mm_fmadd_ps(v, _mm_broadcast_ss(&g[1]), set[1]);
        set[2] = _mm_fmadd_ps(v, _mm_broadcast_ss(&g[2]), set[2]);
    };
    let pairs = local.len() / 2 * 2;
    let mut i = 0;
    while i < pairs {
        add(&mut sets[0], i);
        add(&mut sets[1], i + 1);
        i += 2;
    }
    if pairs < local.len() {
        add(&mut sets[0], pairs);
    }
    let mut columns = [[0.0; 4]; 3];
    for k in 0..3 {
        // SAFETY: four lanes fit.
        unsafe { _mm_storeu_ps(columns[k].as_mut_ptr(), _mm_add_ps(sets[0][k], sets[1][k])) };
    }
    columns
}

/// f_j += V P grad phi_j, with V P by columns.
///
/// # Safety
/// As [`gather`], with `force` in the place of `u`.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub unsafe fn scatter(local: &[u16], gradient: &[[f32; 3]], columns: &[[f32; 4]; 3], force: &mut [[f32; 4]]) {
    // SAFETY: as in `gather`.
    unsafe {
        let c = [0, 1, 2].map(|k| _mm_loadu_ps(columns[k].as_ptr()));
        for i in 0..local.len() {
            let g = gradient.get_unchecked(i);
            let at = force.as_mut_ptr().add(usize::from(*local.get_unchecked(i))).cast::<f32>();
            let f = _mm_fmadd_ps(c[2], _mm_broadcast_ss(&g[2]), _mm_loadu_ps(at));
            let f = _mm_fmadd_ps(c[1], _mm_broadcast_ss(&g[1]), f);
            _mm_storeu_ps(at, _mm_fmadd_ps(c[0], _mm_broadcast_ss(&g[0]), f));
        }
    }
}
