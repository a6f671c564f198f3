//! Stress relaxation of the distortional part: a Prony series (Simo 1987; Simo & Hughes, Computational Inelasticity,
//! section 10.3; ABAQUS *VISCOELASTIC, TIME=PRONY with g_i, tau_i and no volumetric terms).
//!
//! ```text
//! S = J p C^-1 + J^-2/3 DEV[ g_inf Pi(t) + sum_i h_i(t) ]         DEV[X] = X - (X : C)/3 C^-1
//! h_i(t) = g_i int_0^t exp(-(t - s)/tau_i) dPi/ds ds              Pi = J^2/3 S_dist, S_dist = 2 dW/dC
//! h_i <- e_i h_i + g_i r_i (Pi_new - Pi_old)                      e_i = exp(-dt/tau_i), r_i = (1 - e_i) tau_i/dt
//! ```
//!
//! Shares g_i are of the **instantaneous** modulus (ABAQUS's MODULI=INSTANTANEOUS): `material.shear_modulus_pa` is felt
//! at once, and g_inf = 1 - sum g_i of it for ever. All tensors live in the reference configuration, so a rotation of
//! space changes nothing. The volume does not relax.
//!
//! Within one time increment everything but Pi_new is known, so the stress is that of an elastic law with the energy
//!
//! ```text
//! W_inc = gamma W + J^-2/3 H : C / 2      gamma = g_inf + sum_i g_i r_i      H = sum_i (e_i h_i - g_i r_i Pi_old)
//! ```
//!
//! and its internal force is conservative for as long as the increment lasts, however many steps find its balance.

use super::invariants::Distortion;
use super::neo_hookean::{Gradient, clamped, excess, is_there};
use super::ogden::Symmetric;
use crate::number::Number;

/// Most terms of a series.
pub const MOST_TERMS: usize = 6;

/// Shares and times of the series; none: elastic.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Prony {
    shares: [f64; MOST_TERMS],
    times: [f64; MOST_TERMS],
    count: usize,
}

/// e_i and g_i r_i of a time increment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Increment {
    /// e_i.
    pub decay: [f64; MOST_TERMS],
    /// g_i r_i.
    pub ramp: [f64; MOST_TERMS],
    /// gamma.
    pub elastic: f64,
}

impl Prony {
    /// The series with these g_i and tau_i (s); `None` for lists of unequal length or too many terms.
    #[must_use]
    pub fn new(shares: &[f64], times: &[f64]) -> Option<Self> {
        let count = shares.len();
        if count != times.len() || count > MOST_TERMS {
            return None;
        }
        let mut series = Self { count, ..Self::default() };
        series.shares[..count].copy_from_slice(shares);
        series.times[..count].copy_from_slice(times);
        Some(series)
    }

    /// Number of terms.
    #[must_use]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether nothing relaxes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// g_i.
    #[must_use]
    pub fn shares(&self) -> &[f64] {
        &self.shares[..self.count]
    }

    /// tau_i, s.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times[..self.count]
    }

    /// g_inf: what is left of the modulus in the long term.
    #[must_use]
    pub fn long_term_share(&self) -> f64 {
        1.0 - self.shares().iter().sum::<f64>()
    }

    /// The factors of a time increment of `dt` seconds, 0 or more.
    pub(crate) fn increment(&self, dt: f64) -> Increment {
        let mut out = Increment { decay: [1.0; MOST_TERMS], ramp: [0.0; MOST_TERMS], elastic: self.long_term_share() };
        for i in 0..self.count {
            let x = dt / self.times[i];
            out.decay[i] = (-x).exp();
            // r -> 1 as x -> 0: a jump of the strain in no time finds the instantaneous modulus
            out.ramp[i] = self.shares[i] * if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 };
            out.elastic += out.ramp[i];
        }
        out
    }
}

/// J^-2/3 H : C / 2 and its derivative with respect to F; below J_m with phi(J) for J^-2/3 (see [`super::neo_hookean`]).
#[must_use]
pub fn held(f: &Gradient<f64>, cof: &Gradient<f64>, j: f64, h: &Symmetric) -> (f64, Gradient<f64>) {
    held_in::<f64, false>(f, j, h).summed(cof)
}

/// The same of numbers of any kind.
#[inline(always)]
pub(crate) fn held_in<N: Number, const AXISYMMETRIC: bool>(f: &Gradient<N>, j: N, h: &[N; 6]) -> Distortion<N> {
    let (j, lack) = clamped(j);
    let r = j.inverse_cube_root();
    let scale = r * r;
    let [a, b, c, d, e, g] = *h;
    let mut fh = *f;
    if AXISYMMETRIC {
        for k in [0, 6] {
            fh[k] = f[k].product_sum(a, f[k + 2] * g);
            fh[k + 2] = f[k].product_sum(g, f[k + 2] * c);
        }
        fh[4] = f[4] * b;
    } else {
        for k in [0, 3, 6] {
            let [x, y, z] = [f[k], f[k + 1], f[k + 2]];
            fh[k] = x.product_sum(a, y.product_sum(d, z * g));
            fh[k + 1] = x.product_sum(d, y.product_sum(b, z * e));
            fh[k + 2] = x.product_sum(g, y.product_sum(e, z * c));
        }
    }
    let mut product = N::default();
    for n in 0..9 {
        if is_there::<AXISYMMETRIC>(n) {
            product = fh[n].product_sum(f[n], product);
        }
    }
    let along = scale * excess(lack);
    for n in 0..9 {
        if is_there::<AXISYMMETRIC>(n) {
            fh[n] = along * fh[n];
        }
    }
    let across = -(scale * product * N::of(1.0 / 3.0) / j);
    Distortion { energy: N::of(0.5) * along * product, stress: fh, across }
}

/// J^-2/3 C; below J_m with phi(J) for J^-2/3.
#[inline(always)]
pub(crate) fn unimodular<N: Number, const AXISYMMETRIC: bool>(f: &Gradient<N>, j: N) -> [N; 6] {
    let (j, lack) = clamped(j);
    let r = j.inverse_cube_root();
    let scale = r * r * excess(lack);
    of_columns::<N, AXISYMMETRIC>(scale, f, f)
}

/// s A^T B, or its symmetric part.
#[inline(always)]
fn of_columns<N: Number, const AXISYMMETRIC: bool>(scale: N, a: &Gradient<N>, b: &Gradient<N>) -> [N; 6] {
    let half = N::of(0.5) * scale;
    if AXISYMMETRIC {
        let zero = N::default();
        let across = column::<N, true>(a, b, 2, 0) + column::<N, true>(a, b, 0, 2);
        let along = [column::<N, true>(a, b, 0, 0), column::<N, true>(a, b, 2, 2)];
        return [scale * along[0], scale * (a[4] * b[4]), scale * along[1], zero, zero, half * across];
    }
    [
        scale * column::<N, false>(a, b, 0, 0),
        scale * column::<N, false>(a, b, 1, 1),
        scale * column::<N, false>(a, b, 2, 2),
        half * (column::<N, false>(a, b, 0, 1) + column::<N, false>(a, b, 1, 0)),
        half * (column::<N, false>(a, b, 1, 2) + column::<N, false>(a, b, 2, 1)),
        half * (column::<N, false>(a, b, 2, 0) + column::<N, false>(a, b, 0, 2)),
    ]
}

/// Inner product of two columns.
#[inline(always)]
fn column<N: Number, const AXISYMMETRIC: bool>(a: &Gradient<N>, b: &Gradient<N>, i: usize, k: usize) -> N {
    let last = a[6 + i] * b[6 + k];
    a[i].product_sum(b[k], if AXISYMMETRIC { last } else { a[3 + i].product_sum(b[3 + k], last) })
}

/// Pi = J^2/3 F^-1 P of a stress without pressure, Pa.
#[inline(always)]
pub(crate) fn reference_stress<N: Number, const AXISYMMETRIC: bool>(
    cof: &Gradient<N>,
    j: N,
    p: &Gradient<N>,
) -> [N; 6] {
    // J^2/3 / J
    let scale = clamped(j).0.inverse_cube_root();
    of_columns::<N, AXISYMMETRIC>(scale, cof, p)
}
