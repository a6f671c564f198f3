//! The laws of integration points as the loop of pass 2 sees them, in the kernel's own precision: any number of lanes, no choices among them.

use crate::material::invariants::Distortion;
use crate::material::neo_hookean::{
    Gradient, clamped, cofactor, cofactor_in, combined, determinant, determinant_in, distortional_energy_in, excess,
    first_piola_in, is_there,
};
use crate::material::ogden::MOST_TERMS;
use crate::material::shape::{self, NeoHookean as NeoHookeanShape, Shape, Wave, With, plane_wave};
use crate::material::stretches::{OfTerms, Stretches, Term, Terms};
use crate::material::{Distortional, IsochoricLaw, Law, MooneyRivlin, VerondaWestmann, Volumetric, Yeoh, own, prony};
use crate::number::{LANES, Lanes, Number, Real, Vector};

use super::VolumeRatio;
use super::collapse::{collapse, collapse_curvature};
use super::dilatation::POINTWISE_BULK;

/// Material and how its bulk modulus is shared out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants {
    pub law: Law,
    /// Bulk modulus of the projected part, Pa; 0 with the pointwise volume ratio.
    pub projected: f64,
    /// Bulk modulus of the pointwise part, Pa.
    pub pointwise: f64,
    /// Whether the pointwise part resists collapse, see [`super::dilatation`]; if not it is the law's own.
    pub resists_collapse: bool,
    /// Whether the distortion sees the projected volume ratio, see [`super::mixed`].
    pub mixed: bool,
}

/// What a point gets from the coarse nodes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Projected<N> {
    /// Pressure, Pa.
    pub pressure: N,
    /// theta^(-2/3) - 1 of [`super::mixed`]; zero without it.
    pub shrinkage: N,
}

impl Constants {
    /// How this bulk modulus is shared out for a volume ratio.
    pub(super) fn new(law: &Law, volume_ratio: VolumeRatio) -> Self {
        let kappa = law.bulk_modulus;
        let pointwise = match volume_ratio {
            VolumeRatio::Projected | VolumeRatio::Mixed => kappa.min(POINTWISE_BULK * law.shear_modulus()),
            VolumeRatio::Averaged => 0.0,
            VolumeRatio::Pointwise => kappa,
        };
        let resists_collapse = matches!(volume_ratio, VolumeRatio::Projected | VolumeRatio::Mixed);
        let own = Self { law: *law, projected: kappa - pointwise, pointwise, resists_collapse, mixed: false };
        Self { mixed: volume_ratio == VolumeRatio::Mixed && own.plain::<f64>().is_some(), ..own }
    }

    /// The constants of the neo-Hookean law with quadratic volumetric energy and no relaxation, if it is that.
    pub(super) fn plain<T: Real>(&self) -> Option<NeoHookean<T>> {
        match self.law {
            Law {
                distortional: Distortional::NeoHookean { shear_modulus },
                volumetric: Volumetric::Quadratic,
                prony,
                ..
            } if prony.is_empty() => Some(NeoHookean { mu: T::of(shear_modulus), volume: self.volume()? }),
            _ => None,
        }
    }

    /// Largest stiffness (Pa) of a plane wave u = a sin(N X) in the state F with projected pressure `pressure`:
    /// the largest a.A(N).a over unit vectors a, N, with A = dP/dF.
    ///
    /// With c the largest singular value of cof F, a.A(N).a <= (kappa u'')c^2 + mu (J^-2/3 + 5/9 J^-8/3 I1 c^2) for the
    /// neo-Hookean law (its mixed term is negative in principal directions); the pressure itself drops out, because det
    /// is linear along a (x) N.
    pub(super) fn stiffness(&self, f: &Gradient<f64>, pressure: f64) -> f64 {
        let cof = cofactor(f);
        let (j, lack) = clamped(determinant(f, &cof));
        let pointwise =
            if self.resists_collapse { collapse_curvature(j) } else { self.law.volumetric.curvature(j - 1.0) };
        let projected = match self.projected {
            kappa if kappa > 0.0 => self.law.volumetric.curvature(self.law.volumetric.dilation(pressure / kappa)),
            _ => 0.0,
        };
        let bulk = self.projected * projected + self.pointwise * pointwise;
        let c2 = largest_square(&cof);
        let wave = Wave { f, cof: &cof, j, lack, largest: largest_square(f), c2, bulk };
        match &self.law.distortional {
            Distortional::NeoHookean { shear_modulus } => wave.of_modulus(*shear_modulus),
            Distortional::Ogden(law) => {
                let root = j.inverse_cube_root();
                let cube = root * root;
                wave.of_modulus(law.stiffness(cube * wave.largest, cube * j * j / c2))
            }
            Distortional::MooneyRivlin(law) => With::of(law).stiffness(&wave),
            Distortional::Yeoh(law) => With::of(law).stiffness(&wave),
            Distortional::VerondaWestmann(law) => With::of(law).stiffness(&wave),
            Distortional::Own(law) => law.stiffness(&wave),
        }
    }
}

/// About the square of the largest singular value: tr S^5 / tr S^4 with S = A^T A, exact where one value dominates or
/// all are equal.
#[inline(always)]
pub(super) fn largest_square<T: Number>(a: &Gradient<T>) -> T {
    let mut s = [
        of_columns(a, 0, 0),
        of_columns(a, 1, 1),
        of_columns(a, 2, 2),
        of_columns(a, 0, 1),
        of_columns(a, 1, 2),
        of_columns(a, 2, 0),
    ];
    let trace = s[0] + s[1] + s[2];
    let inverse = T::of(1.0) / trace;
    for x in &mut s {
        *x = *x * inverse;
    }
    let s2 = product(&s, &s);
    let s3 = product(&s2, &s);
    trace * inner(&s3, &s2) / inner(&s2, &s2)
}

/// Inner product of two columns.
#[inline(always)]
fn of_columns<T: Number>(a: &Gradient<T>, i: usize, j: usize) -> T {
    a[i] * a[j] + a[i + 3] * a[j + 3] + a[i + 6] * a[j + 6]
}

/// A symmetric tensor: xx, yy, zz, xy, yz, zx.
type Symmetric<T> = [T; 6];

/// Product of two that commute.
#[inline(always)]
fn product<T: Number>(x: &Symmetric<T>, y: &Symmetric<T>) -> Symmetric<T> {
    [
        x[0] * y[0] + x[3] * y[3] + x[5] * y[5],
        x[3] * y[3] + x[1] * y[1] + x[4] * y[4],
        x[5] * y[5] + x[4] * y[4] + x[2] * y[2],
        x[0] * y[3] + x[3] * y[1] + x[5] * y[4],
        x[3] * y[5] + x[1] * y[4] + x[4] * y[2],
        x[5] * y[0] + x[4] * y[3] + x[2] * y[5],
    ]
}

/// Inner product of two.
#[inline(always)]
fn inner<T: Number>(x: &Symmetric<T>, y: &Symmetric<T>) -> T {
    let off = x[3] * y[3] + x[4] * y[4] + x[5] * y[5];
    x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + off + off
}

/// Energy density and stress of a group of points.
pub(super) trait PointLaw<T: Real> {
    /// Energy density, less the projected volumetric part, and first Piola-Kirchhoff stress (Pa, row-major) of the
    /// points of one group of a block, from their deformation gradients and what is projected.
    fn at<V: Vector<T>, const AXISYMMETRIC: bool>(
        &self,
        group: usize,
        f: &Gradient<V>,
        projected: Projected<V>,
    ) -> (V, Gradient<V>);
    /// [`Constants::stiffness`] of the same points.
    fn stiffness<V: Vector<T>>(&self, f: &Gradient<V>, projected: Projected<V>) -> V;
}

/// Laws of the change of shape in the kernel's own precision, or in registers.
#[derive(Clone, Copy, Debug)]
pub(super) enum AnyShape<T: Real, N = T> {
    NeoHookean(With<NeoHookeanShape, N, 1>),
    MooneyRivlin(With<MooneyRivlin, N, 2>),
    Yeoh(With<Yeoh, N, 3>),
    VerondaWestmann(With<VerondaWestmann, N, 2>),
    Ogden(Stretches<N>),
    Own(own::Wide<T, N>),
}

/// `with_shape!((shape) => (name) { ... })`: the body for the law that it is.
macro_rules! with_shape {
    (($any:expr) => ($name:ident) $body:block) => {
        match $any {
            AnyShape::NeoHookean($name) => $body,
            AnyShape::MooneyRivlin($name) => $body,
            AnyShape::Yeoh($name) => $body,
            AnyShape::VerondaWestmann($name) => $body,
            AnyShape::Ogden($name) => $body,
            AnyShape::Own($name) => $body,
        }
    };
}
impl Constants {
    /// The law of the change of shape for points in the lanes.
    pub(super) fn shape<T: Real>(&self) -> AnyShape<T> {
        match &self.law.distortional {
            Distortional::NeoHookean { shear_modulus: mu } => {
                AnyShape::NeoHookean(With::of(&NeoHookeanShape { mu: *mu }))
            }
            Distortional::MooneyRivlin(law) => AnyShape::MooneyRivlin(With::of(law)),
            Distortional::Yeoh(law) => AnyShape::Yeoh(With::of(law)),
            Distortional::VerondaWestmann(law) => AnyShape::VerondaWestmann(With::of(law)),
            Distortional::Ogden(law) => AnyShape::Ogden(Stretches::of(law)),
            Distortional::Own(law) => AnyShape::Own(law.wide()),
        }
    }

    /// What is left to points in the lanes of the energy of volume. `None`: the logarithmic energy is a difference of like numbers, which
    /// needs double precision.
    pub(super) fn volume<T: Real>(&self) -> Option<Volume<T>> {
        let Self { law, projected, pointwise, resists_collapse, .. } = *self;
        (resists_collapse || law.volumetric == Volumetric::Quadratic).then(|| Volume {
            pointwise: T::of(pointwise),
            projected: T::of(projected),
            resists_collapse,
            law: law.volumetric,
        })
    }
}

/// One of the laws: a loop for all of them that asks at each group which one it is: with a loop for each, the crate's code and the
/// time to compile it were half as large again.
impl<T: Real, N: Vector<T>> Shape<N> for AnyShape<T, N> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, cof: &Gradient<N>, j: N) -> Distortion<N> {
        with_shape!((self) => (shape) { shape::distortion::<N, _, AXISYMMETRIC>(shape, f, cof, j) })
    }

    #[inline(always)]
    fn stiffness(&self, wave: &Wave<'_, N>) -> N {
        with_shape!((self) => (shape) { shape::stiffness(shape, wave) })
    }
}

impl<T: Real> LaneShape<T> for AnyShape<T> {
    type Wide<V: Vector<T>> = AnyShape<T, V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> AnyShape<T, V> {
        match self {
            Self::NeoHookean(law) => AnyShape::NeoHookean(law.splat()),
            Self::MooneyRivlin(law) => AnyShape::MooneyRivlin(law.splat()),
            Self::Yeoh(law) => AnyShape::Yeoh(law.splat()),
            Self::VerondaWestmann(law) => AnyShape::VerondaWestmann(law.splat()),
            Self::Ogden(law) => AnyShape::Ogden(law.splat()),
            Self::Own(law) => AnyShape::Own(law.splat()),
        }
    }

    // of one law: where another stands among them, it counts as the first
    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> AnyShape<T, V> {
        macro_rules! all {
            ($law:ident, $first:ident) => {
                AnyShape::$law(LaneShape::side_by_side(
                    &laws.each_ref().map(|law| if let Self::$law(law) = law { *law } else { $first }),
                ))
            };
        }
        match laws[0] {
            Self::NeoHookean(first) => all!(NeoHookean, first),
            Self::MooneyRivlin(first) => all!(MooneyRivlin, first),
            Self::Yeoh(first) => all!(Yeoh, first),
            Self::VerondaWestmann(first) => all!(VerondaWestmann, first),
            Self::Ogden(first) => all!(Ogden, first),
            Self::Own(first) => all!(Own, first),
        }
    }
}

/// [`AnyShape`] whose numbers are taken into registers where the law is known.
#[derive(Clone, Copy)]
pub(super) struct Splat<'a, T: Real>(pub &'a AnyShape<T>);

impl<T: Real, V: Vector<T>> Shape<V> for Splat<'_, T> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<V>, cof: &Gradient<V>, j: V) -> Distortion<V> {
        match self.0 {
            AnyShape::NeoHookean(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::MooneyRivlin(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::Yeoh(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::VerondaWestmann(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::Ogden(law) => shape::distortion::<V, _, AXISYMMETRIC>(&OfTerms(SplatTerms(law)), f, cof, j),
            AnyShape::Own(law) => LaneShape::splat::<V>(law).distortion::<AXISYMMETRIC>(f, cof, j),
        }
    }

    #[inline(always)]
    fn stiffness(&self, wave: &Wave<'_, V>) -> V {
        match self.0 {
            AnyShape::NeoHookean(law) => shape::stiffness(&law.splat::<V>(), wave),
            AnyShape::MooneyRivlin(law) => shape::stiffness(&law.splat::<V>(), wave),
            AnyShape::Yeoh(law) => shape::stiffness(&law.splat::<V>(), wave),
            AnyShape::VerondaWestmann(law) => shape::stiffness(&law.splat::<V>(), wave),
            AnyShape::Ogden(law) => shape::stiffness(&OfTerms(SplatTerms(law)), wave),
            AnyShape::Own(law) => LaneShape::splat::<V>(law).stiffness(wave),
        }
    }
}

/// Ogden's law whose terms are taken into registers one by one.
#[derive(Clone, Copy)]
struct SplatTerms<'a, T>(&'a Stretches<T>);

impl<T: Real, V: Vector<T>> Terms<V> for SplatTerms<'_, T> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.0.count
    }

    #[inline(always)]
    fn term(&self, k: usize) -> Term<V> {
        self.0.terms[k].splat()
    }
}

/// A law of single points in the kernel's own precision, whose numbers a register holds once for each lane, whoever stands there.
pub(super) trait LaneLaw<T: Real>: Copy {
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
    /// [`Constants::stiffness`].
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
    type Wide<V: Vector<T>>: Shape<V>;
    fn splat<V: Vector<T>>(&self) -> Self::Wide<V>;
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> Self::Wide<V>;
}

/// One number of each law.
#[inline(always)]
pub(super) fn of_each<T: Real, L, V: Vector<T>>(laws: &[L; LANES], number: impl Fn(&L) -> T) -> V {
    V::load(&Lanes(laws.each_ref().map(number)))
}

impl<T: Real, L: IsochoricLaw<C>, const C: usize> LaneShape<T> for With<L, T, C> {
    type Wide<V: Vector<T>> = With<L, V, C>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> With<L, V, C> {
        With::new(splat_all(&self.constants))
    }

    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> With<L, V, C> {
        With::new(each_of(&laws.each_ref().map(|law| &law.constants)))
    }
}

impl<T: Real> LaneShape<T> for own::Wide<T, T> {
    type Wide<V: Vector<T>> = own::Wide<T, V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> own::Wide<T, V> {
        own::Wide { constants: splat_all(&self.constants), law: self.law }
    }

    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> own::Wide<T, V> {
        own::Wide { constants: each_of(&laws.each_ref().map(|law| &law.constants)), law: laws[0].law }
    }
}

#[inline(always)]
fn splat_all<T: Real, V: Vector<T>, const C: usize>(constants: &[T; C]) -> [V; C] {
    let mut out = [V::default(); C];
    for k in 0..C {
        out[k] = V::splat(constants[k]);
    }
    out
}

#[inline(always)]
fn each_of<T: Real, V: Vector<T>, const C: usize>(constants: &[&[T; C]; LANES]) -> [V; C] {
    let mut out = [V::default(); C];
    for k in 0..C {
        out[k] = of_each(constants, |constants| constants[k]);
    }
    out
}

/// A law of the change of shape with the energy of volume as a [`Constants`] shares it out.
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

/// Stress where the distortion sees the projected volume ratio (see [`super::mixed`]), Pa; `own`: kappa_s w'(J), Pa.
#[inline(always)]
pub(super) fn mixed_stress<T: Number, const AXISYMMETRIC: bool>(
    f: &Gradient<T>,
    cof: &Gradient<T>,
    mu: T,
    projected: Projected<T>,
    own: T,
) -> Gradient<T> {
    let a = mu.product_sum(projected.shrinkage, mu);
    let b = projected.pressure + own - mu;
    combined::<T, AXISYMMETRIC>(a, f, b, cof)
}

/// A deformation gradient; zeros where a half plane has no other.
#[inline(always)]
pub(super) fn load<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(f: &Gradient<Lanes<T>>) -> Gradient<V> {
    let mut out = [V::default(); 9];
    for k in 0..9 {
        if is_there::<AXISYMMETRIC>(k) {
            out[k] = V::load(&f[k]);
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::memory::{Memory, Relaxing};
    use super::*;
    use crate::material::Ogden;

    /// What the kernel adds up: every law with every sharing of the bulk modulus, and a projected pressure, whose energy
    /// is linear in the point's J.
    #[test]
    fn stress_is_the_derivative_of_the_energy_over_all_volume_ratios() {
        let ogden = Distortional::Ogden(Ogden::new(&[400.0, 900.0, 378.0], &[1.3, 5.0, -2.0]).unwrap());
        let neo = Law::neo_hookean(1678.0, 83_340.0);
        let memories = [Memory::default(), Memory::holding([-310.0, 150.0, 90.0, 420.0, -75.0, 205.0], 0.8)];
        let mooney = Distortional::MooneyRivlin(MooneyRivlin { c10: 539.0, c01: 300.0 });
        let yeoh = Distortional::Yeoh(Yeoh { c10: 839.0, c20: -100.0, c30: 50.0 });
        let veronda = Distortional::VerondaWestmann(VerondaWestmann { shear_modulus: 1678.0, exponent: 1.5 });
        let own = Distortional::Own(own::Own::new(&Yeoh { c10: 839.0, c20: 40.0, c30: 5.0 }));
        let shapes = [Distortional::NeoHookean { shear_modulus: 1678.0 }, ogden, mooney, yeoh, veronda, own];
        let laws = shapes.into_iter().flat_map(|distortional| {
            [Volumetric::Quadratic, Volumetric::Logarithmic].map(|volumetric| Law { distortional, volumetric, ..neo })
        });
        let shape = [1.3, 0.2, -0.1, 0.05, 0.8, 0.3, 0.0, -0.2, 1.05];
        let unit = determinant(&shape, &cofactor::<f64>(&shape));
        for (law, memory) in laws.flat_map(|law| memories.iter().map(move |m| (law, m))) {
            for (projected, resists_collapse) in [(78_306.0, true), (83_340.0, false), (0.0, false)] {
                let constants =
                    Constants { law, projected, pointwise: 83_340.0 - projected, resists_collapse, mixed: false };
                let point = Relaxing { constants: &constants, memory };
                for step in (0..200).step_by(if cfg!(miri) { 50 } else { 1 }) {
                    // from 0.001 to 5, past the kink in the second derivative at 0.02
                    let j = 0.001 * 5000.0_f64.powf((f64::from(step) + 0.5) / 200.0);
                    let f = shape.map(|x| x * (j / unit).cbrt());
                    let pressure = 0.3 * projected;
                    let given = Projected { pressure, shrinkage: 0.0 };
                    let energy =
                        |f: &Gradient<f64>| point.evaluate(0, f, given).0 + pressure * determinant(f, &cofactor(f));
                    let stress = point.evaluate(0, &f, given).1;
                    let scale = stress.iter().fold(83_340.0_f64, |a, p| a.max(p.abs())) + energy(&f).abs() / j.cbrt();
                    for i in 0..9 {
                        let moved = |h: f64| {
                            let mut g = f;
                            g[i] += h;
                            energy(&g)
                        };
                        let h = 5e-4 * j.cbrt();
                        let slope = (8.0 * (moved(h) - moved(-h)) - (moved(2.0 * h) - moved(-2.0 * h))) / (12.0 * h);
                        assert!((slope - stress[i]).abs() < 1e-7 * scale, "{law:?} {j} {i}: {slope} {}", stress[i]);
                    }
                }
            }
        }
    }

    #[test]
    fn the_stiffness_by_lanes_is_the_one_in_double_precision() {
        for resists_collapse in [true, false] {
            let law = Law::neo_hookean(1678.0, 83_000.0);
            let constants = Constants { law, projected: 75_000.0, pointwise: 8000.0, resists_collapse, mixed: false };
            let (single, double) = (constants.plain::<f32>().unwrap(), constants.plain::<f64>().unwrap());
            // from next to nothing to torn and crushed
            for size in [0.0, 0.01, 0.3, 0.8, 1.5] {
                let f: Gradient<Lanes<f64>> = std::array::from_fn(|i| {
                    let undeformed = if i % 4 == 0 { 1.0 } else { 0.0 };
                    Lanes(std::array::from_fn(|lane| undeformed + size * (1.7 * i as f64 + 2.3 * lane as f64).sin()))
                });
                let narrow = f.map(|x| Lanes(x.0.map(|x| x as f32)));
                let (single, double) = (
                    PointLaw::stiffness(&single, &narrow, Projected::default()),
                    PointLaw::stiffness(&double, &f, Projected::default()),
                );
                for lane in 0..LANES {
                    let exact = constants.stiffness(&f.map(|x| x.0[lane]), 0.0);
                    assert!((double.0[lane] / exact - 1.0).abs() < 1e-12, "{size} {lane}");
                    // J itself is a small difference where a point is crushed
                    assert!((f64::from(single.0[lane]) / exact - 1.0).abs() < 1e-3, "{size} {lane}");
                }
            }
        }
    }

    /// Every law; those that stiffen or soften much among them.
    fn every_shape() -> [Distortional; 9] {
        let ogden = |moduli: &[f64], exponents: &[f64]| Distortional::Ogden(Ogden::new(moduli, exponents).unwrap());
        [
            Distortional::NeoHookean { shear_modulus: 1678.0 },
            Distortional::MooneyRivlin(MooneyRivlin { c10: 539.0, c01: 300.0 }),
            Distortional::Yeoh(Yeoh { c10: 839.0, c20: -60.0, c30: 20.0 }),
            Distortional::VerondaWestmann(VerondaWestmann { shear_modulus: 1678.0, exponent: 0.8 }),
            Distortional::Own(own::Own::new(&MooneyRivlin { c10: 539.0, c01: 300.0 })),
            ogden(&[1678.0], &[-4.7]),
            ogden(&[400.0, 900.0, 378.0], &[1.3, 5.0, -2.0]),
            ogden(&[1678.0], &[0.5]),
            ogden(&[1678.0], &[10.0]),
        ]
    }

    /// Deformations of eight points, of a half plane or of space, with stretches that lie `spread` apart, from none to so many.
    fn deformations(volume: f64, spread: f64, axisymmetric: bool) -> Gradient<Lanes<f32>> {
        let turn = |angle: f64, [p, q]: [usize; 2], f: &Gradient<f64>| -> Gradient<f64> {
            let (sin, cos) = angle.sin_cos();
            std::array::from_fn(|n| match n / 3 {
                i if i == p => cos * f[n] - sin * f[3 * q + n % 3],
                i if i == q => sin * f[3 * p + n % 3] + cos * f[n],
                _ => f[n],
            })
        };
        let transposed = |f: &Gradient<f64>| -> Gradient<f64> { std::array::from_fn(|n| f[n % 3 * 3 + n / 3]) };
        let mut out = [Lanes::default(); 9];
        for lane in 0..LANES {
            let k = lane as f64;
            let logs: [f64; 3] =
                std::array::from_fn(|i| spread.ln() * (1.1 + 2.3 * k + 1.9 * i as f64 * (k + 1.0)).sin());
            let mean = (logs[0] + logs[1] + logs[2] - volume.ln()) / 3.0;
            let mut f = [0.0; 9];
            (0..3).for_each(|i| f[4 * i] = (logs[i] - mean).exp());
            for side in 0..2 {
                let angle = 0.7 + 1.3 * k + f64::from(side);
                f = turn(angle, [2, 0], &f);
                if !axisymmetric {
                    f = turn(2.0 * angle, [1, 2], &turn(1.5 * angle, [0, 1], &f));
                }
                f = transposed(&f);
            }
            (0..9).for_each(|n| out[n].0[lane] = f[n] as f32);
        }
        out
    }

    /// Largest differences of energy density and stress between the lanes and double precision, over the stiffness of a plane wave.
    fn off<const AXISYMMETRIC: bool>(distortional: Distortional, f: &Gradient<Lanes<f32>>) -> [f64; 3] {
        let law = Law { distortional, ..Law::neo_hookean(1678.0, 83_340.0) };
        let constants = Constants { law, projected: 0.0, pointwise: 0.0, resists_collapse: true, mixed: false };
        let cof = cofactor_in::<_, AXISYMMETRIC>(f);
        let j = determinant(f, &cof);
        let lanes = WithVolume { shape: constants.shape::<f32>(), volume: constants.volume().unwrap() };
        let found = LaneShape::splat::<Lanes<f32>>(&lanes.shape).distortion::<AXISYMMETRIC>(f, &cof, j);
        let stiffness = PointLaw::stiffness::<Lanes<f32>>(&lanes, f, Projected::default());
        let mut off = [0.0_f64; 3];
        for lane in 0..LANES {
            let of_lane = |x: &Gradient<Lanes<f32>>| x.map(|x| f64::from(x.0[lane]));
            let f = of_lane(f);
            let cof = cofactor(&f);
            let (w, p) = law.distortion(&f, &cof, determinant(&f, &cof));
            let bound = constants.stiffness(&f, 0.0);
            let largest = largest_square(&f).sqrt();
            let scale = p.iter().fold(bound * largest, |a, p| a.max(p.abs()));
            off[0] = off[0].max((f64::from(found.energy.0[lane]) - w).abs() / (scale * largest));
            for n in (0..9).filter(|&n| is_there::<AXISYMMETRIC>(n)) {
                let stress = f64::from(found.across.0[lane]) * cof[n] + f64::from(found.stress[n].0[lane]);
                let error = (stress - p[n]).abs() / scale;
                off[1] = if error.is_nan() { f64::NAN } else { off[1].max(error) };
            }
            off[2] = off[2].max((f64::from(stiffness.0[lane]) / bound - 1.0).abs());
        }
        off
    }

    #[test]
    fn every_law_in_the_lanes_is_the_one_in_double_precision() {
        for distortional in every_shape() {
            for (volume, spread) in [1.0, 0.6, 0.1, 0.021, 0.019, 0.001, 3.0]
                .into_iter()
                .flat_map(|volume| [1.0, 1.0 + 1e-6, 1.0 + 1e-4, 1.02, 1.3, 2.0, 5.5].map(|spread| (volume, spread)))
            {
                let space = off::<false>(distortional, &deformations(volume, spread, false));
                let plane = off::<true>(distortional, &deformations(volume, spread, true));
                for [energy, stress, stiffness] in [space, plane] {
                    let said = format!("{distortional:?} at {volume} {spread}: {energy:e} {stress:e} {stiffness:e}");
                    assert!(energy < 2e-6 && stress < 3e-6 && stiffness < 2e-5, "{said}");
                }
            }
        }
    }

    #[test]
    fn the_largest_singular_value_dominates_or_all_are_equal() {
        let stretched = [3.0, 0.0, 0.0, 0.0, 0.5, 0.1, 0.0, 0.0, 0.2];
        assert!((largest_square::<f64>(&stretched) / 9.0 - 1.0).abs() < 1e-3);
        // a rotation
        let turned = [0.0, -1.0, 0.0, 0.6, 0.0, -0.8, 0.8, 0.0, 0.6];
        assert!((largest_square::<f64>(&turned) - 1.0).abs() < 1e-12);
    }
}
