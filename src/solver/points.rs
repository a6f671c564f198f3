//! The law at one integration point, as the loop of pass 2 sees it.

use crate::material::neo_hookean::{Gradient, MIN_JACOBIAN, cofactor, determinant, distortional_energy, first_piola};
use crate::material::{Distortional, Law, Volumetric};

use super::lanes::{LANES, Lanes};
use super::memory::Memory;
use super::real::{Number, Real};

/// Material and how its bulk modulus is shared out.
#[derive(Clone, Copy, Debug)]
pub struct Constants {
    pub law: Law,
    /// Bulk modulus of the projected part, Pa; 0 with the pointwise volume ratio.
    pub projected: f64,
    /// Bulk modulus of the pointwise part, Pa.
    pub pointwise: f64,
    /// Whether the pointwise part resists collapse, see [`super::dilatation`]; if not it is the law's own.
    pub resists_collapse: bool,
}

impl Constants {
    /// The constants of the neo-Hookean law with quadratic volumetric energy and no relaxation, if it is that.
    pub(super) fn plain<T: Real>(&self) -> Option<NeoHookean<T>> {
        match self.law {
            Law {
                distortional: Distortional::NeoHookean { shear_modulus },
                volumetric: Volumetric::Quadratic,
                prony,
                ..
            } if prony.is_empty() => Some(NeoHookean {
                mu: T::of(shear_modulus),
                pointwise: T::of(self.pointwise),
                resists_collapse: self.resists_collapse,
            }),
            _ => None,
        }
    }
}

impl Constants {
    /// Largest stiffness (Pa) of a plane wave u = a sin(N X) in the state F with projected pressure `pressure`:
    /// the largest a.A(N).a over unit vectors a, N, with A = dP/dF.
    ///
    /// With c the largest singular value of cof F, a.A(N).a <= (kappa u'')c^2 + mu (J^-2/3 + 5/9 J^-8/3 I1 c^2) for the
    /// neo-Hookean law (its mixed term is negative in principal directions); the pressure itself drops out, because det
    /// is linear along a (x) N.
    #[must_use]
    pub fn stiffness(&self, f: &Gradient<f64>, pressure: f64) -> f64 {
        let cof = cofactor(f);
        let j = determinant(f, &cof).max(MIN_JACOBIAN);
        let c2 = largest_square(&cof);
        let i1: f64 = f.iter().map(|x| x * x).sum();
        let cube = j.powf(-2.0 / 3.0);
        let mu = match &self.law.distortional {
            Distortional::NeoHookean { shear_modulus } => *shear_modulus,
            Distortional::Ogden(law) => law.stiffness(cube * largest_square(f), cube * j * j / c2),
        };
        let pointwise =
            if self.resists_collapse { collapse_curvature(j) } else { self.law.volumetric.curvature(j - 1.0) };
        let projected = match self.projected {
            kappa if kappa > 0.0 => self.law.volumetric.curvature(self.law.volumetric.dilation(pressure / kappa)),
            _ => 0.0,
        };
        let bulk = self.projected * projected + self.pointwise * pointwise;
        bulk * c2 + mu * (cube + 5.0 / 9.0 * cube * i1 * c2 / (j * j))
    }
}

/// About the square of the largest singular value: tr S^5 / tr S^4 with S = A^T A, exact where one value dominates or
/// all are equal.
fn largest_square(a: &Gradient<f64>) -> f64 {
    let trace: f64 = a.iter().map(|x| x * x).sum();
    let times = |x: &Gradient<f64>, y: &Gradient<f64>| -> Gradient<f64> {
        std::array::from_fn(|i| (0..3).map(|k| x[3 * (i / 3) + k] * y[3 * k + i % 3]).sum())
    };
    let s: Gradient<f64> =
        std::array::from_fn(|i| (0..3).map(|k| a[3 * k + i / 3] * a[3 * k + i % 3]).sum::<f64>() / trace);
    let s2 = times(&s, &s);
    let inner = |x: &Gradient<f64>, y: &Gradient<f64>| -> f64 { x.iter().zip(y).map(|(x, y)| x * y).sum() };
    let s3 = times(&s2, &s);
    trace * inner(&s3, &s2) / inner(&s2, &s2)
}

/// Energy density and stress of a group of points.
pub trait PointLaw<T: Real> {
    /// Energy density, less the projected volumetric part, and first Piola-Kirchhoff stress (Pa, row-major) of the
    /// points of one group of a block, from their deformation gradients and projected pressures.
    fn at(&self, group: usize, f: &Gradient<Lanes<T>>, projected: Lanes<T>) -> (Lanes<T>, Gradient<Lanes<T>>);
}

/// [`crate::material::neo_hookean`] in the kernel's own precision.
pub(super) struct NeoHookean<T> {
    mu: T,
    pointwise: T,
    resists_collapse: bool,
}

impl<T: Real> NeoHookean<T> {
    #[inline(always)]
    fn lane(&self, f: &Gradient<T>, projected: T) -> (T, Gradient<T>) {
        let cof = cofactor(f);
        let j = determinant(f, &cof);
        let (energy, own) = if self.resists_collapse {
            collapse(j, self.pointwise)
        } else {
            let dilation = j - T::of(1.0);
            (T::of(0.5) * self.pointwise * dilation * dilation, self.pointwise * dilation)
        };
        let energy = distortional_energy(f, j, self.mu) + energy;
        (energy, first_piola(f, &cof, j, self.mu, projected + own))
    }
}

impl<T: Real> PointLaw<T> for NeoHookean<T> {
    #[inline(always)]
    fn at(&self, _: usize, f: &Gradient<Lanes<T>>, projected: Lanes<T>) -> (Lanes<T>, Gradient<Lanes<T>>) {
        let (mut density, mut stress) = (Lanes::default(), [Lanes::default(); 9]);
        for lane in 0..LANES {
            let (w, p) = self.lane(&std::array::from_fn(|i| f[i].0[lane]), projected.0[lane]);
            density.0[lane] = w;
            for i in 0..9 {
                stress[i].0[lane] = p[i];
            }
        }
        (density, stress)
    }
}

/// Any law, with memory if it relaxes. In double precision: logarithms and nearly equal stretches need the digits.
pub(super) struct Relaxing<'a> {
    pub constants: &'a Constants,
    pub memory: &'a Memory,
}

impl<T: Real> PointLaw<T> for Relaxing<'_> {
    #[inline]
    fn at(&self, group: usize, f: &Gradient<Lanes<T>>, projected: Lanes<T>) -> (Lanes<T>, Gradient<Lanes<T>>) {
        let (mut density, mut stress) = (Lanes::default(), [Lanes::default(); 9]);
        for lane in 0..LANES {
            let (w, p) = self.evaluate(LANES * group + lane, &f.map(|x| x.0[lane].get()), projected.0[lane].get());
            density.0[lane] = T::of(w);
            for (out, p) in stress.iter_mut().zip(p) {
                out.0[lane] = T::of(p);
            }
        }
        (density, stress)
    }
}

impl Relaxing<'_> {
    /// Energy density and stress of the point in one slot of the block.
    pub fn evaluate(&self, slot: usize, f: &Gradient<f64>, projected: f64) -> (f64, Gradient<f64>) {
        let Constants { law, pointwise, resists_collapse, .. } = self.constants;
        let cof = cofactor(f);
        let j = determinant(f, &cof);
        let (own, pressure) = if *resists_collapse {
            collapse(j, *pointwise)
        } else {
            (pointwise * law.volumetric.energy(j - 1.0), pointwise * law.volumetric.slope(j - 1.0))
        };
        let (energy, stress) = match self.memory.held.get(slot) {
            Some(held) => law.relaxing(f, &cof, j, self.memory.elastic, held),
            None => law.distortion(f, &cof, j),
        };
        (energy + own, std::array::from_fn(|i| stress[i] + (projected + pressure) * cof[i]))
    }
}

/// J_0: volume ratio below which the pointwise part of the projected energy stiffens.
const CRUSHED: f64 = 0.4;

/// Energy and pressure of the pointwise part that resists collapse:
/// kappa_s/2 (J - 1)^2 (1 + q), kappa_s ((J - 1)(1 + q) - 2 (J - 1)^2 q / J), with q = (J_0/J)^4.
#[inline(always)]
fn collapse<T: Number>(j: T, kappa: T) -> (T, T) {
    let (one, two) = (T::of(1.0), T::of(2.0));
    let inverse = one / j.max(T::of(MIN_JACOBIAN));
    let ratio = T::of(CRUSHED) * inverse;
    let square = ratio * ratio;
    let q = square * square;
    let dilation = j - one;
    let slope = kappa * dilation;
    (slope * dilation * (one + q) / two, slope * (one + q - two * dilation * q * inverse))
}

/// Second derivative of that energy, over kappa_s: 1 + q (1 - 8 (J - 1)/J + 10 (J - 1)^2 / J^2).
fn collapse_curvature(j: f64) -> f64 {
    let dilation = (j - 1.0) / j;
    1.0 + (CRUSHED / j).powi(4) * (1.0 - 8.0 * dilation + 10.0 * dilation * dilation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressure_and_curvature_are_derivatives_of_the_energy() {
        let h = 1e-6;
        for j in [0.03_f64, 0.1, 0.25, 0.6, 1.0, 1.4] {
            let (kappa, energy, pressure) = (3.0, |j: f64| collapse(j, 3.0).0, |j: f64| collapse(j, 3.0).1);
            let slope = (energy(j + h) - energy(j - h)) / (2.0 * h);
            assert!((slope - pressure(j)).abs() < 1e-5 * (1.0 + slope.abs()), "{j}: {slope} {}", pressure(j));
            let curvature = (pressure(j + h) - pressure(j - h)) / (2.0 * h);
            let stated = kappa * collapse_curvature(j);
            assert!((curvature / stated - 1.0).abs() < 1e-5, "{j}: {curvature} {stated}");
        }
    }
}
