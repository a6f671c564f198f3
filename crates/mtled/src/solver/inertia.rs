//! What inertia and damping add to the force on the instrument, and how to take it out again.
//!
//! While the tissue lags behind, the internal forces f_j of the free nodes do not vanish: they accelerate and are damped, and
//! the instrument feels a part of each. How much of it follows from virtual work: let every instrument node move by the
//! same, and the free nodes by t_j, as they would at rest. The work of all internal forces in that motion is that of the force
//! at rest, to first order in the lag, since its stiffness times t vanishes at the free nodes (Betti):
//!
//! ```text
//! F = F_instrument - c/|c|^2 sum_free t_j . f_j
//! ```
//!
//! c: mean displacement of the instrument's nodes per metre of its travel; t: tissue's displacement per metre of travel, of
//! which the solver knows two approximations. The tangent motion that it has learnt comes late, the present motion
//! t + q/d runs ahead; F is taken with their mean, and half of the difference is the error estimate. Each t_j being between
//! nothing and all of the instrument's own motion, F lies between the forces on instrument and base: it is never further off than
//! those.

use crate::approximation::Form;

use super::model::Model;
use super::state::{Constraints, Role, State};
use super::step::Balance;

/// The last motion of the instrument.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    /// c.
    pub rate: [f64; 3],
    /// d / (d^2 + e^2), 1/m, with d the travel per step (see [`super::step`]); 0 at rest.
    pub gain: f64,
}

/// Sums over nodes that the balance is made of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// Force of the tissue on the instrument, N.
    pub instrument: [f64; 3],
    /// Force of the tissue on the base, N.
    pub base: [f64; 3],
    /// Kinetic energy of the scaled masses, J.
    pub kinetic: f64,
    /// sum t_j . f_j over the free nodes, N.
    pub learnt: f64,
    /// sum q_j . f_j over the free nodes, J.
    pub present: f64,
}

impl Sums {
    /// A free node of a mass with what is left of the internal force on it.
    pub fn add_free(&mut self, mass: f64, q: &[f64; 3], tangent: &[f64; 3], left: &[f64; 3]) {
        self.kinetic += 0.5 * mass * dot(q, q);
        self.learnt += dot(tangent, left);
        self.present += dot(q, left);
    }

    /// Those of a state that holds no numbers any more.
    pub const LOST: Self =
        Self { instrument: [f64::NAN; 3], base: [f64::NAN; 3], kinetic: f64::NAN, learnt: f64::NAN, present: f64::NAN };
}

impl std::ops::Add for Sums {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            instrument: std::array::from_fn(|k| self.instrument[k] + other.instrument[k]),
            base: std::array::from_fn(|k| self.base[k] + other.base[k]),
            kinetic: self.kinetic + other.kinetic,
            learnt: self.learnt + other.learnt,
            present: self.present + other.present,
        }
    }
}

pub(super) fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Model {
    /// Keeps c of an advance by `travel` metres; of a rest or of an advance without instrument nodes the one before stays.
    pub(super) fn note_motion(&self, state: &mut State, travel: f64) {
        if travel == 0.0 {
            return;
        }
        let Constraints { role, path, instrument, way, .. } = &state.constraints;
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for (path, _) in path.iter().zip(role).filter(|(_, role)| **role == Role::Instrument) {
            (0..3).for_each(|k| sum[k] += path.end[k] - path.start[k]);
            count += 1.0;
        }
        if count == 0.0 && instrument.is_some() {
            (sum, count) = (std::array::from_fn(|k| way.end[k] - way.start[k]), 1.0);
        }
        if self.form == Form::Axisymmetric {
            // round a ring radial motions cancel, as their forces do
            sum[0] = 0.0;
        }
        if count > 0.0 {
            state.control.motion.rate = sum.map(|s| s / (count * travel));
        }
    }
}

impl Motion {
    /// Takes inertia out of the force on the instrument; fills in gap and error estimate. `slides`: tissue may slide on a surface.
    pub fn take_out_inertia(&self, b: &mut Balance, sums: &Sums, slides: bool) {
        let Self { rate, gain } = self;
        let sum: [f64; 3] = std::array::from_fn(|k| b.instrument[k] + b.base[k]);
        b.gap = dot(&sum, &sum).sqrt();
        let square = dot(rate, rate);
        if square <= 0.0 {
            return;
        }
        // along c, in newtons
        let (half, most) = (0.5 * sums.present * gain / square.sqrt(), dot(&sum, rate) / square.sqrt());
        let wanted = sums.learnt / square.sqrt() + half;
        let taken = wanted.clamp(most.min(0.0), most.max(0.0));
        b.error_estimate = half.abs().min(most.abs());
        if slides {
            // tissue that spreads between two smooth plates has a balance of forces, but no rest
            b.error_estimate = b.error_estimate.max((wanted - taken).abs());
        }
        (0..3).for_each(|k| b.instrument[k] -= taken * rate[k] / square.sqrt());
    }
}
