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

use super::block::{Block, ForceOfLane};
use super::disjoint::Chunks;
use super::kernel::NODES_PER_CHUNK;
use super::points::{Constants, PointLaw, Relaxing};
use super::state::{Solver, with_kernel};
use crate::number::lanes::{Loop, run};
use crate::number::{Number, Real};

/// Masses shrink by at most this factor per refresh, so that a point on the verge doesn't make them swing.
const FADE: f64 = 0.95;

impl Solver {
    /// Brings the masses up to date with the last evaluation of the internal force, and the slowest frequency with the
    /// masses. Costs less than a third of a step.
    pub(super) fn refresh_masses(&mut self) {
        let (pool, u, scale) = (&mut self.pool, &self.state.u, self.mass_scale);
        let mass = Chunks::new(&mut self.mass, NODES_PER_CHUNK);
        with_kernel!(&mut self.kernel, k => {
            k.bound(pool, u);
            pool.each(mass, |i, mass| {
                for (m, n) in mass.iter_mut().zip(i * NODES_PER_CHUNK..) {
                    let needed = scale * k.node_force(n)[0];
                    if needed.is_finite() {
                        *m = needed.max(FADE * *m);
                    }
                }
            });
        });
        self.slowest = self.sway.frequency(&self.mass);
    }
}

impl<T: Real> Block<T> {
    /// Leaves the block's shares of the masses, over s, in the first component of its forces.
    pub(super) fn bound(&self, constants: &Constants, scratch: &mut ForceOfLane<T>, force: &mut [[T; 3]]) {
        match constants.plain() {
            Some(plain) => run(Bound(self, &plain, scratch, force)),
            None => run(Bound(self, &Relaxing { constants, memory: &self.memory }, scratch, force)),
        }
    }
}

/// The loop over points of the bounds.
struct Bound<'a, T: Real, L>(&'a Block<T>, &'a L, &'a mut ForceOfLane<T>, &'a mut [[T; 3]]);

impl<T: Real, L: PointLaw<T>> Loop for Bound<'_, T, L> {
    #[inline(always)]
    fn go(self) {
        let Self(block, law, lanes, force) = self;
        for group in 0..block.volume.len() {
            let volume = block.volume[group].max(-block.volume[group]);
            let stiffness = law.stiffness(&block.deformation[group], block.projected_pressure(group));
            let share = volume * block.squares[group] * stiffness;
            for visit in block.start[group] as usize..block.start[group + 1] as usize {
                lanes[usize::from(block.local[visit])][0] += share.where_bit(block.used[visit]);
            }
        }
        T::sum_and_clear(lanes, force);
    }
}

/// Rayleigh quotient of the slowest mode of a body that stands on its base, up to the shape of the section:
/// omega^2 = G V (pi / 2 H)^2 / 2 / sum_j m_j sin^2(pi z_j / 2 H). In space it is the sway u_x = sin(pi z / 2 H), with G
/// the shear modulus; a body that keeps its symmetry of revolution can't sway, and its slowest mode is the stretch
/// u_z = sin(pi z / 2 H), with Young's modulus for G.
#[derive(Clone, Debug)]
pub(super) struct Sway {
    /// H, m.
    height: f64,
    /// Numerator, N/m.
    stiffness: f64,
    /// sin^2 at each node.
    square: Vec<f64>,
}

impl Sway {
    pub fn new(points: &[[f64; 3]], volume: f64, modulus: f64) -> Self {
        let height = points.iter().map(|p| p[2]).fold(0.0, f64::max);
        let k = std::f64::consts::FRAC_PI_2 / height;
        Self {
            height,
            stiffness: 0.5 * modulus * volume * k * k,
            square: points.iter().map(|p| (k * p[2]).sin().powi(2)).collect(),
        }
    }

    /// H, m.
    pub fn height(&self) -> f64 {
        self.height
    }

    /// rad per step.
    pub fn frequency(&self, mass: &[f64]) -> f64 {
        let inertia: f64 = mass.iter().zip(&self.square).map(|(m, s)| m * s).sum();
        (self.stiffness / inertia).sqrt()
    }
}
