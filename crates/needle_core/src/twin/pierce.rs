//! A needle with friction in the twin: fine strides, the tissue's springing back after a puncture, and what can be asked of it.

use crate::instrument::{Contact, Tip};
use mtled::solver::Balance;

use super::{Halt, Phase, Twin};

/// Longest stride in radii of the needle, at any rate of poses: the front and the shaft's length are brought up to date between two, and
/// what slips and cuts depends on it. A jump is made in no more than so many, until they are five times as long.
const STRIDE: f64 = 0.005;
/// The same in space: R/2 between layers, and not R/8 as at a membrane of a half plane. With 0.0025 a pose of 5 um takes four steps for nothing
/// (`docs/lab/friction.md`).
const STRIDE_IN_SPACE: f64 = 0.01;
const STRIDES: f64 = 40.0;
/// Strides for which the most steps of a pose are meant: those of 10 um with the preset's needle. A longer way may pass several membranes.
pub(super) const STRIDES_OF_A_POSE: u32 = 4;
/// Explicit steps between two looks at tissue that is not at rest, and most looks.
const LOOK: u32 = 8;
const LOOKS: u32 = 512;
/// Looks between two adaptions of the damping: more often, it follows pressure waves as well.
const ADAPT: u32 = 4;

/// Length of a stride of a way, m.
pub(super) fn stride(radius: f64, length: f64, in_space: bool) -> f64 {
    // a pose that is as long but for round-off is one stride: with two now and then there are a tenth more steps
    let shortest = if in_space { STRIDE_IN_SPACE } else { STRIDE } * (1.0 + 1e-6) * radius;
    (length / STRIDES).clamp(shortest, 5.0 * STRIDE * radius)
}

impl Twin {
    /// Takes further steps at the same pose, at most so many, while the tissue is not near enough to rest, or the front runs through tissue that springs
    /// back after a puncture.
    pub(super) fn come_to_rest(
        &mut self,
        first: &Balance,
        tip: &Tip,
        phase: Phase,
        time_s: f64,
        most: u32,
    ) -> Result<Option<(Balance, u32)>, Halt> {
        let (mut last, mut taken, mut sprang) = (None, 0, false);
        for look in 0..LOOKS {
            let balance: &Balance = last.as_ref().unwrap_or(first);
            let energies = self.energies(balance);
            let settled = self.progress.pace.is_settled(balance, energies);
            let force_n = self.corrected(balance.instrument, tip.depth);
            let [friction, _] = self.needle_forces().unwrap_or_default();
            let Some(Contact::Frictional(needle)) = &mut self.contact else { break };
            let springs = needle.springs_back(&self.solver, balance.gap, energies);
            let spent = taken >= most;
            if (settled && !springs) || spent {
                if !needle.breaks(&balance.instrument, friction) {
                    break;
                }
                self.happened.close(force_n);
                if spent {
                    break;
                }
            }
            sprang |= springs;
            if springs {
                let light = needle.has_swung(balance.gap);
                self.solver.lighten_slow_modes(light);
            }
            let seen = self.contact.as_mut().and_then(|c| c.impose(tip, &mut self.solver).1);
            self.happened.see(seen, tip, phase, self.contact.as_ref(), &self.fixed.along);
            if look % ADAPT == 0 {
                self.solver.adapt_damping();
            }
            let steps = LOOK.min(most.saturating_sub(taken)).max(1);
            last = Some(self.advance_safely(steps, [0.0; 3], tip, phase, time_s)?);
            taken += steps;
        }
        self.solver.lighten_slow_modes(true);
        if let Some(balance) = last.as_ref().filter(|_| sprang) {
            self.progress.pace.follow(balance);
        }
        Ok(last.map(|balance| (balance, taken)))
    }

    /// Depth of the material to which a needle with friction has cut, m; `None` for other instruments.
    #[must_use]
    pub fn cut_depth(&self) -> Option<f64> {
        match &self.contact {
            Some(Contact::Frictional(n)) => Some(n.front()),
            _ => None,
        }
    }

    /// Deformation coefficient that a needle with friction has on its way in: how far the tissue at its shaft has gone over how far the
    /// needle has, since its tip came to it. It is a result here and a key of the kinematic needle. `None` for other instruments, before
    /// the puncture and on the way out.
    #[must_use]
    pub fn deformation_coefficient(&self) -> Option<f64> {
        match &self.contact {
            Some(Contact::Frictional(n)) => n.deformation_coefficient(&self.solver),
            _ => None,
        }
    }

    /// Forces of friction and at the tip of a needle with friction, N, positive against the insertion, as far as inertia lets the nodes
    /// have them; `None` for other instruments.
    #[must_use]
    pub fn needle_forces(&self) -> Option<[f64; 2]> {
        matches!(self.contact, Some(Contact::Frictional(_))).then(|| self.solver.drag_forces())
    }

    /// Work that slip along a needle with friction and at its tip has dissipated since the last reset, J.
    #[must_use]
    pub fn dissipated_j(&self) -> f64 {
        self.solver.dissipated()
    }
}
