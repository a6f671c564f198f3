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

use super::neo_hookean::{Gradient, MIN_JACOBIAN, clamped, excess};
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
pub struct Increment {
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
    #[must_use]
    pub fn increment(&self, dt: f64) -> Increment {
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
    let (j, lack) = clamped(j);
    let r = j.inverse_cube_root();
    let scale = r * r;
    let [a, b, c, d, e, g] = *h;
    let fh: Gradient<f64> = std::array::from_fn(|n| {
        let x = &f[n / 3 * 3..];
        match n % 3 {
            0 => x[0] * a + x[1] * d + x[2] * g,
            1 => x[0] * d + x[1] * b + x[2] * e,
            _ => x[0] * g + x[1] * e + x[2] * c,
        }
    });
    let product: f64 = fh.iter().zip(f).map(|(x, y)| x * y).sum();
    let excess = excess(lack);
    let stress = std::array::from_fn(|n| scale * (excess * fh[n] - product / (3.0 * j) * cof[n]));
    (0.5 * scale * excess * product, stress)
}

/// J^-2/3 C; below J_m with phi(J) for J^-2/3.
#[must_use]
pub fn unimodular(f: &Gradient<f64>, j: f64) -> Symmetric {
    let (j, lack) = clamped(j);
    let r = j.inverse_cube_root();
    let scale = r * r * excess(lack);
    let dot = |a: usize, b: usize| scale * (f[a] * f[b] + f[3 + a] * f[3 + b] + f[6 + a] * f[6 + b]);
    [dot(0, 0), dot(1, 1), dot(2, 2), dot(0, 1), dot(1, 2), dot(2, 0)]
}

/// X : Y.
#[must_use]
pub fn contract(x: &Symmetric, y: &Symmetric) -> f64 {
    x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + 2.0 * (x[3] * y[3] + x[4] * y[4] + x[5] * y[5])
}

/// Pi = J^2/3 F^-1 P of a stress without pressure, Pa.
#[must_use]
pub fn reference_stress(cof: &Gradient<f64>, j: f64, p: &Gradient<f64>) -> Symmetric {
    let j = j.max(MIN_JACOBIAN);
    let r = j.inverse_cube_root();
    let scale = r; // J^2/3 / J
    let at = |i: usize, k: usize| scale * (cof[i] * p[k] + cof[3 + i] * p[3 + k] + cof[6 + i] * p[6 + k]);
    let mean = |i: usize, k: usize| 0.5 * (at(i, k) + at(k, i));
    [at(0, 0), at(1, 1), at(2, 2), mean(0, 1), mean(1, 2), mean(2, 0)]
}
