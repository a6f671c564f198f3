//! The two passes of the [internal force](super::super::kernel) over the points of a block, for eight members at once: a point's
//! gradients and indices are read once, and the members stand in the lanes. What is added up, and in which order, is as in
//! [`super::super::passes`], but for the order of the points in the forces.

use crate::material::neo_hookean::{Gradient, cofactor, determinant};

use super::super::points::{NeoHookean, PointLaw};
use super::table::PointTable;
use crate::number::lanes::{LANES, Lanes, Loop};
use crate::number::{Number, Real};

/// Bytes of a line of the cache, and how far ahead gradients are asked for.
#[cfg(all(target_arch = "x86_64", not(miri)))]
const LINE: usize = 64;
#[cfg(all(target_arch = "x86_64", not(miri)))]
const AHEAD: usize = 2048;

/// A number of each member at each of a vector's components.
pub type Vectors<T> = [Lanes<T>; 3];

/// The laws of eight members in one region.
#[derive(Clone, Copy, Debug)]
pub struct Laws<T>(pub [NeoHookean<T>; LANES]);

impl<T: Real> PointLaw<T> for Laws<T> {
    #[inline(always)]
    fn at(&self, _: usize, f: &Gradient<Lanes<T>>, projected: Lanes<T>) -> (Lanes<T>, Gradient<Lanes<T>>) {
        let (mut density, mut stress) = (Lanes::default(), [Lanes::default(); 9]);
        for lane in 0..LANES {
            let (w, p) = self.0[lane].lane(&std::array::from_fn(|i| f[i].0[lane]), projected.0[lane]);
            density.0[lane] = w;
            for i in 0..9 {
                stress[i].0[lane] = p[i];
            }
        }
        (density, stress)
    }

    #[inline(always)]
    fn stiffness(&self, f: &Gradient<Lanes<T>>, _: Lanes<T>) -> Lanes<T> {
        let mut stiffness = Lanes::default();
        for lane in 0..LANES {
            stiffness.0[lane] = self.0[lane].stiffness_of_lane(&std::array::from_fn(|i| f[i].0[lane]));
        }
        stiffness
    }
}

/// Mean over the corners of a point's cell, Pa.
#[inline(always)]
fn projected_pressure<T: Real, const AXISYMMETRIC: bool>(pressure: &[Lanes<T>], corners: &[u16; 4]) -> Lanes<T> {
    let [a, b, c, d] = corners.map(usize::from);
    let two = pressure[a] + pressure[b];
    if AXISYMMETRIC {
        Lanes::of(1.0 / 3.0) * (two + pressure[c])
    } else {
        Lanes::of(0.25) * (two + (pressure[c] + pressure[d]))
    }
}

/// The loop over points of pass 1.
pub struct Deform<'a, T: Real, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub active: &'a [Lanes<T>],
    pub u: &'a [Vectors<T>],
    pub deformation: &'a mut [Gradient<Lanes<T>>],
    /// At each vertex of the block, m^3.
    pub dilation: &'a mut [Lanes<T>],
    /// Smallest volume ratio so far.
    pub min: &'a mut Lanes<T>,
}

impl<T: Real, const AXISYMMETRIC: bool> Loop for Deform<'_, T, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { table, active, u, deformation, dilation, min } = self;
        let (one, zero) = (Lanes::of(1.0), Lanes::default());
        let share_of_corner = Lanes::of(if AXISYMMETRIC { 1.0 / 3.0 } else { 0.25 });
        let mut least = *min;
        for point in 0..table.len() {
            let visits = table.visits(point);
            if !AXISYMMETRIC {
                prefetch(&table.gradient[visits.clone()]);
            }
            let mut f = gather::<T, AXISYMMETRIC>(&table.local[visits.clone()], &table.gradient[visits], u);
            let (active, scale) = (active[point], Lanes::splat(table.scale[point]));
            for k in 0..9 {
                let undeformed = if k % 4 == 0 { one } else { zero };
                f[k] = f[k].fma(scale, undeformed);
                if AXISYMMETRIC {
                    f[k] = f[k].where_positive(active, undeformed);
                }
            }
            deformation[point] = f;
            let j = determinant(&f, &cofactor(&f));
            least = j.where_positive(active, least).min(least);
            let share = share_of_corner * active * Lanes::splat(table.volume[point]) * (j - one);
            for corner in &table.corners[point][..if AXISYMMETRIC { 3 } else { 4 }] {
                dilation[usize::from(*corner)] += share;
            }
        }
        *min = least;
    }
}

/// The loop over points of pass 2.
pub struct Stress<'a, T: Real, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub laws: &'a Laws<T>,
    pub active: &'a [Lanes<T>],
    pub deformation: &'a [Gradient<Lanes<T>>],
    /// At each vertex of the block, Pa.
    pub pressure: &'a [Lanes<T>],
    /// On each node of the block, N.
    pub force: &'a mut [Vectors<T>],
    /// Of the block, J.
    pub energy: &'a mut Lanes<T>,
}

impl<T: Real, const AXISYMMETRIC: bool> Loop for Stress<'_, T, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { table, laws, active, deformation, pressure, force, energy } = self;
        let zero = Lanes::default();
        // a copy of the loop's own, which nothing that it writes can change
        let laws = *laws;
        let mut sum = zero;
        for point in 0..table.len() {
            let volume = active[point] * Lanes::splat(table.volume[point]);
            if volume == zero {
                continue;
            }
            let pressure = projected_pressure::<T, AXISYMMETRIC>(pressure, &table.corners[point]);
            let f = &deformation[point];
            let (density, stress) =
                if AXISYMMETRIC { laws.at(point, &planar(f), pressure) } else { laws.at(point, f, pressure) };
            // what is no tissue to one member must not spoil it
            let here = volume * volume;
            sum += (volume * density).where_positive(here, zero);
            let factor = volume * Lanes::splat(table.scale[point]);
            let mut spread = [zero; 9];
            for (spread, stress) in spread.iter_mut().zip(stress) {
                *spread = (factor * stress).where_positive(here, zero);
            }
            let visits = table.visits(point);
            if !AXISYMMETRIC {
                prefetch(&table.gradient[visits.clone()]);
            }
            scatter::<T, AXISYMMETRIC>(&table.local[visits.clone()], &table.gradient[visits], &spread, force);
        }
        *energy = sum;
    }
}

/// The loop over points of the bounds (see [`super::super::mass`]).
pub struct Bound<'a, T: Real, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub laws: &'a Laws<T>,
    pub deformation: &'a [Gradient<Lanes<T>>],
    pub pressure: &'a [Lanes<T>],
    /// Share of the masses over s, in the first component.
    pub force: &'a mut [Vectors<T>],
}

impl<T: Real, const AXISYMMETRIC: bool> Loop for Bound<'_, T, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { table, laws, deformation, pressure, force } = self;
        for point in 0..table.len() {
            let volume = Lanes::splat(table.volume[point].max(-table.volume[point]));
            let pressure = projected_pressure::<T, AXISYMMETRIC>(pressure, &table.corners[point]);
            let stiffness = laws.stiffness(&deformation[point], pressure);
            let share = volume * Lanes::splat(table.squares[point]) * stiffness;
            for &l in &table.local[table.visits(point)] {
                force[usize::from(l)][0] += share;
            }
        }
    }
}

/// A deformation gradient with zeros that the compiler sees where a half plane has them.
#[inline(always)]
fn planar<T: Real>(f: &Gradient<Lanes<T>>) -> Gradient<Lanes<T>> {
    let mut out = [Lanes::default(); 9];
    for k in [0, 2, 4, 6, 8] {
        out[k] = f[k];
    }
    out
}

/// sum_j u_j (x) grad phi_j, over the scale of the gradients, as in [`super::super::passes`].
#[inline(always)]
fn gather<T: Real, const AXISYMMETRIC: bool>(
    local: &[u16],
    gradient: &[[T; 3]],
    u: &[Vectors<T>],
) -> Gradient<Lanes<T>> {
    let mut f = [Lanes::default(); 9];
    for (l, g) in local.iter().zip(gradient) {
        let g = g.map(Lanes::splat);
        let u = &u[usize::from(*l)];
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

/// f_j += V P grad phi_j, with V P times the scale of the gradients row-major.
#[inline(always)]
fn scatter<T: Real, const AXISYMMETRIC: bool>(
    local: &[u16],
    gradient: &[[T; 3]],
    p: &Gradient<Lanes<T>>,
    force: &mut [Vectors<T>],
) {
    for (l, g) in local.iter().zip(gradient) {
        let g = g.map(Lanes::splat);
        let force = &mut force[usize::from(*l)];
        if AXISYMMETRIC {
            force[0] = p[0].fma(g[0], p[4].fma(g[1], p[2].fma(g[2], force[0])));
            force[2] = p[6].fma(g[0], p[8].fma(g[2], force[2]));
        } else {
            for i in 0..3 {
                force[i] = p[3 * i].fma(g[0], p[3 * i + 1].fma(g[1], p[3 * i + 2].fma(g[2], force[i])));
            }
        }
    }
}

/// Asks for the gradients of a later point, as [`super::super::passes`] does for those of a later visit; those of a half plane stay in the
/// second cache.
#[inline(always)]
#[allow(unsafe_code)] // an instruction of the processor
fn prefetch<T>(gradient: &[[T; 3]]) {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let bytes = size_of_val(gradient);
        let first = gradient.as_ptr().cast::<i8>();
        for line in (0..bytes).step_by(LINE) {
            // SAFETY: a hint; the address need not be valid.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.wrapping_add(AHEAD + line)) };
        }
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = gradient;
}
