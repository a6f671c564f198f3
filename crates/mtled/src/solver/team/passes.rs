//! The two passes of the [internal force](super::super::kernel) over the points of a block, for eight members at once: a point's
//! gradients and indices are read once, and the members stand in the lanes. What is added up, and in which order, is as in
//! [`super::super::passes`], but for the order of the points in the forces.

use crate::material::neo_hookean::{Gradient, cofactor, determinant};

use super::super::lane_law::{LaneLaw, by_lane, stiffness_by_lane};
use super::super::points::Projected;
use super::super::strip::FIELDS;
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
pub struct Laws<L>(pub [L; LANES]);

/// What a point gets from the coarse nodes: means over the corners of its cell.
#[inline(always)]
fn projected<T: Real, const AXISYMMETRIC: bool>(
    [pressure, shrinkage]: [&[Lanes<T>]; FIELDS],
    corners: &[u16; 4],
) -> Projected<Lanes<T>> {
    let mean = |x: &[Lanes<T>]| mean_of_corners::<T, AXISYMMETRIC>(x, corners);
    let shrinkage = if shrinkage.is_empty() { Lanes::default() } else { mean(shrinkage) };
    Projected { pressure: mean(pressure), shrinkage }
}

#[inline(always)]
fn mean_of_corners<T: Real, const AXISYMMETRIC: bool>(vertices: &[Lanes<T>], corners: &[u16; 4]) -> Lanes<T> {
    let [a, b, c, d] = corners.map(usize::from);
    let two = vertices[a] + vertices[b];
    if AXISYMMETRIC {
        Lanes::of(1.0 / 3.0) * (two + vertices[c])
    } else {
        Lanes::of(0.25) * (two + (vertices[c] + vertices[d]))
    }
}

/// The loop over points of pass 1.
pub struct Deform<'a, T: Real, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub active: &'a [Lanes<T>],
    pub u: &'a [Vectors<T>],
    pub deformation: &'a mut [Gradient<Lanes<T>>],
    /// At each vertex of the block, m^3: of V (J - 1), and of V (I1 - 3) where the law is [mixed](super::super::mixed), or empty.
    pub sums: [&'a mut [Lanes<T>]; FIELDS],
    /// Smallest volume ratio so far.
    pub min: &'a mut Lanes<T>,
}

impl<T: Real, const AXISYMMETRIC: bool> Loop for Deform<'_, T, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { table, active, u, deformation, sums: [dilation, distortion], min } = self;
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
            let volume = share_of_corner * active * Lanes::splat(table.volume[point]);
            let corners = &table.corners[point][..if AXISYMMETRIC { 3 } else { 4 }];
            let share = volume * (j - one);
            corners.iter().for_each(|corner| dilation[usize::from(*corner)] += share);
            if !distortion.is_empty() {
                let mut square = Lanes::of(-3.0);
                f.iter().for_each(|f| square = f.fma(*f, square));
                let share = volume * square;
                corners.iter().for_each(|corner| distortion[usize::from(*corner)] += share);
            }
        }
        *min = least;
    }
}

/// The loop over points of pass 2.
pub struct Stress<'a, T: Real, L, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub laws: &'a Laws<L>,
    pub active: &'a [Lanes<T>],
    pub deformation: &'a [Gradient<Lanes<T>>],
    /// At each vertex of the block, Pa, and r - 1 or nothing.
    pub coarse: [&'a [Lanes<T>]; FIELDS],
    /// On each node of the block, N.
    pub force: &'a mut [Vectors<T>],
    /// Of the block, J.
    pub energy: &'a mut Lanes<T>,
}

impl<T: Real, L: LaneLaw<T>, const AXISYMMETRIC: bool> Loop for Stress<'_, T, L, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { table, laws, active, deformation, coarse, force, energy } = self;
        let zero = Lanes::default();
        // a copy of the loop's own, which nothing that it writes can change
        let laws = *laws;
        let mut sum = zero;
        for point in 0..table.len() {
            let volume = active[point] * Lanes::splat(table.volume[point]);
            if volume == zero {
                continue;
            }
            let given = projected::<T, AXISYMMETRIC>(coarse, &table.corners[point]);
            let f = &deformation[point];
            let law = |lane: usize| &laws.0[lane];
            let (density, stress) = if AXISYMMETRIC { by_lane(law, &planar(f), given) } else { by_lane(law, f, given) };
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
pub struct Bound<'a, T: Real, L, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub laws: &'a Laws<L>,
    pub deformation: &'a [Gradient<Lanes<T>>],
    /// As those of [`Stress`].
    pub coarse: [&'a [Lanes<T>]; FIELDS],
    /// Share of the masses over s, in the first component.
    pub force: &'a mut [Vectors<T>],
}

impl<T: Real, L: LaneLaw<T>, const AXISYMMETRIC: bool> Loop for Bound<'_, T, L, AXISYMMETRIC> {
    #[inline(always)]
    fn go(self) {
        let Self { table, laws, deformation, coarse, force } = self;
        for point in 0..table.len() {
            let volume = Lanes::splat(table.volume[point].max(-table.volume[point]));
            let given = projected::<T, AXISYMMETRIC>(coarse, &table.corners[point]);
            let stiffness = stiffness_by_lane(|lane| &laws.0[lane], &deformation[point], given);
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
