//! How many explicit steps a pose is worth.
//!
//! The inertial error of the force falls with the travel per step. Relative to the force it is about
//! travel / (omega L) with omega the slowest frequency (rad per step) and L the distance over which the force changes
//! by its own size; the steps that the tolerance asks for follow from that, and the instrument's force against the
//! base's then says whether they were enough.

use crate::scene::{Scene, Stepping};
use crate::solver::Balance;

/// L over the height of the sample, times the ratio of measured to estimated error (the estimate is an upper bound).
const LENGTH: f64 = 0.6;
/// Forces below this share of mu H^2 are judged as if they were as large: near zero a relative error means nothing.
const FORCE_FLOOR: f64 = 0.01;
/// Steps of one relaxation towards equilibrium, over 1/omega.
const RELAXATION: f64 = 0.5;

/// Pace of one scene.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    stepping: Stepping,
    /// Travel per step that keeps the tolerance, over omega, m.
    length: f64,
    force_floor: f64,
    peak: f64,
    /// Largest |instrument force + base force| over the peak force, at the last pose.
    pub imbalance: f64,
}

impl Pace {
    pub fn new(scene: &Scene) -> Self {
        let height = scene.sample.shape.height().get();
        Self {
            stepping: scene.stepping,
            length: LENGTH * height,
            force_floor: FORCE_FLOOR * scene.material.shear_modulus.get() * height * height,
            peak: 0.0,
            imbalance: 0.0,
        }
    }

    /// Steps for a pose that is `travel` metres from the last one.
    pub fn steps(&self, travel: f64, slowest: f64) -> u32 {
        let s = &self.stepping;
        if travel == 0.0 {
            return 0;
        }
        let wanted = (travel / (s.tolerance * slowest * self.length)).ceil();
        (wanted as u32).clamp(s.min_steps_per_pose, s.max_steps_per_pose)
    }

    /// Further steps that the balance asks for after `taken`; 0 when it is within the tolerance.
    pub fn more(&mut self, balance: &Balance, slowest: f64, taken: u32) -> u32 {
        let norm = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let force = norm(balance.instrument);
        self.peak = self.peak.max(force);
        let gap = norm(std::array::from_fn(|k| balance.instrument[k] + balance.base[k]));
        self.imbalance = if self.peak > 0.0 { gap / self.peak } else { 0.0 };
        if gap <= self.stepping.tolerance * force.max(self.force_floor) {
            return 0;
        }
        let relaxation = (RELAXATION / slowest).ceil() as u32;
        relaxation.min(self.stepping.max_steps_per_pose.saturating_sub(taken))
    }

    pub fn reset(&mut self) {
        self.peak = 0.0;
        self.imbalance = 0.0;
    }
}
