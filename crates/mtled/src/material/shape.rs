//! The change of shape as a loop over points sees it: one law, in numbers of any kind.

use std::marker::PhantomData;

use super::invariants::{self, Distortion, IsochoricLaw, Slopes};
use super::neo_hookean::{Gradient, excess};
use crate::number::Number;

/// What the bound of a law takes of a deformation gradient.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wave<'a, N> {
    pub f: &'a Gradient<N>,
    pub cof: &'a Gradient<N>,
    /// J, J_m or more.
    pub j: N,
    /// By how much J falls short of J_m.
    pub lack: N,
    /// About the squares of the largest singular values of F and cof F.
    pub largest: N,
    pub c2: N,
    /// Second derivative of the energy of volume, Pa.
    pub bulk: N,
}

/// A law of the change of shape.
pub(crate) trait Shape<N: Number>: Copy {
    /// Of what [`is_there`].
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, cof: &Gradient<N>, j: N) -> Distortion<N>;
    /// Bound on the stiffness of a plane wave, Pa: [`crate::solver`]'s masses.
    fn stiffness(&self, wave: &Wave<'_, N>) -> N;
}

/// [`Shape::distortion`]; of arrays in a function of its own, which all loops over points share: inlined into each of them, it is most of
/// the time that the crate takes to compile.
#[inline(always)]
pub(crate) fn distortion<N: Number, S: Shape<N>, const AXISYMMETRIC: bool>(
    shape: &S,
    f: &Gradient<N>,
    cof: &Gradient<N>,
    j: N,
) -> Distortion<N> {
    if N::IS_ARRAY {
        distortion_apart::<N, S, AXISYMMETRIC>(shape, f, cof, j)
    } else {
        shape.distortion::<AXISYMMETRIC>(f, cof, j)
    }
}

#[inline(never)]
fn distortion_apart<N: Number, S: Shape<N>, const AXISYMMETRIC: bool>(
    shape: &S,
    f: &Gradient<N>,
    cof: &Gradient<N>,
    j: N,
) -> Distortion<N> {
    shape.distortion::<AXISYMMETRIC>(f, cof, j)
}

/// [`Shape::stiffness`], likewise.
#[inline(always)]
pub(crate) fn stiffness<N: Number, S: Shape<N>>(shape: &S, wave: &Wave<'_, N>) -> N {
    if N::IS_ARRAY { stiffness_apart(shape, wave) } else { shape.stiffness(wave) }
}

#[inline(never)]
fn stiffness_apart<N: Number, S: Shape<N>>(shape: &S, wave: &Wave<'_, N>) -> N {
    shape.stiffness(wave)
}

/// A law in isochoric invariants with its constants in numbers of any kind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct With<L, N, const C: usize> {
    pub constants: [N; C],
    law: PhantomData<L>,
}

impl<L: IsochoricLaw<C>, N, const C: usize> With<L, N, C> {
    #[inline(always)]
    pub(crate) fn new(constants: [N; C]) -> Self {
        Self { constants, law: PhantomData }
    }
}

impl<L: IsochoricLaw<C>, N: Number, const C: usize> With<L, N, C> {
    /// The constants of a law.
    pub(crate) fn of(law: &L) -> Self {
        Self::new(law.constants().map(N::of))
    }
}

impl<L: IsochoricLaw<C>, N: Number, const C: usize> Shape<N> for With<L, N, C> {
    #[inline(always)]
    fn distortion<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, cof: &Gradient<N>, j: N) -> Distortion<N> {
        invariants::evaluate::<N, L, C, AXISYMMETRIC>(&self.constants, f, cof, j)
    }

    // below J_m the masses grow in the proportion in which the neo-Hookean law stiffens
    #[inline(always)]
    fn stiffness(&self, wave: &Wave<'_, N>) -> N {
        let Wave { f, cof, j, lack, largest, c2, bulk } = *wave;
        excess(lack) * invariants::stiffness::<N, L, C>(&self.constants, f, cof, j, largest, c2) + bulk * c2
    }
}

/// bulk c^2 + mu (J^-2/3 + 5/9 J^-8/3 I1 c^2), from c^2 and J^-2/3. A bound below J_m as well, where `cube` is phi(J) and
/// the last term, with J_m for J, has no cause any more.
#[inline(always)]
pub(crate) fn plane_wave<T: Number>(f: &Gradient<T>, c2: T, j: T, cube: T, mu: T, bulk: T) -> T {
    let mut i1 = T::default();
    for x in f {
        i1 += *x * *x;
    }
    bulk * c2 + mu * (cube + T::of(5.0 / 9.0) * cube * i1 * c2 / (j * j))
}

impl<N: Number> Wave<'_, N> {
    /// That of the neo-Hookean law, and of one that is as stiff.
    #[inline(always)]
    pub(crate) fn of_modulus(&self, mu: N) -> N {
        let root = self.j.inverse_cube_root();
        plane_wave(self.f, self.c2, self.j, root * root * excess(self.lack), mu, self.bulk)
    }
}

/// [`super::neo_hookean`], where it relaxes or the energy of volume is another.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NeoHookean {
    /// mu, Pa.
    pub mu: f64,
}

impl IsochoricLaw<1> for NeoHookean {
    const SECOND: bool = false;

    fn constants(&self) -> [f64; 1] {
        [self.mu]
    }

    #[inline(always)]
    fn slopes<N: Number>(&[mu]: &[N; 1], a: N, _: N) -> Slopes<N> {
        let slope = N::of(0.5) * mu;
        Slopes { w: slope * (a - N::of(3.0)), a: slope, ..Slopes::default() }
    }
}
