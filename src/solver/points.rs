//! The law at one integration point, as the loop of pass 2 sees it.

use crate::material::neo_hookean::{Gradient, cofactor, determinant, distortional_energy, first_piola};
use crate::material::{Distortional, Law, Volumetric};

use super::memory::Memory;
use super::real::Real;

/// Material and how its bulk modulus is shared out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants {
    pub law: Law,
    /// Bulk modulus of the projected part, Pa; 0 with the pointwise volume ratio.
    pub projected: f64,
    /// Bulk modulus of the pointwise part, Pa.
    pub pointwise: f64,
}

impl Constants {
    /// The constants of the neo-Hookean law with quadratic volumetric energy and no relaxation, if it is that.
    pub fn plain<T: Real>(&self) -> Option<NeoHookean<T>> {
        match self.law {
            Law {
                distortional: Distortional::NeoHookean { shear_modulus },
                volumetric: Volumetric::Quadratic,
                prony,
                ..
            } if prony.is_empty() => Some(NeoHookean { mu: T::of(shear_modulus), pointwise: T::of(self.pointwise) }),
            _ => None,
        }
    }
}

/// Energy density and stress of one point.
pub trait PointLaw<T: Real> {
    /// Energy density, less the projected volumetric part, and first Piola-Kirchhoff stress (Pa, row-major) of point
    /// `p` of the block, from its deformation gradient and projected pressure.
    fn at(&self, p: usize, f: &Gradient<T>, projected: T) -> (T, Gradient<T>);
}

/// [`crate::material::neo_hookean`] in the kernel's own precision.
pub(super) struct NeoHookean<T> {
    mu: T,
    pointwise: T,
}

impl<T: Real> PointLaw<T> for NeoHookean<T> {
    #[inline(always)]
    fn at(&self, _: usize, f: &Gradient<T>, projected: T) -> (T, Gradient<T>) {
        let cof = cofactor(f);
        let j = determinant(f, &cof);
        let dilation = j - T::of(1.0);
        let pressure = projected + self.pointwise * dilation;
        let energy = distortional_energy(f, j, self.mu) + T::of(0.5) * self.pointwise * dilation * dilation;
        (energy, first_piola(f, &cof, j, self.mu, pressure))
    }
}

/// Any law, with memory if it relaxes. In double precision: logarithms and nearly equal stretches need the digits.
pub(super) struct Relaxing<'a> {
    pub constants: &'a Constants,
    pub memory: &'a Memory,
}

impl<T: Real> PointLaw<T> for Relaxing<'_> {
    #[inline]
    fn at(&self, p: usize, f: &Gradient<T>, projected: T) -> (T, Gradient<T>) {
        let (energy, stress) = self.evaluate(p, &f.map(Real::get), projected.get());
        (T::of(energy), stress.map(T::of))
    }
}

impl Relaxing<'_> {
    fn evaluate(&self, p: usize, f: &Gradient<f64>, projected: f64) -> (f64, Gradient<f64>) {
        let Constants { law, pointwise, .. } = self.constants;
        let cof = cofactor(f);
        let j = determinant(f, &cof);
        let pressure = projected + pointwise * law.volumetric.slope(j - 1.0);
        let (energy, stress) = match self.memory.held.get(p) {
            Some(held) => law.relaxing(f, &cof, j, self.memory.elastic, held),
            None => law.distortion(f, &cof, j),
        };
        let energy = energy + pointwise * law.volumetric.energy(j - 1.0);
        (energy, std::array::from_fn(|i| stress[i] + pressure * cof[i]))
    }
}
