//! Damping of tissue that comes to rest without the instrument's motion: after a membrane has broken, after a turn.
//!
//! ```text
//! omega^2 = du . df / (du . M du)       du: displacement between two samples, m; df: change of the internal force, N; M: scaled masses
//! ```
//!
//! The Rayleigh quotient of the present motion, as in adaptive dynamic relaxation (Underwood, in Computational Methods for Transient
//! Analysis, 1983). A rod that slips holds the tissue by forces and not by places. That frees modes which are slower than the body's own,
//! and with damping that is critical for the body's they creep.

use super::explicit::Solver;
use super::state::State;
use crate::vector::dot;

/// Lowest frequency that is taken for that of a mode, over that of the body.
const LEAST: f64 = 0.1;
/// Share of an estimate that the next one keeps.
const KEEPS: f64 = 0.5;

/// Damping of a state.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AdaptiveDamping {
    /// Whether the [`Sample`] is of the present rest.
    sampled: bool,
    /// Frequency for which damping is critical, over that of the body.
    share: Option<f64>,
}

/// Displacements, m, and internal forces, N, at the last sample.
#[derive(Debug)]
pub(super) struct Sample {
    u: Vec<[f64; 3]>,
    f: Vec<[f64; 3]>,
}

impl Sample {
    /// Of a body of so many nodes.
    pub(super) fn new(nodes: usize) -> Self {
        Self { u: vec![[0.0; 3]; nodes], f: vec![[0.0; 3]; nodes] }
    }
}

impl AdaptiveDamping {
    /// The instrument moves, or the state is another.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }

    /// Frequency for which damping is critical, over that of the body.
    pub(super) fn share(&self) -> f64 {
        self.share.unwrap_or(1.0)
    }
}

impl Solver {
    /// Adapts the damping to the frequency of tissue that comes to rest, between two advances at the same pose.
    pub fn adapt_damping(&mut self) {
        let slowest = self.slowest();
        let modes = self.model.light_modes(&self.state.control);
        let State { moving, control, constraints, .. } = &mut self.state;
        let (damping, mass) = (&mut control.damping, &control.mass);
        let Sample { u, f } = &mut self.work.sample;
        if damping.sampled {
            let (mut stiffness, mut inertia) = (0.0, 0.0);
            for n in 0..mass.len() {
                let moved = std::array::from_fn(|k| moving.u[n][k] - u[n][k]);
                let changed = std::array::from_fn(|k| moving.f[n][k] - f[n][k]);
                stiffness += dot(moved, changed);
                inertia += mass[n] * moving.mass_factor * dot(moved, moved);
            }
            if let Some(modes) = modes {
                // the sample is taken anew below
                u.iter_mut()
                    .zip(&moving.u)
                    .for_each(|(before, now)| (0..3).for_each(|k| before[k] = now[k] - before[k]));
                inertia -= moving.mass_factor * modes.inertia_saved(u, mass, moving, constraints);
            }
            let share = (stiffness / inertia).max(0.0).sqrt() / slowest;
            if share.is_finite() {
                let share = share.clamp(LEAST, 1.0);
                damping.share = Some(damping.share.map_or(share, |before| KEEPS * before + (1.0 - KEEPS) * share));
            }
        }
        u.copy_from_slice(&moving.u);
        f.copy_from_slice(&moving.f);
        damping.sampled = true;
    }
}
