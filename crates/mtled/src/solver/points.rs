//! The law at one integration point, as the loop of pass 2 sees it.

use crate::material::invariants::Distortion;
use crate::material::neo_hookean::{Gradient, clamped, cofactor, determinant};
use crate::material::shape::{self, NeoHookean as NeoHookeanShape, Shape, Wave};
use crate::material::stretches::{OfTerms, Stretches, Term, Terms};
use crate::material::{Distortional, Law, MooneyRivlin, VerondaWestmann, Volumetric, Yeoh};

use super::VolumeRatio;
use super::collapse::{collapse, collapse_curvature};
use super::dilatation::POINTWISE_BULK;
use super::lane_law::{LaneShape, NeoHookean, Volume, WideLaw, WithVolume};
use super::memory::Memory;
use super::mixed::{self, Mixed};
use crate::number::{LANES, Lanes};
use crate::number::{Number, Real, Vector};

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

    /// The same where the distortion sees the projected volume ratio.
    pub(super) fn of_mixed<T: Real>(&self) -> Option<Mixed<T>> {
        self.mixed.then(|| Mixed::new(self))
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
}

impl Constants {
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
            Distortional::MooneyRivlin(law) => Shape::stiffness(law, &wave),
            Distortional::Yeoh(law) => Shape::stiffness(law, &wave),
            Distortional::VerondaWestmann(law) => Shape::stiffness(law, &wave),
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

/// Laws of the change of shape in the kernel's own precision.
#[derive(Clone, Copy, Debug)]
pub(super) enum AnyShape<T> {
    NeoHookean(NeoHookeanShape<T>),
    MooneyRivlin(MooneyRivlin<T>),
    Yeoh(Yeoh<T>),
    VerondaWestmann(VerondaWestmann<T>),
    Ogden(Stretches<T>),
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
        }
    };
}
impl Constants {
    /// The law of the change of shape for points in the lanes.
    pub(super) fn shape<T: Real>(&self) -> AnyShape<T> {
        match &self.law.distortional {
            Distortional::NeoHookean { shear_modulus } => {
                AnyShape::NeoHookean(NeoHookeanShape { mu: T::of(*shear_modulus) })
            }
            Distortional::MooneyRivlin(law) => {
                AnyShape::MooneyRivlin(MooneyRivlin { c10: T::of(law.c10), c01: T::of(law.c01) })
            }
            Distortional::Yeoh(law) => {
                AnyShape::Yeoh(Yeoh { c10: T::of(law.c10), c20: T::of(law.c20), c30: T::of(law.c30) })
            }
            Distortional::VerondaWestmann(law) => AnyShape::VerondaWestmann(VerondaWestmann {
                shear_modulus: T::of(law.shear_modulus),
                exponent: T::of(law.exponent),
            }),
            Distortional::Ogden(law) => AnyShape::Ogden(Stretches::of(law)),
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
impl<N: Number> Shape<N> for AnyShape<N> {
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
    type Wide<V: Vector<T>> = AnyShape<V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> AnyShape<V> {
        match self {
            Self::NeoHookean(law) => AnyShape::NeoHookean(law.splat()),
            Self::MooneyRivlin(law) => AnyShape::MooneyRivlin(law.splat()),
            Self::Yeoh(law) => AnyShape::Yeoh(law.splat()),
            Self::VerondaWestmann(law) => AnyShape::VerondaWestmann(law.splat()),
            Self::Ogden(law) => AnyShape::Ogden(law.splat()),
        }
    }

    // of one law: where another stands among them, it counts as the first
    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> AnyShape<V> {
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
        }
    }
}

/// [`AnyShape`] whose numbers are taken into registers where the law is known.
#[derive(Clone, Copy)]
pub(super) struct Splat<'a, T>(pub &'a AnyShape<T>);

impl<T: Real, V: Vector<T>> Shape<V> for Splat<'_, T> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<V>, cof: &Gradient<V>, j: V) -> Distortion<V> {
        match self.0 {
            AnyShape::NeoHookean(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::MooneyRivlin(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::Yeoh(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::VerondaWestmann(law) => shape::distortion::<V, _, AXISYMMETRIC>(&law.splat::<V>(), f, cof, j),
            AnyShape::Ogden(law) => shape::distortion::<V, _, AXISYMMETRIC>(&OfTerms(SplatTerms(law)), f, cof, j),
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

/// A law in the lanes, of points that relax if there is a memory.
pub(super) struct InLanes<'a, T, const RELAXES: bool> {
    pub shape: AnyShape<T>,
    pub volume: Volume<T>,
    pub memory: &'a Memory,
}

impl<T: Real, const RELAXES: bool> InLanes<'_, T, RELAXES> {
    #[inline(always)]
    fn law<V: Vector<T>>(&self) -> WithVolume<Splat<'_, T>, V> {
        WithVolume { shape: Splat(&self.shape), volume: self.volume.splat() }
    }
}

impl<T: Real, const RELAXES: bool> PointLaw<T> for InLanes<'_, T, RELAXES> {
    #[inline(always)]
    fn at<V: Vector<T>, const AXISYMMETRIC: bool>(
        &self,
        group: usize,
        f: &Gradient<V>,
        projected: Projected<V>,
    ) -> (V, Gradient<V>) {
        if RELAXES {
            let h = self.memory.held_by::<T, V, AXISYMMETRIC>(group);
            self.law().relaxing::<AXISYMMETRIC>(f, projected, V::of(self.memory.elastic), &h)
        } else {
            self.law().at::<AXISYMMETRIC>(f, projected)
        }
    }

    #[inline(always)]
    fn stiffness<V: Vector<T>>(&self, f: &Gradient<V>, projected: Projected<V>) -> V {
        self.law().stiffness(f, projected)
    }
}

/// Any law, with memory if it relaxes, in double precision.
pub(super) struct Relaxing<'a> {
    pub constants: &'a Constants,
    pub memory: &'a Memory,
}

impl<T: Real> PointLaw<T> for Relaxing<'_> {
    #[inline]
    fn at<V: Vector<T>, const AXISYMMETRIC: bool>(
        &self,
        group: usize,
        f: &Gradient<V>,
        projected: Projected<V>,
    ) -> (V, Gradient<V>) {
        let (f, pressure) = (f.map(V::store), projected.pressure.store());
        let (mut density, mut stress) = (Lanes::default(), [Lanes::default(); 9]);
        for lane in 0..LANES {
            let given = Projected { pressure: pressure.0[lane].get(), shrinkage: 0.0 };
            let (w, p) = self.evaluate(LANES * group + lane, &f.map(|x| x.0[lane].get()), given);
            density.0[lane] = T::of(w);
            for (out, p) in stress.iter_mut().zip(p) {
                out.0[lane] = T::of(p);
            }
        }
        (V::load(&density), stress.map(|p| V::load(&p)))
    }

    #[inline]
    fn stiffness<V: Vector<T>>(&self, f: &Gradient<V>, projected: Projected<V>) -> V {
        let (f, pressure) = (f.map(V::store), projected.pressure.store());
        let mut stiffness = Lanes::default();
        for lane in 0..LANES {
            let f = f.map(|x| x.0[lane].get());
            stiffness.0[lane] = T::of(self.constants.stiffness(&f, pressure.0[lane].get()));
        }
        V::load(&stiffness)
    }
}

impl Relaxing<'_> {
    /// Energy density and stress of the point in one slot of the block.
    pub(super) fn evaluate(&self, slot: usize, f: &Gradient<f64>, projected: Projected<f64>) -> (f64, Gradient<f64>) {
        let Constants { law, pointwise, resists_collapse, .. } = self.constants;
        let cof = cofactor(f);
        let j = determinant(f, &cof);
        let (own, pressure) = if *resists_collapse {
            collapse(j, *pointwise)
        } else {
            (pointwise * law.volumetric.energy(j - 1.0), pointwise * law.volumetric.slope(j - 1.0))
        };
        let (energy, stress) = match self.memory.held_in(slot) {
            Some(held) => law.relaxing(f, &cof, j, self.memory.elastic, &held),
            None => law.distortion(f, &cof, j),
        };
        let stress = if self.constants.mixed {
            mixed::stress::<f64, false>(f, &cof, law.shear_modulus(), projected, pressure)
        } else {
            std::array::from_fn(|i| stress[i] + (projected.pressure + pressure) * cof[i])
        };
        (energy + own, stress)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
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
        let shapes = [Distortional::NeoHookean { shear_modulus: 1678.0 }, ogden, mooney, yeoh, veronda];
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
    fn every_shape() -> [Distortional; 8] {
        let ogden = |moduli: &[f64], exponents: &[f64]| Distortional::Ogden(Ogden::new(moduli, exponents).unwrap());
        [
            Distortional::NeoHookean { shear_modulus: 1678.0 },
            Distortional::MooneyRivlin(MooneyRivlin { c10: 539.0, c01: 300.0 }),
            Distortional::Yeoh(Yeoh { c10: 839.0, c20: -60.0, c30: 20.0 }),
            Distortional::VerondaWestmann(VerondaWestmann { shear_modulus: 1678.0, exponent: 0.8 }),
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
        let cof = crate::material::neo_hookean::cofactor_in::<_, AXISYMMETRIC>(f);
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
            for n in (0..9).filter(|&n| crate::material::neo_hookean::is_there::<AXISYMMETRIC>(n)) {
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
