//! What the integration points of a relaxing material remember (see [`crate::material::prony`]).
//!
//! Pseudo time of the explicit steps is numerical, so the memory moves in the poses' own time: [`Memory::begin`] fixes
//! H and gamma for the increment that ends at a pose, any number of steps finds the balance, [`Memory::commit`] takes
//! the deformation that was found into the history.

use crate::material::Prony;
use crate::material::neo_hookean::{Gradient, cofactor, cofactor_in, determinant, determinant_in};
use crate::material::ogden::Symmetric;
use crate::material::prony::{Increment, MOST_TERMS, reference_stress, unimodular};
use crate::material::shape::Shape;
use crate::number::{LANES, Lanes, Loop, Number, Pass, Real, Vector, run, run_pass};

use super::block::{Block, BlockScratch};
use super::cloned::cloned_field_by_field;
use super::collapse::collapse;
use super::points::{
    AnyShape, Constants, PointLaw, Projected, Splat, Volume, WideLaw, WithVolume, load, mixed_stress, with_pressure,
};
use crate::approximation::Form;

/// A symmetric tensor of each point of a group. In double precision: a step of time may change it by less than a single's last digit.
type OfGroup = [Lanes<f64>; 6];

const ZERO: OfGroup = [Lanes([0.0; LANES]); 6];

/// Whether a component of a symmetric tensor may differ from zero: with symmetry of revolution none that shears the hoop direction does.
const fn is_kept<const AXISYMMETRIC: bool>(k: usize) -> bool {
    !AXISYMMETRIC || k < 3 || k == 5
}

cloned_field_by_field! {
    /// Memory of one block; empty for a material that does not relax.
    #[derive(Debug, Default)]
    pub(super) struct Memory {
        /// H of each group, Pa.
        held: Vec<OfGroup>,
        /// gamma.
        pub elastic: f64,
        /// What makes the block's energy go on without a jump where H and gamma change, J: with it, the energy is the
        /// work done on the points, stored or lost.
        pub offset: f64,
        /// Pi, then h_i, of each group at the last commit, Pa.
        stress: Vec<OfGroup>,
        pub sums: Sums,
        /// Whether it is of a half plane.
        axisymmetric: bool,
    }
}

/// Integrals over the block at the last commit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// V W, and V J^-2/3 h_i : C / 2, J.
    elastic: f64,
    held: [f64; MOST_TERMS],
    /// Work done on the points so far, less the volumetric part, J.
    work: f64,
    /// V |g_inf Pi + sum h_i|^2 and V |h_i|^2, Pa^2 m^3.
    pub total: f64,
    pub terms: [f64; MOST_TERMS],
}

impl Memory {
    /// One group within an increment, all its points alike.
    #[cfg(test)]
    pub(crate) fn holding(held: Symmetric, elastic: f64) -> Self {
        Self { held: vec![held.map(Lanes::splat)], elastic, ..Self::default() }
    }

    /// Memory of so many groups; none for an elastic material.
    pub(super) fn new(prony: &Prony, groups: usize, form: Form) -> Self {
        if prony.is_empty() {
            return Self::default();
        }
        Self {
            held: vec![ZERO; groups],
            elastic: 1.0,
            stress: vec![ZERO; (1 + prony.len()) * groups],
            axisymmetric: matches!(form, Form::Axisymmetric),
            ..Self::default()
        }
    }

    /// Whether the material does not relax.
    pub(super) fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// H of the point in one slot; `None` for an elastic material.
    pub(super) fn held_in(&self, slot: usize) -> Option<Symmetric> {
        self.held.get(slot / LANES).map(|held| held.map(|h| h.0[slot % LANES]))
    }

    /// H of a group's points.
    #[inline(always)]
    pub(super) fn held_by<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(&self, group: usize) -> [V; 6] {
        let mut held = [V::default(); 6];
        for k in 0..6 {
            if is_kept::<AXISYMMETRIC>(k) {
                held[k] = V::load(&Lanes::narrow(self.held[group][k]));
            }
        }
        held
    }

    /// Fixes H and gamma for an increment of `dt` seconds from the last commit.
    pub(super) fn begin(&mut self, series: &Prony, dt: f64) {
        if self.is_empty() {
            return;
        }
        let increment = series.increment(dt);
        let (terms, held, stress) = (series.len(), &mut self.held, &self.stress);
        if self.axisymmetric {
            run(Begin::<true> { terms, increment: &increment, held, stress });
        } else {
            run(Begin::<false> { terms, increment: &increment, held, stress });
        }
        self.elastic = increment.elastic;
        // Pi : C = 0 at the deformation of the commit, so the old Pi adds nothing here
        let held: f64 = (0..series.len()).map(|i| increment.decay[i] * self.sums.held[i]).sum();
        self.offset = self.sums.work - increment.elastic * self.sums.elastic - held;
    }

    /// Takes the deformation of the block's last evaluation into the history, `dt` seconds after the commit before.
    pub(super) fn commit<T: Real>(
        &mut self,
        block: &Block<T>,
        active: &[Lanes<T>],
        scratch: &BlockScratch<T>,
        constants: &Constants,
        dt: f64,
    ) {
        if self.is_empty() {
            return;
        }
        let series = &constants.law.prony;
        let (terms, long_term, increment) = (series.len(), series.long_term_share(), series.increment(dt));
        let (planar, memory) = (self.axisymmetric, self);
        let (shape, increment) = (constants.shape(), &increment);
        if planar {
            run_pass(Commit::<_, true> { shape, block, active, scratch, terms, long_term, increment, memory });
        } else {
            run_pass(Commit::<_, false> { shape, block, active, scratch, terms, long_term, increment, memory });
        }
    }
}

/// The loop of [`Memory::begin`].
struct Begin<'a, const AXISYMMETRIC: bool> {
    terms: usize,
    increment: &'a Increment,
    held: &'a mut [OfGroup],
    stress: &'a [OfGroup],
}

impl<const AXISYMMETRIC: bool> Loop for Begin<'_, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { terms, increment, held, stress } = self;
        for (held, history) in held.iter_mut().zip(stress.chunks_exact(1 + terms)) {
            for k in 0..6 {
                if is_kept::<AXISYMMETRIC>(k) {
                    let mut sum = Lanes::default();
                    for i in 0..terms {
                        let (decay, ramp) = (Lanes::splat(increment.decay[i]), Lanes::splat(increment.ramp[i]));
                        sum += decay * history[1 + i][k] - ramp * history[0][k];
                    }
                    held[k] = sum;
                }
            }
        }
    }
}

/// The loop of [`Memory::commit`].
struct Commit<'a, T: Real, const AXISYMMETRIC: bool> {
    shape: AnyShape<T>,
    block: &'a Block<T>,
    active: &'a [Lanes<T>],
    scratch: &'a BlockScratch<T>,
    terms: usize,
    long_term: f64,
    increment: &'a Increment,
    memory: &'a mut Memory,
}

impl<T: Real, const AXISYMMETRIC: bool> Pass<T> for Commit<'_, T, AXISYMMETRIC> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { shape, block, active, scratch, terms, long_term, increment, memory } = self;
        let (zero, half) = (V::default(), V::of(0.5));
        let (long_term, gamma) = (V::of(long_term), V::of(memory.elastic));
        let (mut elastic, mut work, mut totals) = (zero, zero, zero);
        let (mut held, mut squares) = ([zero; MOST_TERMS], [zero; MOST_TERMS]);
        for group in 0..memory.held.len() {
            let f = load::<T, V, AXISYMMETRIC>(&scratch.deformation[group]);
            let cof = cofactor_in::<V, AXISYMMETRIC>(&f);
            let j = determinant_in::<V, AXISYMMETRIC>(&f, &cof);
            let now = Splat(&shape).distortion::<AXISYMMETRIC>(&f, &cof, j);
            let stress = with_pressure::<V, AXISYMMETRIC>(now.stress, &cof, now.across);
            let new = reference_stress::<V, AXISYMMETRIC>(&cof, j, &stress);
            let c = unimodular::<V, AXISYMMETRIC>(&f, j);
            let volume = V::load(&active[group]) * V::load(&block.volume[group]);
            // what is no tissue must not spoil the sums
            let here = volume * volume;
            let last = memory.held_by::<T, V, AXISYMMETRIC>(group);
            let history = &mut memory.stress[(1 + terms) * group..][..1 + terms];
            let (mut total, mut change) = (new, ZERO);
            for k in 0..6 {
                if is_kept::<AXISYMMETRIC>(k) {
                    total[k] = long_term * new[k];
                    let new = new[k].store().wide();
                    change[k] = new - history[0][k];
                    history[0][k] = new;
                }
            }
            for i in 0..terms {
                let (decay, ramp) = (Lanes::splat(increment.decay[i]), Lanes::splat(increment.ramp[i]));
                let mut h = [zero; 6];
                for k in 0..6 {
                    if is_kept::<AXISYMMETRIC>(k) {
                        let now = decay * history[1 + i][k] + ramp * change[k];
                        history[1 + i][k] = now;
                        h[k] = V::load(&Lanes::narrow(now));
                        total[k] += h[k];
                    }
                }
                held[i] += (volume * contract::<V, AXISYMMETRIC>(&h, &c)).where_positive(here, zero);
                squares[i] += (volume * contract::<V, AXISYMMETRIC>(&h, &h)).where_positive(here, zero);
            }
            elastic += (volume * now.energy).where_positive(here, zero);
            totals += (volume * contract::<V, AXISYMMETRIC>(&total, &total)).where_positive(here, zero);
            let done = gamma.product_sum(now.energy, half * contract::<V, AXISYMMETRIC>(&last, &c));
            work += (volume * done).where_positive(here, zero);
        }
        let mut sums = Sums {
            elastic: elastic.store().sum().get(),
            work: memory.offset + work.store().sum().get(),
            total: totals.store().sum().get(),
            ..Sums::default()
        };
        for i in 0..terms {
            sums.held[i] = 0.5 * held[i].store().sum().get();
            sums.terms[i] = squares[i].store().sum().get();
        }
        memory.sums = sums;
    }
}

/// X : Y.
#[inline(always)]
fn contract<N: Number, const AXISYMMETRIC: bool>(x: &[N; 6], y: &[N; 6]) -> N {
    let along = x[0].product_sum(y[0], x[1].product_sum(y[1], x[2] * y[2]));
    let mut off = x[5] * y[5];
    if !AXISYMMETRIC {
        off = x[3].product_sum(y[3], x[4].product_sum(y[4], off));
    }
    along + off + off
}

/// A law in the lanes, of points that relax if there is a memory.
pub(super) struct InLanes<'a, T: Real, const RELAXES: bool> {
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
            mixed_stress::<f64, false>(f, &cof, law.shear_modulus(), projected, pressure)
        } else {
            std::array::from_fn(|i| stress[i] + (projected.pressure + pressure) * cof[i])
        };
        (energy + own, stress)
    }
}
