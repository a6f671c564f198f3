//! Compressible neo-Hookean law (ABAQUS *HYPERELASTIC, NEO HOOKE with C10 = mu/2, D1 = 2/kappa):
//!
//! ```text
//! W = mu/2 (J^-2/3 I1 - 3) + kappa/2 (J - 1)^2
//! P = dW/dF = mu J^-2/3 F + (p - mu J^-5/3 I1/3) cof F,     p = kappa (J - 1),  cof F = J F^-T
//! ```
//!
//! The volumetric pressure p is an argument of its own, because the cure for volumetric locking computes it from
//! an averaged volume ratio, and because there are other energies of volume (`super::volumetric`).
//!
//! Below J_m = `MIN_JACOBIAN` the energy goes on along its tangent in J, with J^-2/3 replaced by
//!
//! ```text
//! phi(J) = J_m^-2/3 (1 + 2/3 (J_m - J) / J_m)        P = mu phi(J) F + (p - mu J_m^-5/3 I1/3) cof F
//! ```
//!
//! so that energy and stress stay finite for every J, even below zero, and P stays the derivative of W. The other laws do
//! the same.

use crate::number::Number;

/// Deformation gradient, row-major: F[3 i + k] = d x_i / d X_k.
pub type Gradient<T> = [T; 9];

/// J_m: volume ratio below which distortional energies go on along their tangent in J, which keeps the arithmetic finite
/// until the health check sees the point.
pub(crate) const MIN_JACOBIAN: f64 = 0.02;

/// Whether a component may differ from zero: with symmetry of revolution none that shears the hoop direction does. What is not there is not
/// computed either, and adds nothing: the bits are the same.
#[inline(always)]
pub(crate) const fn is_there<const AXISYMMETRIC: bool>(k: usize) -> bool {
    !AXISYMMETRIC || k.is_multiple_of(2)
}

/// cof F = J F^-T, row-major, with no division.
#[inline(always)]
pub fn cofactor<T: Number>(f: &Gradient<T>) -> Gradient<T> {
    cofactor_in::<T, false>(f)
}

/// The same of what [`is_there`].
#[inline(always)]
pub(crate) fn cofactor_in<T: Number, const AXISYMMETRIC: bool>(f: &Gradient<T>) -> Gradient<T> {
    if AXISYMMETRIC {
        let zero = T::default();
        return [
            f[4] * f[8],
            zero,
            -(f[4] * f[6]),
            zero,
            minor(f, 0, 8, 2, 6),
            zero,
            -(f[2] * f[4]),
            zero,
            f[0] * f[4],
        ];
    }
    [
        minor(f, 4, 8, 5, 7),
        minor(f, 5, 6, 3, 8),
        minor(f, 3, 7, 4, 6),
        minor(f, 2, 7, 1, 8),
        minor(f, 0, 8, 2, 6),
        minor(f, 1, 6, 0, 7),
        minor(f, 1, 5, 2, 4),
        minor(f, 2, 3, 0, 5),
        minor(f, 0, 4, 1, 3),
    ]
}

#[inline(always)]
fn minor<T: Number>(f: &Gradient<T>, a: usize, b: usize, c: usize, d: usize) -> T {
    f[a].product_sum(f[b], -(f[c] * f[d]))
}

/// I1 = F : F, of what [`is_there`].
#[inline(always)]
pub(crate) fn first_invariant_in<T: Number, const AXISYMMETRIC: bool>(f: &Gradient<T>) -> T {
    let mut i1 = f[0] * f[0];
    for k in 1..9 {
        if is_there::<AXISYMMETRIC>(k) {
            i1 = f[k].product_sum(f[k], i1);
        }
    }
    i1
}

/// a F + b cof F, of what [`is_there`].
#[inline(always)]
pub(crate) fn combined<T: Number, const AXISYMMETRIC: bool>(
    a: T,
    f: &Gradient<T>,
    b: T,
    cof: &Gradient<T>,
) -> Gradient<T> {
    let mut stress = *f;
    for i in 0..9 {
        if is_there::<AXISYMMETRIC>(i) {
            stress[i] = a.product_sum(f[i], b * cof[i]);
        }
    }
    stress
}

/// det F from F and its cofactor.
#[inline(always)]
pub fn determinant<T: Number>(f: &Gradient<T>, cof: &Gradient<T>) -> T {
    determinant_in::<T, false>(f, cof)
}

/// The same of what [`is_there`].
#[inline(always)]
pub(crate) fn determinant_in<T: Number, const AXISYMMETRIC: bool>(f: &Gradient<T>, cof: &Gradient<T>) -> T {
    let last = f[2] * cof[2];
    f[0].product_sum(cof[0], if AXISYMMETRIC { last } else { f[1].product_sum(cof[1], last) })
}

/// First Piola-Kirchhoff stress for the pressure p = dU/dJ, Pa.
#[inline(always)]
pub fn first_piola<T: Number>(f: &Gradient<T>, cof: &Gradient<T>, j: T, mu: T, p: T) -> Gradient<T> {
    first_piola_in::<T, false>(f, cof, j, mu, p)
}

/// The same of what [`is_there`].
#[inline(always)]
pub(crate) fn first_piola_in<T: Number, const AXISYMMETRIC: bool>(
    f: &Gradient<T>,
    cof: &Gradient<T>,
    j: T,
    mu: T,
    p: T,
) -> Gradient<T> {
    let (j, lack) = clamped(j);
    let r = j.inverse_cube_root();
    let a = mu * r * r;
    // 1/J is r^3: one division less to wait for
    let b = (-(a * first_invariant_in::<T, AXISYMMETRIC>(f))).product_sum(T::of(1.0 / 3.0) * (r * r * r), p);
    let a = mu * excess(lack) * r * r;
    combined::<T, AXISYMMETRIC>(a, f, b, cof)
}

/// The larger of J and J_m, and by how much J falls short of J_m.
#[inline(always)]
pub(crate) fn clamped<T: Number>(j: T) -> (T, T) {
    let larger = j.max(T::of(MIN_JACOBIAN));
    (larger, larger - j)
}

/// phi(J) over J^-2/3 of the clamped J: 1 above J_m. Needs no cube root, whose latency a step would feel.
#[inline(always)]
pub(crate) fn excess<T: Number>(lack: T) -> T {
    T::of(1.0) + T::of(2.0 / (3.0 * MIN_JACOBIAN)) * lack
}

/// Deviatoric (distortional) energy density mu/2 (J^-2/3 I1 - 3), Pa.
#[inline(always)]
pub(crate) fn distortional_energy<T: Number>(f: &Gradient<T>, j: T, mu: T) -> T {
    distortional_energy_in::<T, false>(f, j, mu)
}

/// The same of what [`is_there`].
#[inline(always)]
pub(crate) fn distortional_energy_in<T: Number, const AXISYMMETRIC: bool>(f: &Gradient<T>, j: T, mu: T) -> T {
    let (j, lack) = clamped(j);
    let r = j.inverse_cube_root();
    T::of(0.5) * mu * (r * r * (excess(lack) * first_invariant_in::<T, AXISYMMETRIC>(f)) - T::of(3.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_zero_in_a_half_plane_changes_no_bit() {
        for (mu, p) in [(1678.0_f32, -430.0_f32), (900.0, 12_000.0)] {
            for f in
                [[1.1, 0.0, -0.1, 0.0, 0.8, 0.0, 0.3, 0.0, 1.05_f32], [0.1, 0.0, 0.0, 0.0, 0.2, 0.0, 1.7, 0.0, 0.3]]
            {
                let (cof, kept) = (cofactor(&f), cofactor_in::<f32, true>(&f));
                assert_eq!(cof, kept);
                let j = determinant(&f, &cof);
                assert_eq!(j.to_bits(), determinant_in::<f32, true>(&f, &kept).to_bits());
                assert_eq!(first_piola(&f, &cof, j, mu, p), first_piola_in::<f32, true>(&f, &kept, j, mu, p));
                assert_eq!(distortional_energy(&f, j, mu), distortional_energy_in::<f32, true>(&f, j, mu));
            }
        }
    }
}
