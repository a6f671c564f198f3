//! Ogden's law in isochoric principal stretches lb_i = J^-1/3 l_i, one to [`MOST_TERMS`] terms (ABAQUS *HYPERELASTIC,
//! OGDEN; Ogden 1972):
//!
//! ```text
//! W = sum_k 2 mu_k / a_k^2 (lb_1^a_k + lb_2^a_k + lb_3^a_k - 3)                      mu_k in Pa
//! P = G F - (tr(G b)/3) J^-1 cof F,    G = g(b),   g(c) = sum_k (2 mu_k / a_k) (J^-2/3 c)^(a_k/2) / c,   b = F F^T
//! ```
//!
//! The sum of mu_k is the initial shear modulus; one term with exponent 2 is the neo-Hookean law. Where a source writes
//! W = sum mu_k/a_k (...), its mu_k are these times 2/a_k.
//!
//! Below J_m (`MIN_JACOBIAN`) W goes on along its tangent in J: mu_k becomes mu_k (1 + a_k (J_m - J) / (3 J_m)) in
//! G F, and W gains tr(G b) (J_m - J) / (3 J_m), all with J_m for J.
//!
//! P needs no eigenvectors: the matrix function G is Newton's interpolation polynomial of g at the eigenvalues of b.
//! Where eigenvalues meet, the divided differences go over into derivatives, and since each one is multiplied by the
//! differences that it was divided by, neither their round-off nor that of the eigenvalues is amplified.

#[cfg(doc)]
use super::neo_hookean::MIN_JACOBIAN;
use super::neo_hookean::{Gradient, clamped};
use crate::number::Number;

/// Most terms of a law.
pub const MOST_TERMS: usize = 6;
/// Eigenvalues of b below this count as this: keeps the powers finite until the health check sees the point.
pub(super) const LEAST: f64 = 1e-8;
/// Eigenvalues closer than this, relative to the largest, take the first derivative for the first divided difference.
const CLOSE: f64 = 1e-6;
/// The same for the second.
const ALL_CLOSE: f64 = 1e-5;

/// A symmetric tensor: 11, 22, 33, 12, 23, 31.
pub type Symmetric = [f64; 6];

/// One term of the law.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Term {
    /// mu_k, Pa.
    pub shear_modulus: f64,
    /// a_k.
    pub exponent: f64,
}

/// Constants of the law.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Ogden {
    terms: [Term; MOST_TERMS],
    count: usize,
}

impl Ogden {
    /// The law with these mu_k (Pa) and exponents; `None` for lists of unequal length or too many terms.
    #[must_use]
    pub fn new(shear_moduli: &[f64], exponents: &[f64]) -> Option<Self> {
        let count = shear_moduli.len();
        if count != exponents.len() || count > MOST_TERMS {
            return None;
        }
        let mut terms = [Term::default(); MOST_TERMS];
        for (term, (&shear_modulus, &exponent)) in terms.iter_mut().zip(shear_moduli.iter().zip(exponents)) {
            *term = Term { shear_modulus, exponent };
        }
        Some(Self { terms, count })
    }

    /// Modulus of the neo-Hookean law that is as stiff between these squares of isochoric stretches (largest,
    /// smallest), Pa: sum_k |mu_k| max(lb_1^(a_k - 2), lb_3^(a_k - 2)).
    #[must_use]
    pub fn stiffness(&self, largest: f64, smallest: f64) -> f64 {
        let power = |x: f64, a: f64| x.max(LEAST).powf(0.5 * a - 1.0);
        let of = |t: &Term| t.shear_modulus.abs() * power(largest, t.exponent).max(power(smallest, t.exponent));
        self.terms[..self.count].iter().map(of).sum()
    }

    /// The terms.
    #[must_use]
    pub fn terms(&self) -> &[Term] {
        &self.terms[..self.count]
    }

    /// Initial shear modulus, Pa.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        self.terms().iter().map(|t| t.shear_modulus).sum()
    }

    /// Distortional energy density and first Piola-Kirchhoff stress without pressure, Pa.
    #[must_use]
    pub fn evaluate(&self, f: &Gradient<f64>, cof: &Gradient<f64>, j: f64) -> (f64, Gradient<f64>) {
        let (j, lack) = clamped(j);
        let lack = lack / (3.0 * j);
        let r = j.inverse_cube_root();
        let b = left_cauchy_green(f);
        let c = eigenvalues(&b).map(|c| c.max(LEAST));
        let log = c.map(|c| (r * r * c).ln());
        let (mut energy, mut g, mut trace) = (0.0, [0.0; 3], 0.0);
        for t in self.terms() {
            // lb^a - 1, whose digits survive at small strain
            let excess = log.map(|x| (0.5 * t.exponent * x).exp_m1());
            let factor = 2.0 * t.shear_modulus / t.exponent;
            energy += factor / t.exponent * (excess[0] + excess[1] + excess[2]);
            for i in 0..3 {
                let part = factor * (1.0 + excess[i]);
                trace += part;
                g[i] += part * (1.0 + t.exponent * lack) / c[i];
            }
        }
        energy += trace * lack;
        let first = [self.divided(&g, &c, 0, r, lack), self.divided(&g, &c, 1, r, lack)];
        let gap = c[0] - c[2];
        let second =
            if gap > ALL_CLOSE * c[0] { (first[0] - first[1]) / gap } else { 0.5 * self.derivatives(c[1], r, lack)[1] };
        let big = polynomial(&b, &c, [g[0], first[0], second]);
        let pressure = trace / (3.0 * j);
        let stress = std::array::from_fn(|n| {
            let (i, k) = (n / 3, n % 3);
            let row = row(&big, i);
            row[0] * f[k] + row[1] * f[3 + k] + row[2] * f[6 + k] - pressure * cof[n]
        });
        (energy, stress)
    }

    /// Divided difference of g over the eigenvalues i and i + 1.
    fn divided(&self, g: &[f64; 3], c: &[f64; 3], i: usize, r: f64, lack: f64) -> f64 {
        let gap = c[i] - c[i + 1];
        if gap > CLOSE * c[0] { (g[i] - g[i + 1]) / gap } else { self.derivatives(0.5 * (c[i] + c[i + 1]), r, lack)[0] }
    }

    /// g' and g''.
    fn derivatives(&self, c: f64, r: f64, lack: f64) -> [f64; 2] {
        let log = (r * r * c).ln();
        self.terms().iter().fold([0.0; 2], |[d1, d2], t| {
            let power = 0.5 * t.exponent;
            let first = 2.0 * t.shear_modulus / t.exponent * (power * log).exp() * (power - 1.0) / (c * c)
                * (1.0 + t.exponent * lack);
            [d1 + first, d2 + first * (power - 2.0) / c]
        })
    }
}

/// b = F F^T.
fn left_cauchy_green(f: &Gradient<f64>) -> Symmetric {
    let dot = |a: usize, b: usize| f[a] * f[b] + f[a + 1] * f[b + 1] + f[a + 2] * f[b + 2];
    [dot(0, 0), dot(3, 3), dot(6, 6), dot(0, 3), dot(3, 6), dot(6, 0)]
}

fn row(a: &Symmetric, i: usize) -> [f64; 3] {
    match i {
        0 => [a[0], a[3], a[5]],
        1 => [a[3], a[1], a[4]],
        _ => [a[5], a[4], a[2]],
    }
}

/// n_0 I + n_1 (b - c_0) + n_2 (b - c_0)(b - c_1).
fn polynomial(b: &Symmetric, c: &[f64; 3], n: [f64; 3]) -> Symmetric {
    let minus = |c: f64| [b[0] - c, b[1] - c, b[2] - c, b[3], b[4], b[5]];
    let (x, y) = (minus(c[0]), minus(c[1]));
    let product = |i: usize, k: usize| {
        let (x, y) = (row(&x, i), row(&y, k));
        x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
    };
    let square = [product(0, 0), product(1, 1), product(2, 2), product(0, 1), product(1, 2), product(2, 0)];
    let unit = [n[0], n[0], n[0], 0.0, 0.0, 0.0];
    std::array::from_fn(|m| unit[m] + n[1] * x[m] + n[2] * square[m])
}

/// Eigenvalues of a symmetric tensor in descending order (Smith 1961: the cubic's roots by cosines). Two that meet come
/// out apart by up to the square root of the round-off, symmetrically, which an interpolation at them does not feel.
#[must_use]
pub fn eigenvalues(a: &Symmetric) -> [f64; 3] {
    let mean = (a[0] + a[1] + a[2]) / 3.0;
    let d = [a[0] - mean, a[1] - mean, a[2] - mean];
    let squares = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (a[3] * a[3] + a[4] * a[4] + a[5] * a[5]);
    let p = (squares / 6.0).sqrt();
    // all equal to round-off; a NaN goes this way as well, and on into the result
    if p.is_nan() || p <= f64::EPSILON * mean {
        return [mean + p; 3];
    }
    let det =
        d[0] * (d[1] * d[2] - a[4] * a[4]) - a[3] * (a[3] * d[2] - a[4] * a[5]) + a[5] * (a[3] * a[4] - d[1] * a[5]);
    let angle = (0.5 * det / (p * p * p)).clamp(-1.0, 1.0).acos() / 3.0;
    let (sin, cos) = angle.sin_cos();
    let across = 3.0_f64.sqrt() * sin;
    // 2 p cos(angle + 2 pi k / 3)
    [mean + 2.0 * p * cos, mean - p * (cos - across), mean - p * (cos + across)]
}
