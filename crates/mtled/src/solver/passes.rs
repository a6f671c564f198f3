//! The two passes of the [internal force](super::kernel) over the points of a block.

use crate::approximation::Form;
use crate::material::neo_hookean::{Gradient, cofactor_in, determinant_in, is_there};

use super::block::{Block, BlockScratch, ForceOfLane};
use super::memory::{InLanes, Memory, Relaxing};
use super::points::{Constants, PointLaw, Projected, load};
use super::strip::FIELDS;
use crate::number::{LANES, Lanes, Number, Pass, Real, Vector, load_all, run_pass};

/// How far ahead gradients are asked for: 2 kB in single precision.
#[cfg(all(target_arch = "x86_64", not(miri)))]
const VISITS_AHEAD: usize = 40;

impl<T: Real> Block<T> {
    /// Pass 1. `active`: share of each point that is tissue; `strained`: sum over the block's points of V (J - 1) over the
    /// number of corners, at each vertex, m^3, and the same of V (I1 - 3) where the law is [mixed](super::mixed).
    pub(super) fn deform(
        &self,
        active: &[Lanes<T>],
        u: &[[f64; 3]],
        mixed: bool,
        scratch: &mut BlockScratch<T>,
        strained: &mut [[T; FIELDS]],
    ) {
        // Relative to one of the block's own nodes: gradients of a constant vanish, and a rigid translation of the
        // whole sample costs no digits in single precision.
        let origin = u[self.nodes[0] as usize];
        strained.fill([T::default(); FIELDS]);
        match self.form {
            Form::Full => {
                for (local, &n) in scratch.u.iter_mut().zip(&self.nodes) {
                    let u = u[n as usize];
                    *local = std::array::from_fn(|k| T::of(u[k] - origin[k]));
                }
                self.gradients::<false>(active, mixed, scratch, strained);
            }
            Form::Mirrored(mirror) => {
                for (l, (local, &n)) in scratch.u.iter_mut().zip(&self.nodes).enumerate() {
                    let u = &u[n as usize];
                    let u = if l < self.originals { *u } else { mirror.image(u) };
                    *local = std::array::from_fn(|k| T::of(u[k] - origin[k]));
                }
                self.gradients::<false>(active, mixed, scratch, strained);
            }
            Form::Axisymmetric => {
                self.copy_meridian(u, origin[2], &mut scratch.u);
                self.gradients::<true>(active, mixed, scratch, strained);
            }
        }
    }

    fn gradients<const AXISYMMETRIC: bool>(
        &self,
        active: &[Lanes<T>],
        mixed: bool,
        scratch: &mut BlockScratch<T>,
        strained: &mut [[T; FIELDS]],
    ) {
        if mixed {
            run_pass(Deform::<_, AXISYMMETRIC, true> { block: self, active, scratch, strained });
        } else {
            run_pass(Deform::<_, AXISYMMETRIC, false> { block: self, active, scratch, strained });
        }
    }

    /// Displacements of nodes and images of a half plane: only a motion along the axis is rigid, so u_r stays absolute.
    fn copy_meridian(&self, u: &[[f64; 3]], origin: f64, local: &mut [[T; 3]]) {
        for (l, (local, &n)) in local.iter_mut().zip(&self.nodes).enumerate() {
            let [radial, _, axial] = u[n as usize];
            let radial = if l < self.originals { radial } else { -radial };
            *local = [T::of(radial), T::default(), T::of(axial - origin)];
        }
    }

    /// Pass 2. `pressure` and `shrinkage` at all nodes, or empty; `force`: internal force of the block's points on each of its nodes, N.
    #[expect(clippy::too_many_arguments, reason = "what the points are, and where their numbers go")]
    pub(super) fn stress(
        &self,
        active: &[Lanes<T>],
        memory: &Memory,
        [pressure, shrinkage]: [&[T]; FIELDS],
        constants: &Constants,
        scratch: &mut BlockScratch<T>,
        lanes: &mut ForceOfLane<T>,
        force: &mut [[T; 3]],
    ) {
        for (k, all) in [pressure, shrinkage].into_iter().enumerate().filter(|(_, all)| !all.is_empty()) {
            scratch.projected.iter_mut().zip(&self.vertices).for_each(|(local, &n)| local[k] = all[n as usize]);
        }
        // each law has a loop of its own, with no choices in it
        if let Some(mixed) = constants.of_mixed() {
            self.spread(&mixed, active, scratch, lanes);
        } else if let Some(plain) = constants.plain() {
            self.spread(&plain, active, scratch, lanes);
        } else if let Some(volume) = constants.volume() {
            let shape = constants.shape();
            if memory.is_empty() {
                self.spread(&InLanes::<_, false> { shape, volume, memory }, active, scratch, lanes);
            } else {
                self.spread(&InLanes::<_, true> { shape, volume, memory }, active, scratch, lanes);
            }
        } else {
            self.spread(&Relaxing { constants, memory }, active, scratch, lanes);
        }
        scratch.energy += memory.offset;
        T::sum_and_clear(lanes, force);
        // what pulls an image pulls its node the mirrored way
        for force in &mut force[self.originals..] {
            match self.form {
                Form::Mirrored(mirror) => *force = mirror.image(&force.map(T::get)).map(T::of),
                Form::Full | Form::Axisymmetric => force[0] = -force[0],
            }
        }
    }

    fn spread(
        &self,
        law: &impl PointLaw<T>,
        active: &[Lanes<T>],
        scratch: &mut BlockScratch<T>,
        lanes: &mut ForceOfLane<T>,
    ) {
        match self.form {
            Form::Full | Form::Mirrored(_) => {
                run_pass(Stress::<_, _, false> { block: self, law, active, scratch, lanes })
            }
            Form::Axisymmetric => run_pass(Stress::<_, _, true> { block: self, law, active, scratch, lanes }),
        }
    }

    /// What a group's points get from the coarse nodes.
    #[inline(always)]
    pub(super) fn projected<V: Vector<T>>(&self, scratch: &BlockScratch<T>, group: usize) -> Projected<V> {
        let corners = &self.corners[group];
        let mut sum = Self::at_corners::<V>(scratch, &corners[0], &corners[1]);
        let share = match self.form {
            Form::Full | Form::Mirrored(_) => {
                let other = Self::at_corners::<V>(scratch, &corners[2], &corners[3]);
                (sum[0], sum[1]) = (sum[0] + other[0], sum[1] + other[1]);
                V::of(0.25)
            }
            Form::Axisymmetric => {
                let last = load_all::<T, V, FIELDS>(&Lanes::look_up(&scratch.projected, &corners[2]));
                (sum[0], sum[1]) = (sum[0] + last[0], sum[1] + last[1]);
                V::of(1.0 / 3.0)
            }
        };
        Projected { pressure: share * sum[0], shrinkage: if scratch.mixed { share * sum[1] } else { V::default() } }
    }

    /// Sum of what stands at two corners.
    #[inline(always)]
    fn at_corners<V: Vector<T>>(scratch: &BlockScratch<T>, a: &[u16; LANES], b: &[u16; LANES]) -> [V; FIELDS] {
        let a = load_all::<T, V, FIELDS>(&Lanes::look_up(&scratch.projected, a));
        let b = load_all::<T, V, FIELDS>(&Lanes::look_up(&scratch.projected, b));
        [a[0] + b[0], a[1] + b[1]]
    }

    /// What the point in one slot gets from the coarse nodes.
    pub(super) fn projected_in(&self, scratch: &BlockScratch<T>, slot: usize) -> Projected<f64> {
        let Projected { pressure, shrinkage } = self.projected::<Lanes<T>>(scratch, slot / LANES);
        Projected { pressure: pressure.0[slot % LANES].get(), shrinkage: shrinkage.0[slot % LANES].get() }
    }
}

/// The loop over points of pass 1.
struct Deform<'a, T: Real, const AXISYMMETRIC: bool, const MIXED: bool> {
    block: &'a Block<T>,
    active: &'a [Lanes<T>],
    scratch: &'a mut BlockScratch<T>,
    strained: &'a mut [[T; FIELDS]],
}

impl<T: Real, const AXISYMMETRIC: bool, const MIXED: bool> Pass<T> for Deform<'_, T, AXISYMMETRIC, MIXED> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { block, active, scratch, strained } = self;
        let (one, zero) = (V::of(1.0), V::default());
        let share_of_corner = V::of(if AXISYMMETRIC { 1.0 / 3.0 } else { 0.25 });
        let mut min = V::of(f64::MAX);
        for group in 0..block.volume.len() {
            let (active, scale) = (V::load(&active[group]), V::load(&block.scale[group]));
            if active.is_zero() {
                // the needle's alone, see below
                let undeformed = std::array::from_fn(|k| if k % 4 == 0 { Lanes::of(1.0) } else { Lanes::default() });
                scratch.deformation[group] = undeformed;
                continue;
            }
            let range = block.start[group] as usize..block.start[group + 1] as usize;
            let mut f = gather::<T, V, AXISYMMETRIC>(&block.local[range.clone()], &block.gradient[range], &scratch.u);
            for k in 0..9 {
                if is_there::<AXISYMMETRIC>(k) {
                    let undeformed = if k % 4 == 0 { one } else { zero };
                    f[k] = f[k].fma(scale, undeformed);
                    // the needle's, not the tissue's: crushed as it may be, it must not make the nodes around it heavy (see `mass`)
                    f[k] = f[k].where_positive(active, undeformed);
                    scratch.deformation[group][k] = f[k].store();
                }
            }
            let j = determinant_in::<V, AXISYMMETRIC>(&f, &cofactor_in::<V, AXISYMMETRIC>(&f));
            // a NaN does not survive this comparison; the energy of pass 2 keeps it
            min = j.where_positive(active, min).min(min);
            let volume = share_of_corner * active * V::load(&block.volume[group]);
            let corners = &block.corners[group][..if AXISYMMETRIC { 3 } else { 4 }];
            let dilation = volume * (j - one);
            let mut square = V::of(-3.0);
            if MIXED {
                for f in &f {
                    square = f.fma(*f, square);
                }
            }
            share_out::<T, MIXED>(strained, corners, [dilation.store(), (volume * square).store()]);
        }
        scratch.min_jacobian = min.store().0.iter().fold(f64::MAX, |min, j| min.min(j.get()));
    }
}

/// Adds a share of each lane to each of its corners; of the first field alone unless `BOTH`.
#[inline(always)]
fn share_out<T: Real, const BOTH: bool>(
    sums: &mut [[T; FIELDS]],
    corners: &[[u16; LANES]],
    shares: [Lanes<T>; FIELDS],
) {
    // point by point, as a team does
    for lane in 0..LANES {
        for corner in corners {
            let sum = &mut sums[usize::from(corner[lane])];
            sum[0] += shares[0].0[lane];
            if BOTH {
                sum[1] += shares[1].0[lane];
            }
        }
    }
}

/// The loop over points of pass 2.
struct Stress<'a, T: Real, L, const AXISYMMETRIC: bool> {
    block: &'a Block<T>,
    law: &'a L,
    active: &'a [Lanes<T>],
    scratch: &'a mut BlockScratch<T>,
    lanes: &'a mut ForceOfLane<T>,
}

impl<T: Real, L: PointLaw<T>, const AXISYMMETRIC: bool> Pass<T> for Stress<'_, T, L, AXISYMMETRIC> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { block, law, active, scratch, lanes } = self;
        let zero = V::default();
        let mut energy = zero;
        for group in 0..block.volume.len() {
            let volume = V::load(&active[group]) * V::load(&block.volume[group]);
            if volume.is_zero() {
                continue;
            }
            let f = load::<T, V, AXISYMMETRIC>(&scratch.deformation[group]);
            let (density, stress) = law.at::<V, AXISYMMETRIC>(group, &f, block.projected(scratch, group));
            // what is no tissue must not spoil its neighbours in the vector
            let here = volume * volume;
            energy += (volume * density).where_positive(here, zero);
            let factor = volume * V::load(&block.scale[group]);
            let spread = scaled::<V, AXISYMMETRIC>(&stress, factor, here);
            let range = block.start[group] as usize..block.start[group + 1] as usize;
            scatter::<T, V, AXISYMMETRIC>(&block.local[range.clone()], &block.gradient[range], &spread, lanes);
        }
        scratch.energy = energy.store().sum().get();
    }
}

/// A stress times a factor where there is tissue; else zero.
#[inline(always)]
pub(super) fn scaled<V: Number, const AXISYMMETRIC: bool>(stress: &Gradient<V>, factor: V, here: V) -> Gradient<V> {
    let mut out = [V::default(); 9];
    for i in 0..9 {
        if is_there::<AXISYMMETRIC>(i) {
            out[i] = (factor * stress[i]).where_positive(here, V::default());
        }
    }
    out
}

/// sum_j u_j (x) grad phi_j, over the scale of the gradients. In a half plane the second component of a gradient belongs to the hoop strain
/// sum_j u_r phi_j / r, and what shears the hoop direction is zero.
#[inline(always)]
fn gather<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(
    local: &[u16],
    gradient: &[[[T::Stored; LANES]; 3]],
    u: &[[T; 3]],
) -> Gradient<V> {
    let mut f = [V::default(); 9];
    for (l, g) in local.iter().zip(gradient) {
        prefetch(g);
        let g = [V::widen(&g[0]), V::widen(&g[1]), V::widen(&g[2])];
        let u = &u[usize::from(*l)];
        let u = [V::splat(u[0]), V::splat(u[1]), V::splat(u[2])];
        if AXISYMMETRIC {
            f[0] = u[0].fma(g[0], f[0]);
            f[2] = u[0].fma(g[2], f[2]);
            f[4] = u[0].fma(g[1], f[4]);
            f[6] = u[2].fma(g[0], f[6]);
            f[8] = u[2].fma(g[2], f[8]);
        } else {
            for i in 0..3 {
                for k in 0..3 {
                    f[3 * i + k] = u[i].fma(g[k], f[3 * i + k]);
                }
            }
        }
    }
    f
}

/// f_j += V P grad phi_j, with V P times the scale of the gradients row-major; the hoop stress pushes its nodes outwards.
#[inline(always)]
fn scatter<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(
    local: &[u16],
    gradient: &[[[T::Stored; LANES]; 3]],
    p: &Gradient<V>,
    force: &mut [[Lanes<T>; 3]],
) {
    for (l, g) in local.iter().zip(gradient) {
        prefetch(g);
        let g = [V::widen(&g[0]), V::widen(&g[1]), V::widen(&g[2])];
        let force = &mut force[usize::from(*l)];
        if AXISYMMETRIC {
            force[0] = p[0].fma(g[0], p[4].fma(g[1], p[2].fma(g[2], V::load(&force[0])))).store();
            force[2] = p[6].fma(g[0], p[8].fma(g[2], V::load(&force[2]))).store();
        } else {
            for i in 0..3 {
                let sum = p[3 * i + 1].fma(g[1], p[3 * i + 2].fma(g[2], V::load(&force[i])));
                force[i] = p[3 * i].fma(g[0], sum).store();
            }
        }
    }
}

/// Asks for the gradients of a later visit: the processor's own prefetching ends at the next page, and waits of a
/// seventh of the step were measured without.
#[inline(always)]
#[allow(unsafe_code)] // an instruction of the processor
fn prefetch<S>(g: &[[S; LANES]; 3]) {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let later = std::ptr::from_ref(g).wrapping_add(VISITS_AHEAD);
        // SAFETY: a hint; the address need not be valid.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(later.cast()) };
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = g;
}
