//! How far a force may be off while the tissue swings.
//!
//! Tissue that is moved in jumps, as where a computer is too busy to answer every pose, or that is let go, swings about its rest. Let it be a column that
//! stands on its base and is pressed at its other end by u, and swing in its first wave, u z / h + b sin(pi z / h). While that goes through its rest all of
//! its energy is kinetic, E_k = (pi b / h)^2 E A h / 4, that of the pressed column is E_s = E A u^2 / 2 h, and the force is off by E A pi b / h at most:
//!
//! ```text
//! F_swing / F = pi b / u = sqrt(2 E_k / E_s)
//! ```
//!
//! Half a swing later it is all in the strain, so that the largest of the last readings counts, less what damping has taken since.

use crate::compare::rows::SWINGS_S;
use needle_core::twin::Health;

/// Times by which a swing has faded after [`SWINGS_S`].
const FADED: f64 = 20.0;

/// Largest F_swing of the last readings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Swing {
    size_n: f64,
    time_s: f64,
}

impl Swing {
    /// Takes note of a prediction, N, and its health; F_swing now, N.
    pub fn see(&mut self, time_s: f64, force_n: f64, health: &Health) -> f64 {
        let share = (2.0 * health.kinetic_to_strain_energy).sqrt();
        // energies of a tissue that is hardly loaded have no ratio that says more
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
