//! Possible error of the force while the tissue oscillates.
//!
//! Tissue oscillates about its equilibrium if it is moved in jumps (an overloaded computer does not answer every
//! pose) or released. Model it as a column on its base that is compressed at its other end by u. It oscillates
//! in its first mode, u z / h + b sin(pi z / h). When the mode passes its equilibrium, all its energy is kinetic,
//! E_k = (pi b / h)^2 E A h / 4. The energy of the compressed column is E_s = E A u^2 / 2 h, and the force is off by
//! E A pi b / h at most:
//!
//! ```text
//! F_swing / F = pi b / u = sqrt(2 E_k / E_s)
//! ```
//!
//! Half a swing later all the energy is strain energy. So the largest value of the last readings is used, reduced by
//! the damping since then.

use crate::compare::rows::SWINGS_S;
use needle_core::twin::Health;

/// Factor by which an oscillation decays within [`SWINGS_S`].
const FADED: f64 = 20.0;

/// Largest F_swing of the last readings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Swing {
    size_n: f64,
    time_s: f64,
}

impl Swing {
    /// Takes a prediction, N, and its health. Returns the present F_swing, N.
    pub fn see(&mut self, time_s: f64, force_n: f64, health: &Health) -> f64 {
        let share = (2.0 * health.kinetic_to_strain_energy).sqrt();
        // the ratio of energies means nothing for a tissue that is hardly loaded, so it is limited
        let now = share.min(1.0) * force_n.abs();
        let since = (time_s - self.time_s).max(0.0) / SWINGS_S;
        self.size_n = now.max(self.size_n * FADED.powf(-since));
        self.time_s = time_s;
        self.size_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_is_of_the_force_and_fades() {
        let mut swing = Swing::default();
        let health = |kinetic_to_strain_energy: f64| Health { kinetic_to_strain_energy, ..Health::default() };
        // 5e-5: a tenth in a hundredth
        assert!((swing.see(1.0, -0.2, &health(5e-5)) - 0.002).abs() < 1e-12);
        let later = swing.see(1.15, -0.2, &health(0.0));
        assert!((later - 0.002 / 20f64.sqrt()).abs() < 1e-9, "{later}");
        assert!((swing.see(1.2, 1e-3, &health(7.0)) - 1e-3).abs() < 1e-12, "no more than the force");
    }
}
