//! A law of the caller's own, its type erased: one call for eight points side by side, and the loop round it is that of the built-in laws.

use std::any::{Any, TypeId};
use std::fmt::Debug;
use std::marker::PhantomData;

use super::invariants::{Distortion, IsochoricLaw};
use super::neo_hookean::Gradient;
use super::shape::{Shape, Wave, With};
use crate::number::{Lanes, Pass, Real, Vector, load_all, run_pass};

/// Most constants of an own law.
pub const MOST_CONSTANTS: usize = 8;

/// An [`IsochoricLaw`] of any type with its constants; for [`Distortional::Own`](super::Distortional::Own).
#[derive(Clone, Copy, Debug)]
pub struct Own {
    constants: [f64; MOST_CONSTANTS],
    /// Initial shear modulus, Pa.
    pub(super) shear_modulus: f64,
    single: &'static dyn Erased<f32>,
    double: &'static dyn Erased<f64>,
}

/// A law of eight points, each with its own constants, whose numbers are kept in T.
pub(crate) trait Erased<T: Real>: Debug + Send + Sync {
    /// What tells laws apart.
    fn law(&self) -> TypeId;
    /// [`Shape::distortion`] in space or in a half plane, or the [`Shape::stiffness`] as its energy.
    fn eight(
        &self,
        constants: &[Lanes<T>; MOST_CONSTANTS],
        wave: &Wave<'_, Lanes<T>>,
        asked: Asked,
    ) -> Distortion<Lanes<T>>;
}

/// What is asked of a law.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Asked {
    Space,
    HalfPlane,
    Stiffness,
}

/// A law's functions without its constants.
#[derive(Debug)]
struct Functions<L, const C: usize>(PhantomData<L>);

impl PartialEq for Own {
    fn eq(&self, other: &Self) -> bool {
        self.constants == other.constants && self.is_like(other)
    }
}

impl Own {
    /// A law in isochoric invariants.
    #[must_use]
    pub fn new<L: IsochoricLaw<C>, const C: usize>(law: &L) -> Self {
        const { assert!(C <= MOST_CONSTANTS, "an own law has at most MOST_CONSTANTS constants") };
        let functions: &'static Functions<L, C> = const { &Functions(PhantomData) };
        let mut constants = [0.0; MOST_CONSTANTS];
        constants[..C].copy_from_slice(&law.constants());
        Self { constants, shear_modulus: law.shear_modulus(), single: functions, double: functions }
    }

    /// Whether it is one law, whatever its constants.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.double.law() == other.double.law()
    }

    /// [`Shape::distortion`] of one point.
    pub(super) fn distortion(&self, f: &Gradient<f64>, cof: &Gradient<f64>, j: f64) -> Distortion<f64> {
        let zero = 0.0;
        self.one(&Wave { f, cof, j, lack: zero, largest: zero, c2: zero, bulk: zero }, Asked::Space)
    }

    /// [`Shape::stiffness`] of one point.
    pub(crate) fn stiffness(&self, wave: &Wave<'_, f64>) -> f64 {
        self.one(wave, Asked::Stiffness).energy
    }

    fn one(&self, wave: &Wave<'_, f64>, asked: Asked) -> Distortion<f64> {
        let (f, cof) = (&wave.f.map(Lanes::splat), &wave.cof.map(Lanes::splat));
        let [j, lack, largest, c2, bulk] = [wave.j, wave.lack, wave.largest, wave.c2, wave.bulk].map(Lanes::splat);
        let constants = self.constants.map(Lanes::splat);
        let found = self.double.eight(&constants, &Wave { f, cof, j, lack, largest, c2, bulk }, asked);
        let [energy, across] = [found.energy, found.across].map(|x| x.0[0]);
        Distortion { energy, stress: found.stress.map(|x| x.0[0]), across }
    }

    /// The law of points whose numbers are of this type.
    pub(crate) fn wide<T: Real>(&self) -> Wide<T, T> {
        let of_type: [&dyn Any; 2] = [&self.single, &self.double];
        let found = of_type.into_iter().find_map(|law| law.downcast_ref::<&'static dyn Erased<T>>());
        // there are two kinds of real numbers
        #[expect(clippy::expect_used, reason = "the trait Real has two implementations")]
        Wide { constants: self.constants.map(T::of), law: *found.expect("f32 or f64") }
    }
}

/// An own law in lanes whose memory is of `T`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wide<T: Real, V> {
    pub constants: [V; MOST_CONSTANTS],
    pub law: &'static dyn Erased<T>,
}

/// Numbers in memory.
#[inline(always)]
fn stored<T: Real, V: Vector<T>, const K: usize>(from: &[V; K]) -> [Lanes<T>; K] {
    let mut out = [Lanes::default(); K];
    for k in 0..K {
        out[k] = from[k].store();
    }
    out
}

impl<T: Real, V: Vector<T>> Shape<V> for Wide<T, V> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<V>, cof: &Gradient<V>, j: V) -> Distortion<V> {
        let (zero, asked) = (Lanes::default(), if AXISYMMETRIC { Asked::HalfPlane } else { Asked::Space });
        let (f, cof, j) = (&stored(f), &stored(cof), j.store());
        let wave = Wave { f, cof, j, lack: zero, largest: zero, c2: zero, bulk: zero };
        let found = self.law.eight(&stored(&self.constants), &wave, asked);
        Distortion { energy: V::load(&found.energy), stress: load_all(&found.stress), across: V::load(&found.across) }
    }

    #[inline(always)]
    fn stiffness(&self, wave: &Wave<'_, V>) -> V {
        let Wave { f, cof, j, lack, largest, c2, bulk } = *wave;
        let (f, cof) = (&stored(f), &stored(cof));
        let [j, lack, largest, c2, bulk] = stored(&[j, lack, largest, c2, bulk]);
        let wave = Wave { f, cof, j, lack, largest, c2, bulk };
        V::load(&self.law.eight(&stored(&self.constants), &wave, Asked::Stiffness).energy)
    }
}

impl<T: Real, L: IsochoricLaw<C>, const C: usize> Erased<T> for Functions<L, C> {
    fn law(&self) -> TypeId {
        TypeId::of::<L>()
    }

    fn eight(
        &self,
        constants: &[Lanes<T>; MOST_CONSTANTS],
        wave: &Wave<'_, Lanes<T>>,
        asked: Asked,
    ) -> Distortion<Lanes<T>> {
        let zero = Lanes::default();
        let mut out = Distortion { energy: zero, stress: [zero; 9], across: zero };
        run_pass(Eight { constants, wave, asked, law: PhantomData::<L>, out: &mut out });
        out
    }
}

struct Eight<'a, T, L, const C: usize> {
    constants: &'a [Lanes<T>; MOST_CONSTANTS],
    wave: &'a Wave<'a, Lanes<T>>,
    asked: Asked,
    law: PhantomData<L>,
    out: &'a mut Distortion<Lanes<T>>,
}

impl<T: Real, L: IsochoricLaw<C>, const C: usize> Pass<T> for Eight<'_, T, L, C> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Wave { f, cof, j, lack, largest, c2, bulk } = *self.wave;
        let (f, cof): (Gradient<V>, Gradient<V>) = (load_all(f), load_all(cof));
        let [j, lack, largest, c2, bulk] = load_all(&[j, lack, largest, c2, bulk]);
        let mut constants = [V::default(); C];
        for k in 0..C {
            constants[k] = V::load(&self.constants[k]);
        }
        let law = With::<L, V, C>::new(constants);
        let found = match self.asked {
            Asked::Space => law.distortion::<false>(&f, &cof, j),
            Asked::HalfPlane => law.distortion::<true>(&f, &cof, j),
            Asked::Stiffness => {
                let energy = law.stiffness(&Wave { f: &f, cof: &cof, j, lack, largest, c2, bulk });
                *self.out = Distortion { energy: energy.store(), ..*self.out };
                return;
            }
        };
        *self.out =
            Distortion { energy: found.energy.store(), stress: stored(&found.stress), across: found.across.store() };
    }
}
