//! Laws of single points in the kernel's own precision.

use crate::material::neo_hookean::{
    Gradient, clamped, cofactor, determinant, distortional_energy, excess, first_piola,
};
use crate::number::{LANES, Lanes, Real};

use super::collapse::{collapse, collapse_curvature};
use super::points::{PointLaw, Projected, largest_square, plane_wave};

/// A law of single points in the kernel's own precision: eight of them are a [`PointLaw`], whoever stands in the lanes.
pub(super) trait LaneLaw<T: Real>: Copy {
    /// Energy density, less what is projected, and first Piola-Kirchhoff stress of a point.
    fn lane(&self, f: &Gradient<T>, projected: Projected<T>) -> (T, Gradient<T>);
    /// [`Constants::stiffness`] there.
    fn stiffness_of_lane(&self, f: &Gradient<T>, projected: Projected<T>) -> T;
}

impl<T: Real, L: LaneLaw<T>> PointLaw<T> for L {
    #[inline(always)]
    fn at(&self, _: usize, f: &Gradient<Lanes<T>>, projected: Projected<Lanes<T>>) -> (Lanes<T>, Gradient<Lanes<T>>) {
        by_lane(|_| self, f, projected)
    }

    #[inline(always)]
    fn stiffness(&self, f: &Gradient<Lanes<T>>, projected: Projected<Lanes<T>>) -> Lanes<T> {
        stiffness_by_lane(|_| self, f, projected)
    }
}

/// Energy density and stress of eight points, each by its own law.
#[inline(always)]
pub(super) fn by_lane<'l, T: Real, L: LaneLaw<T> + 'l>(
    law: impl Fn(usize) -> &'l L,
    f: &Gradient<Lanes<T>>,
    projected: Projected<Lanes<T>>,
) -> (Lanes<T>, Gradient<Lanes<T>>) {
    let (mut density, mut stress) = (Lanes::default(), [Lanes::default(); 9]);
    for lane in 0..LANES {
        let (w, p) = law(lane).lane(&std::array::from_fn(|i| f[i].0[lane]), projected.of_lane(lane));
        density.0[lane] = w;
        for i in 0..9 {
            stress[i].0[lane] = p[i];
        }
    }
    (density, stress)
}

/// The same of the stiffness.
#[inline(always)]
pub(super) fn stiffness_by_lane<'l, T: Real, L: LaneLaw<T> + 'l>(
    law: impl Fn(usize) -> &'l L,
    f: &Gradient<Lanes<T>>,
    projected: Projected<Lanes<T>>,
) -> Lanes<T> {
    let mut stiffness = Lanes::default();
    for lane in 0..LANES {
        let f = std::array::from_fn(|i| f[i].0[lane]);
        stiffness.0[lane] = law(lane).stiffness_of_lane(&f, projected.of_lane(lane));
    }
    stiffness
}

/// [`crate::material::neo_hookean`] in the kernel's own precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct NeoHookean<T> {
    pub mu: T,
    pub pointwise: T,
    pub projected: T,
    pub resists_collapse: bool,
}

impl<T: Real> LaneLaw<T> for NeoHookean<T> {
    // the energy of volume being quadratic, the pressure does not change its curvature
    #[inline(always)]
    fn stiffness_of_lane(&self, f: &Gradient<T>, _: Projected<T>) -> T {
        let cof = cofactor(f);
        let (j, lack) = clamped(determinant(f, &cof));
        let root = j.inverse_cube_root();
        let curvature = if self.resists_collapse { collapse_curvature(j) } else { T::of(1.0) };
        let bulk = self.projected + self.pointwise * curvature;
        plane_wave(f, largest_square(&cof), j, root * root * excess(lack), self.mu, bulk)
    }

    #[inline(always)]
    fn lane(&self, f: &Gradient<T>, projected: Projected<T>) -> (T, Gradient<T>) {
        let cof = cofactor(f);
        let j = determinant(f, &cof);
        let (energy, own) = if self.resists_collapse {
            collapse(j, self.pointwise)
        } else {
            let dilation = j - T::of(1.0);
            (T::of(0.5) * self.pointwise * dilation * dilation, self.pointwise * dilation)
        };
        let energy = distortional_energy(f, j, self.mu) + energy;
        (energy, first_piola(f, &cof, j, self.mu, projected.pressure + own))
    }
}
