//! Laws of single points in the kernel's own precision.

use crate::material::invariants::Distortion;
use crate::material::neo_hookean::{
    Gradient, clamped, cofactor, cofactor_in, determinant, determinant_in, distortional_energy_in, excess,
    first_piola_in, is_there,
};
use crate::material::ogden::MOST_TERMS;
use crate::material::shape::{self, NeoHookean as NeoHookeanShape, Shape, Wave, plane_wave};
use crate::material::stretches::{Stretches, Term};
use crate::material::{MooneyRivlin, VerondaWestmann, Volumetric, Yeoh, prony};
use crate::number::{LANES, Lanes, Number, Real, Vector};

use super::collapse::{collapse, collapse_curvature};
use super::points::{PointLaw, Projected, largest_square};

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

/// A law of the change of shape in the kernel's own precision.
pub(super) trait LaneShape<T: Real>: Copy {
    /// Its numbers in registers.
    type Wide<V: Vector<T>>: Shape<V>;
    /// See [`LaneLaw::splat`].
    fn splat<V: Vector<T>>(&self) -> Self::Wide<V>;
    /// See [`LaneLaw::side_by_side`].
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> Self::Wide<V>;
}

/// One number of each law.
#[inline(always)]
pub(super) fn of_each<T: Real, L, V: Vector<T>>(laws: &[L; LANES], number: impl Fn(&L) -> T) -> V {
    V::load(&Lanes(laws.each_ref().map(number)))
}

macro_rules! lane_shapes {
    ($($law:ident { $($number:ident),+ })+) => {$(
        impl<T: Real> LaneShape<T> for $law<T> {
            type Wide<V: Vector<T>> = $law<V>;

            #[inline(always)]
            fn splat<V: Vector<T>>(&self) -> $law<V> {
                $law { $($number: V::splat(self.$number)),+ }
            }

            #[inline(always)]
            fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> $law<V> {
                $law { $($number: of_each(laws, |law| law.$number)),+ }
            }
        }
    )+};
}

lane_shapes! {
    NeoHookeanShape { mu }
    MooneyRivlin { c10, c01 }
    Yeoh { c10, c20, c30 }
    VerondaWestmann { shear_modulus, exponent }
}

/// A law of the change of shape with the energy of volume as a [`Constants`](super::points::Constants) shares it out.
#[derive(Clone, Copy, Debug)]
pub(super) struct WithVolume<S, N> {
    pub shape: S,
    pub volume: Volume<N>,
}

/// What is left to a point of the energy of volume.
#[derive(Clone, Copy, Debug)]
pub(super) struct Volume<N> {
    pub pointwise: N,
    pub projected: N,
    pub resists_collapse: bool,
    /// The law of what is projected. What is left to the points is quadratic if it does not resist collapse.
    pub law: Volumetric,
}

impl<N: Number> Volume<N> {
    /// Energy density and pressure.
    #[inline(always)]
    pub(super) fn own(&self, j: N) -> (N, N) {
        if self.resists_collapse {
            return collapse(j, self.pointwise);
        }
        let dilation = j - N::of(1.0);
        (N::of(0.5) * self.pointwise * dilation * dilation, self.pointwise * dilation)
    }

    /// Its second derivative with the projected part's, from the clamped J and the projected pressure.
    #[inline(always)]
    pub(super) fn curvature(&self, j: N, pressure: N) -> N {
        let own = if self.resists_collapse { collapse_curvature(j) } else { N::of(1.0) };
        let projected = match self.law {
            Volumetric::Quadratic => self.projected,
            // without a projected part the pressure is zero as well
            Volumetric::Logarithmic => {
                let slope = pressure / self.projected.max(N::of(f64::from(f32::MIN_POSITIVE)));
                self.projected * self.law.curvature(self.law.dilation(slope))
            }
        };
        projected + self.pointwise * own
    }
}

impl<T: Real> Volume<T> {
    /// In registers.
    #[inline(always)]
    pub(super) fn splat<V: Vector<T>>(&self) -> Volume<V> {
        let Self { pointwise, projected, resists_collapse, law } = *self;
        Volume { pointwise: V::splat(pointwise), projected: V::splat(projected), resists_collapse, law }
    }

    /// Each lane's own; what is no number from the first.
    #[inline(always)]
    fn side_by_side<L, V: Vector<T>>(laws: &[L; LANES], of: impl Fn(&L) -> &Self) -> Volume<V> {
        let Self { resists_collapse, law, .. } = *of(&laws[0]);
        let pointwise = of_each(laws, |law| of(law).pointwise);
        Volume { pointwise, projected: of_each(laws, |law| of(law).projected), resists_collapse, law }
    }
}

impl<T: Real, S: LaneShape<T>> LaneLaw<T> for WithVolume<S, T> {
    type Wide<V: Vector<T>> = WithVolume<S::Wide<V>, V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> Self::Wide<V> {
        WithVolume { shape: self.shape.splat(), volume: self.volume.splat() }
    }

    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> Self::Wide<V> {
        let shape = S::side_by_side(&laws.each_ref().map(|law| law.shape));
        WithVolume { shape, volume: Volume::side_by_side(laws, |law| &law.volume) }
    }
}

impl<T: Real> Term<T> {
    /// In registers.
    #[inline(always)]
    pub(crate) fn splat<V: Vector<T>>(&self) -> Term<V> {
        let Self { half, factor, energy, modulus } = *self;
        Term { half: V::splat(half), factor: V::splat(factor), energy: V::splat(energy), modulus: V::splat(modulus) }
    }
}

impl<T: Real> LaneShape<T> for Stretches<T> {
    type Wide<V: Vector<T>> = Stretches<V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> Stretches<V> {
        let mut terms = [Term::default(); MOST_TERMS];
        for k in 0..self.count {
            terms[k] = self.terms[k].splat();
        }
        Stretches { terms, count: self.count }
    }

    // a law of fewer terms has zeros for them, which add nothing
    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> Stretches<V> {
        let mut terms = [Term::default(); MOST_TERMS];
        let count = laws.iter().map(|law| law.count).max().unwrap_or(0);
        for k in 0..count {
            terms[k] = Term {
                half: of_each(laws, |law| law.terms[k].half),
                factor: of_each(laws, |law| law.terms[k].factor),
                energy: of_each(laws, |law| law.terms[k].energy),
                modulus: of_each(laws, |law| law.terms[k].modulus),
            };
        }
        Stretches { terms, count }
    }
}

impl<N: Number, S: Shape<N>> WithVolume<S, N> {
    /// As [`WideLaw::at`] within an increment of time: gamma and H of [`prony`].
    #[inline(always)]
    pub(super) fn relaxing<const AXISYMMETRIC: bool>(
        &self,
        f: &Gradient<N>,
        projected: Projected<N>,
        gamma: N,
        h: &[N; 6],
    ) -> (N, Gradient<N>) {
        let cof = cofactor_in::<N, AXISYMMETRIC>(f);
        let j = determinant_in::<N, AXISYMMETRIC>(f, &cof);
        let (energy, own) = self.volume.own(j);
        let now = shape::distortion::<N, S, AXISYMMETRIC>(&self.shape, f, &cof, j);
        let held = prony::held_in::<N, AXISYMMETRIC>(f, j, h);
        let mut stress = held.stress;
        for n in 0..9 {
            if is_there::<AXISYMMETRIC>(n) {
                stress[n] = gamma.product_sum(now.stress[n], stress[n]);
            }
        }
        let across = gamma.product_sum(now.across, held.across);
        let energy = gamma.product_sum(now.energy, held.energy) + energy;
        (energy, with_pressure::<N, AXISYMMETRIC>(stress, &cof, projected.pressure + own + across))
    }
}

impl<N: Number, S: Shape<N>> WideLaw<N> for WithVolume<S, N> {
    #[inline(always)]
    fn at<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, projected: Projected<N>) -> (N, Gradient<N>) {
        let cof = cofactor_in::<N, AXISYMMETRIC>(f);
        let j = determinant_in::<N, AXISYMMETRIC>(f, &cof);
        let (energy, own) = self.volume.own(j);
        let Distortion { energy: distortional, stress, across } =
            shape::distortion::<N, S, AXISYMMETRIC>(&self.shape, f, &cof, j);
        (distortional + energy, with_pressure::<N, AXISYMMETRIC>(stress, &cof, projected.pressure + own + across))
    }

    #[inline(always)]
    fn stiffness(&self, f: &Gradient<N>, projected: Projected<N>) -> N {
        let cof = cofactor(f);
        let (j, lack) = clamped(determinant(f, &cof));
        let bulk = self.volume.curvature(j, projected.pressure);
        let (largest, c2) = (largest_square(f), largest_square(&cof));
        shape::stiffness(&self.shape, &Wave { f, cof: &cof, j, lack, largest, c2, bulk })
    }
}

/// P + p cof F, of what [`is_there`].
#[inline(always)]
pub(super) fn with_pressure<N: Number, const AXISYMMETRIC: bool>(
    stress: Gradient<N>,
    cof: &Gradient<N>,
    p: N,
) -> Gradient<N> {
    let mut stress = stress;
    for n in 0..9 {
        if is_there::<AXISYMMETRIC>(n) {
            stress[n] = p.product_sum(cof[n], stress[n]);
        }
    }
    stress
}

/// [`crate::material::neo_hookean`] in the kernel's own precision, with the quadratic energy of volume.
#[derive(Clone, Copy, Debug)]
pub(super) struct NeoHookean<N> {
    pub mu: N,
    pub volume: Volume<N>,
}

impl<T: Real> LaneLaw<T> for NeoHookean<T> {
    type Wide<V: Vector<T>> = NeoHookean<V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> NeoHookean<V> {
        NeoHookean { mu: V::splat(self.mu), volume: self.volume.splat() }
    }

    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> NeoHookean<V> {
        NeoHookean { mu: of_each(laws, |law| law.mu), volume: Volume::side_by_side(laws, |law| &law.volume) }
    }
}

impl<N: Number> WideLaw<N> for NeoHookean<N> {
    #[inline(always)]
    fn at<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, projected: Projected<N>) -> (N, Gradient<N>) {
        let cof = cofactor_in::<N, AXISYMMETRIC>(f);
        let j = determinant_in::<N, AXISYMMETRIC>(f, &cof);
        let (energy, own) = self.volume.own(j);
        let energy = distortional_energy_in::<N, AXISYMMETRIC>(f, j, self.mu) + energy;
        (energy, first_piola_in::<N, AXISYMMETRIC>(f, &cof, j, self.mu, projected.pressure + own))
    }

    #[inline(always)]
    fn stiffness(&self, f: &Gradient<N>, projected: Projected<N>) -> N {
        let cof = cofactor(f);
        let (j, lack) = clamped(determinant(f, &cof));
        let root = j.inverse_cube_root();
        let bulk = self.volume.curvature(j, projected.pressure);
        plane_wave(f, largest_square(&cof), j, root * root * excess(lack), self.mu, bulk)
    }
}
