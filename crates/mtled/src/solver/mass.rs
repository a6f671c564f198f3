//! Masses that keep every point's own step above the common one, while the tissue deforms.
//!
//! ```text
//! m_n = s sum_g k_g V_g sum_j |grad phi_j|^2 over the points g whose support holds node n
//! ```
//!
//! A point's largest eigenvalue is at most n_g k_g V_g sum_j |grad phi_j|^2 over its mass, so with its mass shared
//! equally by its n_g nodes every point has the same bound (method: Joldes, Wittek, Miller 2012). k_g is the largest
//! stiffness of a plane wave in the point's present state ([`super::points::Constants::stiffness`]); it grows by orders of magnitude
//! where tissue is crushed at the edge of an indenter. Because the motion is quasi-static, that part alone is made
//! heavier, and the rest of the body moves on at its own pace: one mass factor for all would slow all of it. s is set
//! once, at rest, from the true largest eigenvalue.

use std::sync::Arc;

use super::block::{Block, BlockScratch, ForceOfLane};
use super::disjoint::{Chunks, NODES_PER_CHUNK};
use super::memory::{InLanes, Memory, Relaxing};
use super::model::{Model, Workspace, with_kernel};
use super::points::{Constants, PointLaw};
use super::state::State;
use crate::number::{Pass, Real, Vector, load_all, run_pass};

/// Masses shrink by at most this factor per refresh, so that a point on the verge doesn't make them swing.
const FADE: f64 = 0.95;
/// Mass of a node over that at rest up to which it counts in the slowest mode. Where tissue is sheared or crushed a hundredfold beside what
/// holds it, a few nodes get millions of times as heavy; they stay with what holds them and take no part in that mode.
const OUTLIER: f64 = 30.0;

impl Model {
    /// Brings the masses up to date with the last evaluation of the internal force, and the slowest frequency with the
    /// masses. Costs less than a third of a step.
    pub(super) fn refresh_masses(&self, state: &mut State, work: &mut Workspace) {
        let State { moving, control, .. } = state;
        let mass = Chunks::new(&mut control.mass, NODES_PER_CHUNK);
        with_kernel!((&self.kernel, &mut work.scratch) => (k, scratch) {
            k.bound(&moving.memory, scratch, &mut work.pool);
            let scratch = &*scratch;
            work.pool.each(mass, |i, mass| {
                for (m, n) in mass.iter_mut().zip(i * NODES_PER_CHUNK..) {
                    self.follow_bound(m, k.node_force(scratch, n)[0]);
                }
            });
        });
        control.slowest = self.slowest(&control.mass);
    }

    /// Brings a mass up to date with the node's share of the bounds.
    #[inline]
    pub(super) fn follow_bound(&self, mass: &mut f64, bound: f64) {
        let needed = self.mass_scale * bound;
        if needed.is_finite() {
            *mass = needed.max(FADE * *mass);
        }
    }

    /// Frequency of the slowest mode, rad per step: see [`OUTLIER`].
    pub(super) fn slowest(&self, mass: &[f64]) -> f64 {
        let counted = |(m, rest): (&f64, &f64)| if *rest > 0.0 { m.min(OUTLIER * rest) } else { *m };
        self.mode.frequency(mass.iter().zip(&self.rest.control.mass).map(counted))
    }
}

impl<T: Real> Block<T> {
    /// Leaves the block's shares of the masses, over s, in the first component of its forces.
    pub(super) fn bound(
        &self,
        memory: &Memory,
        constants: &Constants,
        scratch: &BlockScratch<T>,
        lanes: &mut ForceOfLane<T>,
        force: &mut [[T; 3]],
    ) {
        // how stiff a point is does not depend on what it remembers
        if let Some(law) = constants.of_mixed() {
            run_pass(Bound { block: self, law: &law, scratch, lanes, force });
        } else if let Some(law) = constants.plain() {
            run_pass(Bound { block: self, law: &law, scratch, lanes, force });
        } else if let Some(volume) = constants.volume() {
            let law = InLanes::<_, false> { shape: constants.shape(), volume, memory };
            run_pass(Bound { block: self, law: &law, scratch, lanes, force });
        } else {
            run_pass(Bound { block: self, law: &Relaxing { constants, memory }, scratch, lanes, force });
        }
    }
}

/// The loop over points of the bounds.
struct Bound<'a, T: Real, L> {
    block: &'a Block<T>,
    law: &'a L,
    scratch: &'a BlockScratch<T>,
    lanes: &'a mut ForceOfLane<T>,
    force: &'a mut [[T; 3]],
}

impl<T: Real, L: PointLaw<T>> Pass<T> for Bound<'_, T, L> {
    #[inline(always)]
    fn go<V: Vector<T>>(self) {
        let Self { block, law, scratch, lanes, force } = self;
        for group in 0..block.volume.len() {
            let volume = V::load(&block.volume[group]);
            let f = load_all::<T, V, 9>(&scratch.deformation[group]);
            let stiffness = law.stiffness(&f, block.projected(scratch, group));
            let share = (volume.max(-volume) * V::load(&block.squares[group]) * stiffness).store();
            for visit in block.start[group] as usize..block.start[group + 1] as usize {
                lanes[usize::from(block.local[visit])][0] += share.where_bit(block.used[visit]);
            }
        }
        T::sum_and_clear(lanes, force);
    }
}

/// Slices of a body of several materials.
const SLICES: usize = 64;

/// Rayleigh quotient of the slowest mode of a body that stands on its base, up to the shape of the section:
/// omega^2 = G V (pi / 2 H)^2 / 2 / sum_j m_j sin^2(pi z_j / 2 H). In space it is the shear mode u_x = sin(pi z / 2 H), with G
/// the shear modulus; a body that keeps its symmetry of revolution has no such mode, and its slowest mode is the stretch
/// u_z = sin(pi z / 2 H), with Young's modulus for G.
#[derive(Clone, Debug)]
pub(super) struct FundamentalMode {
    /// H, m.
    height: f64,
    /// Numerator, N/m.
    stiffness: f64,
    /// sin^2 at each node.
    square: Vec<f64>,
}

/// What the slowest mode depends on beside the materials; shared by the models of one cloud.
#[derive(Clone, Debug)]
pub(super) struct Extent {
    /// Undeformed places of the nodes, m.
    pub points: Arc<[[f64; 3]]>,
    /// m^3.
    pub volume: f64,
    /// Height of the cell (m), volume (m^3) and region of each integration point; empty in a body of one material.
    pub parts: Arc<[(f64, f64, u8)]>,
}

/// Lowest z of a body and its height over that, m: a mesh has its own frame, in which its base may lie anywhere.
fn base_and_height(points: &[[f64; 3]]) -> (f64, f64) {
    let z = || points.iter().map(|p| p[2]);
    let base = z().fold(f64::INFINITY, f64::min);
    (base, z().fold(f64::NEG_INFINITY, f64::max) - base)
}

impl FundamentalMode {
    /// Of a body with the modulus of each region, Pa.
    pub(super) fn of(extent: &Extent, moduli: &[f64]) -> Self {
        let Extent { points, volume, parts } = extent;
        match moduli {
            [modulus] => Self::new(points, *volume, *modulus),
            _ => Self::layered(points, parts.iter().map(|&(z, volume, r)| (z, volume, moduli[usize::from(r)]))),
        }
    }

    pub(super) fn new(points: &[[f64; 3]], volume: f64, modulus: f64) -> Self {
        let (base, height) = base_and_height(points);
        let k = std::f64::consts::FRAC_PI_2 / height;
        Self {
            height,
            stiffness: 0.5 * modulus * volume * k * k,
            square: points.iter().map(|p| (k * (p[2] - base)).sin().powi(2)).collect(),
        }
    }

    /// The same of a body whose modulus changes from place to place: `(z, volume, modulus)` of each integration point. The
    /// mode is u = sin(pi s / 2), where s grows from 0 to 1 up the body as the compliance of its slices does.
    pub(super) fn layered(points: &[[f64; 3]], parts: impl Iterator<Item = (f64, f64, f64)>) -> Self {
        let (base, height) = base_and_height(points);
        let slice = |z: f64| (((z - base) / height * SLICES as f64).max(0.0) as usize).min(SLICES - 1);
        // volume, and volume times modulus, of each slice
        let mut slices = [[0.0; 2]; SLICES];
        for (z, volume, modulus) in parts {
            let [v, m] = &mut slices[slice(z)];
            *v += volume;
            *m += volume * modulus;
        }
        let compliance = slices.map(|[v, m]| if m > 0.0 { v / m } else { 0.0 });
        let total: f64 = compliance.iter().sum();
        let mut before = [0.0; SLICES + 1];
        (0..SLICES).for_each(|i| before[i + 1] = before[i] + compliance[i] / total);
        let quarter = std::f64::consts::FRAC_PI_2;
        let thick = height / SLICES as f64;
        let stiffness = |i: usize| {
            let slope = quarter * (quarter * 0.5 * (before[i] + before[i + 1])).cos() * compliance[i] / total / thick;
            slices[i][1] * slope * slope
        };
        let shape = |z: f64| {
            let i = slice(z);
            let s = before[i] + (before[i + 1] - before[i]) * ((z - base) / thick - i as f64).clamp(0.0, 1.0);
            (quarter * s).sin()
        };
        Self {
            height,
            stiffness: (0..SLICES).map(stiffness).sum(),
            square: points.iter().map(|p| shape(p[2]).powi(2)).collect(),
        }
    }

    /// H, m.
    pub(super) fn height(&self) -> f64 {
        self.height
    }

    /// rad per step.
    pub(super) fn frequency(&self, mass: impl Iterator<Item = f64>) -> f64 {
        let inertia: f64 = mass.zip(&self.square).map(|(m, s)| m * s).sum();
        (self.stiffness / inertia).sqrt()
    }
}
