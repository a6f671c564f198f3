//! Laws of single points in the kernel's own precision.

use crate::material::neo_hookean::{
    Gradient, clamped, cofactor, cofactor_in, determinant, determinant_in, distortional_energy_in, excess,
    first_piola_in,
};
use crate::number::{LANES, Lanes, Number, Real, Vector};

use super::collapse::{collapse, collapse_curvature};
use super::points::{PointLaw, Projected, largest_square, plane_wave};

/// A law of single points in the kernel's own precision, whose numbers a register holds once for each lane, whoever stands there.
pub(super) trait LaneLaw<T: Real>: Copy {
    /// Its numbers in registers.
    type Wide<V: Vector<T>>: WideLaw<V>;
    /// The law in every lane.
    fn splat<V: Vector<T>>(&self) -> Self::Wide<V>;
    /// Each lane's own law; what is no number from the first.
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> Self::Wide<V>;
}

/// A law of as many points as a number has lanes.
pub(super) trait WideLaw<N: Number>: Copy {
    /// Energy density, less what is projected, and first Piola-Kirchhoff stress, of what
    /// [`is_there`](crate::material::neo_hookean::is_there).
    fn at<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, projected: Projected<N>) -> (N, Gradient<N>);
    /// [`Constants::stiffness`](super::points::Constants::stiffness).
    fn stiffness(&self, f: &Gradient<N>, projected: Projected<N>) -> N;
}

impl<T: Real, L: LaneLaw<T>> PointLaw<T> for L {
    #[inline(always)]
    fn at<V: Vector<T>, const AXISYMMETRIC: bool>(
        &self,
        _: usize,
        f: &Gradient<V>,
        projected: Projected<V>,
    ) -> (V, Gradient<V>) {
        self.splat::<V>().at::<AXISYMMETRIC>(f, projected)
    }

    #[inline(always)]
    fn stiffness<V: Vector<T>>(&self, f: &Gradient<V>, projected: Projected<V>) -> V {
        self.splat::<V>().stiffness(f, projected)
    }
}

/// [`crate::material::neo_hookean`] in the kernel's own precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct NeoHookean<N> {
    pub mu: N,
    pub pointwise: N,
    pub projected: N,
    pub resists_collapse: bool,
}

impl<T: Real> LaneLaw<T> for NeoHookean<T> {
    type Wide<V: Vector<T>> = NeoHookean<V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> NeoHookean<V> {
        NeoHookean {
            mu: V::splat(self.mu),
            pointwise: V::splat(self.pointwise),
            projected: V::splat(self.projected),
            resists_collapse: self.resists_collapse,
        }
    }

    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> NeoHookean<V> {
        let of = |number: fn(&Self) -> T| Lanes(laws.each_ref().map(number));
        let (mu, pointwise, projected) = (of(|law| law.mu), of(|law| law.pointwise), of(|law| law.projected));
        NeoHookean {
            mu: V::load(&mu),
            pointwise: V::load(&pointwise),
            projected: V::load(&projected),
            resists_collapse: laws[0].resists_collapse,
        }
    }
}

impl<N: Number> WideLaw<N> for NeoHookean<N> {
    #[inline(always)]
    fn at<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, projected: Projected<N>) -> (N, Gradient<N>) {
        let cof = cofactor_in::<N, AXISYMMETRIC>(f);
        let j = determinant_in::<N, AXISYMMETRIC>(f, &cof);
        let (energy, own) = if self.resists_collapse {
            collapse(j, self.pointwise)
        } else {
            let dilation = j - N::of(1.0);
            (N::of(0.5) * self.pointwise * dilation * dilation, self.pointwise * dilation)
        };
        let energy = distortional_energy_in::<N, AXISYMMETRIC>(f, j, self.mu) + energy;
        (energy, first_piola_in::<N, AXISYMMETRIC>(f, &cof, j, self.mu, projected.pressure + own))
    }

    // the energy of volume being quadratic, the pressure does not change its curvature
    #[inline(always)]
    fn stiffness(&self, f: &Gradient<N>, _: Projected<N>) -> N {
        let cof = cofactor(f);
        let (j, lack) = clamped(determinant(f, &cof));
        let root = j.inverse_cube_root();
        let curvature = if self.resists_collapse { collapse_curvature(j) } else { N::of(1.0) };
        let bulk = self.projected + self.pointwise * curvature;
        plane_wave(f, largest_square(&cof), j, root * root * excess(lack), self.mu, bulk)
    }
}
