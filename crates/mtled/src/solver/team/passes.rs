//! The two passes of the [internal force](super::super::kernel) over the points of a block, for eight members at once: a point's
//! gradients and indices are read once, and the members stand in the lanes. What is added up, and in which order, is as in
//! [`super::super::passes`], so that a member has the bits of a solver alone: there eight points in the lanes of a group have a sum each,
//! and these eight are added up at last; here each point adds to the sum of its own lane of the group.

use crate::material::neo_hookean::{Gradient, cofactor_in, determinant_in, is_there};

use super::super::passes::scaled;
use super::super::points::{LaneLaw, Projected, WideLaw};
use super::super::strip::FIELDS;
use super::table::PointTable;
use crate::number::{LANES, Lanes, Pass, Real, Vector};

/// Bytes of a line of the cache, and how far ahead gradients are asked for.
#[cfg(all(target_arch = "x86_64", not(miri)))]
const LINE: usize = 64;
#[cfg(all(target_arch = "x86_64", not(miri)))]
const AHEAD: usize = 2048;

/// A number of each member at each of a vector's components.
pub(super) type Vectors<T> = [Lanes<T>; 3];

/// Components of a node's vector that the passes keep: x and z of a half plane, where y is zero. What they keep fills the first cache
/// several times over.
pub(super) const fn dimensions(axisymmetric: bool) -> usize {
    if axisymmetric { 2 } else { 3 }
}

/// Components of a deformation gradient that are kept, of what [`is_there`].
pub(super) const fn components(axisymmetric: bool) -> usize {
    if axisymmetric { 5 } else { 9 }
}

/// Where the component k stands among those.
const fn place<const AXISYMMETRIC: bool>(k: usize) -> usize {
    if AXISYMMETRIC { k / 2 } else { k }
}

/// The laws of eight members in one region.
#[derive(Clone, Copy, Debug)]
pub(super) struct Laws<L>(pub [L; LANES]);

/// What a point gets from the coarse nodes: means over the corners of its cell.
#[inline(always)]
fn projected<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(
    [pressure, shrinkage]: [&[Lanes<T>]; FIELDS],
    corners: &[u16; 4],
) -> Projected<V> {
    let mut given =
        Projected { pressure: mean_of_corners::<T, V, AXISYMMETRIC>(pressure, corners), shrinkage: V::default() };
    if !shrinkage.is_empty() {
        given.shrinkage = mean_of_corners::<T, V, AXISYMMETRIC>(shrinkage, corners);
    }
    given
}

#[inline(always)]
fn mean_of_corners<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(vertices: &[Lanes<T>], corners: &[u16; 4]) -> V {
    let [a, b, c, d] = corners.map(|corner| &vertices[usize::from(corner)]);
    let two = V::load(a) + V::load(b);
    if AXISYMMETRIC { V::of(1.0 / 3.0) * (two + V::load(c)) } else { V::of(0.25) * (two + (V::load(c) + V::load(d))) }
}

/// The loop over points of pass 1.
pub(super) struct Deform<'a, T: Real, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub active: &'a [Lanes<T>],
    /// Of each node, its [`dimensions`].
    pub u: &'a [Lanes<T>],
    /// Of each point, its [`components`].
    pub deformation: &'a mut [Lanes<T>],
    /// At each vertex of the block, m^3: of V (J - 1), and of V (I1 - 3) where the law is [mixed](super::super::mixed), or empty.
    pub sums: [&'a mut [Lanes<T>]; FIELDS],
    /// Smallest volume ratio so far.
    pub min: &'a mut Lanes<T>,
}

impl<T: Real, const AXISYMMETRIC: bool> Pass<T> for Deform<'_, T, AXISYMMETRIC> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { table, active, u, deformation, sums: [dilation, distortion], min } = self;
        let (one, zero) = (V::of(1.0), V::default());
        let share_of_corner = V::of(if AXISYMMETRIC { 1.0 / 3.0 } else { 0.25 });
        let mut least = V::load(min);
        for point in 0..table.len() {
            let visits = table.visits(point);
            if !AXISYMMETRIC {
                prefetch(&table.gradient[visits.clone()]);
            }
            let mut f = gather::<T, V, AXISYMMETRIC>(&table.local[visits.clone()], &table.gradient[visits], u);
            let (active, scale) = (V::load(&active[point]), V::splat(table.scale[point]));
            let kept = &mut deformation[components(AXISYMMETRIC) * point..][..components(AXISYMMETRIC)];
            for k in 0..9 {
                if is_there::<AXISYMMETRIC>(k) {
                    let undeformed = if k % 4 == 0 { one } else { zero };
                    f[k] = f[k].fma(scale, undeformed);
                    f[k] = f[k].where_positive(active, undeformed);
                    kept[place::<AXISYMMETRIC>(k)] = f[k].store();
                }
            }
            let j = determinant_in::<V, AXISYMMETRIC>(&f, &cofactor_in::<V, AXISYMMETRIC>(&f));
            least = j.where_positive(active, least).min(least);
            let volume = share_of_corner * active * V::splat(table.volume[point]);
            let corners = &table.corners[point][..if AXISYMMETRIC { 3 } else { 4 }];
            let share = volume * (j - one);
            share_out(dilation, corners, share);
            if !distortion.is_empty() {
                let mut square = V::of(-3.0);
                for f in &f {
                    square = f.fma(*f, square);
                }
                share_out(distortion, corners, volume * square);
            }
        }
        *min = least.store();
    }
}

#[inline(always)]
fn share_out<T: Real, V: Vector<T>>(sums: &mut [Lanes<T>], corners: &[u16], share: V) {
    for corner in corners {
        let sum = &mut sums[usize::from(*corner)];
        *sum = (V::load(sum) + share).store();
    }
}

/// The loop over points of pass 2.
pub(super) struct Stress<'a, T: Real, L, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub laws: &'a Laws<L>,
    pub active: &'a [Lanes<T>],
    /// As that of [`Deform`].
    pub deformation: &'a [Lanes<T>],
    /// At each vertex of the block, Pa, and r - 1 or nothing.
    pub coarse: [&'a [Lanes<T>]; FIELDS],
    /// What the points in each lane of the groups add to each node of the block, N, its [`dimensions`]; zero between passes.
    pub force: &'a mut [Lanes<T>],
    /// Of the block, J.
    pub energy: &'a mut Lanes<T>,
}

impl<T: Real, L: LaneLaw<T>, const AXISYMMETRIC: bool> Pass<T> for Stress<'_, T, L, AXISYMMETRIC> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { table, laws, active, deformation, coarse, force, energy } = self;
        let zero = V::default();
        let law = L::side_by_side::<V>(&laws.0);
        let mut sums = [zero; LANES];
        for point in 0..table.len() {
            let volume = V::load(&active[point]) * V::splat(table.volume[point]);
            if volume.is_zero() {
                continue;
            }
            let lane = table.lane(point);
            let given = projected::<T, V, AXISYMMETRIC>(coarse, &table.corners[point]);
            let (density, stress) = law.at::<AXISYMMETRIC>(&load::<T, V, AXISYMMETRIC>(deformation, point), given);
            // what is no tissue to one member must not spoil it
            let here = volume * volume;
            sums[lane] += (volume * density).where_positive(here, zero);
            let factor = volume * V::splat(table.scale[point]);
            let spread = scaled::<V, AXISYMMETRIC>(&stress, factor, here);
            let visits = table.visits(point);
            if !AXISYMMETRIC {
                prefetch(&table.gradient[visits.clone()]);
            }
            scatter::<T, V, AXISYMMETRIC>(&table.local[visits.clone()], &table.gradient[visits], &spread, lane, force);
        }
        let mut kept = [Lanes::default(); LANES];
        for lane in 0..LANES {
            kept[lane] = sums[lane].store();
        }
        *energy = Lanes::sum_of(&kept);
    }
}

/// The loop over points of the bounds (see [`super::super::mass`]).
pub(super) struct Bound<'a, T: Real, L, const AXISYMMETRIC: bool> {
    pub table: &'a PointTable<T>,
    pub laws: &'a Laws<L>,
    /// As those of [`Stress`].
    pub deformation: &'a [Lanes<T>],
    pub coarse: [&'a [Lanes<T>]; FIELDS],
    /// Share of the masses over s, in the first component.
    pub force: &'a mut [Lanes<T>],
}

impl<T: Real, L: LaneLaw<T>, const AXISYMMETRIC: bool> Pass<T> for Bound<'_, T, L, AXISYMMETRIC> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { table, laws, deformation, coarse, force } = self;
        let law = L::side_by_side::<V>(&laws.0);
        for point in 0..table.len() {
            let lane = table.lane(point);
            let volume = V::splat(table.volume[point].max(-table.volume[point]));
            let given = projected::<T, V, AXISYMMETRIC>(coarse, &table.corners[point]);
            let stiffness = law.stiffness(&load::<T, V, AXISYMMETRIC>(deformation, point), given);
            let share = volume * V::splat(table.squares[point]) * stiffness;
            for &l in &table.local[table.visits(point)] {
                let sum = &mut force[dimensions(AXISYMMETRIC) * (LANES * usize::from(l) + lane)];
                *sum = (V::load(sum) + share).store();
            }
        }
    }
}

/// A point's deformation gradient; zeros where a half plane has no other.
#[inline(always)]
fn load<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(kept: &[Lanes<T>], point: usize) -> Gradient<V> {
    let kept = &kept[components(AXISYMMETRIC) * point..][..components(AXISYMMETRIC)];
    let mut f = [V::default(); 9];
    for k in 0..9 {
        if is_there::<AXISYMMETRIC>(k) {
            f[k] = V::load(&kept[place::<AXISYMMETRIC>(k)]);
        }
    }
    f
}

/// sum_j u_j (x) grad phi_j, over the scale of the gradients, as in [`super::super::passes`].
#[inline(always)]
fn gather<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(
    local: &[u16],
    gradient: &[[T; 3]],
    u: &[Lanes<T>],
) -> Gradient<V> {
    let mut f = [V::default(); 9];
    let visits = local.iter().zip(gradient).map(|(l, g)| (usize::from(*l), g));
    if AXISYMMETRIC {
        let u = u.as_chunks::<2>().0;
        for (l, g) in visits {
            let g = [V::splat(g[0]), V::splat(g[1]), V::splat(g[2])];
            let (radial, axial) = (V::load(&u[l][0]), V::load(&u[l][1]));
            f[0] = radial.fma(g[0], f[0]);
            f[2] = radial.fma(g[2], f[2]);
            f[4] = radial.fma(g[1], f[4]);
            f[6] = axial.fma(g[0], f[6]);
            f[8] = axial.fma(g[2], f[8]);
        }
    } else {
        let u = u.as_chunks::<3>().0;
        for (l, g) in visits {
            let g = [V::splat(g[0]), V::splat(g[1]), V::splat(g[2])];
            let u = &u[l];
            for i in 0..3 {
                let u = V::load(&u[i]);
                for k in 0..3 {
                    f[3 * i + k] = u.fma(g[k], f[3 * i + k]);
                }
            }
        }
    }
    f
}

/// f_j += V P grad phi_j, with V P times the scale of the gradients row-major.
#[inline(always)]
fn scatter<T: Real, V: Vector<T>, const AXISYMMETRIC: bool>(
    local: &[u16],
    gradient: &[[T; 3]],
    p: &Gradient<V>,
    lane: usize,
    force: &mut [Lanes<T>],
) {
    let visits = local.iter().zip(gradient).map(|(l, g)| (usize::from(*l), g));
    if AXISYMMETRIC {
        let by_lane = force.as_chunks_mut::<2>().0.as_chunks_mut::<LANES>().0;
        for (l, g) in visits {
            let g = [V::splat(g[0]), V::splat(g[1]), V::splat(g[2])];
            let [radial, axial] = &mut by_lane[l][lane];
            *radial = p[0].fma(g[0], p[4].fma(g[1], p[2].fma(g[2], V::load(radial)))).store();
            *axial = p[6].fma(g[0], p[8].fma(g[2], V::load(axial))).store();
        }
    } else {
        let by_lane = force.as_chunks_mut::<3>().0.as_chunks_mut::<LANES>().0;
        for (l, g) in visits {
            let g = [V::splat(g[0]), V::splat(g[1]), V::splat(g[2])];
            let force = &mut by_lane[l][lane];
            for i in 0..3 {
                let sum = p[3 * i + 1].fma(g[1], p[3 * i + 2].fma(g[2], V::load(&force[i])));
                force[i] = p[3 * i].fma(g[0], sum).store();
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
