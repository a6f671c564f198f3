//! Recovery from a lost solution without a reset.
//!
//! When the attempts of `contain` have failed, the twin goes back to the last saved state, with the instrument where it was
//! then. The next poses are tried from there with shorter and shorter strides. After [`DEEPER`] attempts only a pose that is no
//! deeper than the saved state is tried, and each time that fails only one of half the depth, so that the attempts end. Once
//! the instrument is out, the tissue is undeformed.

use crate::instrument::{Contact, Tip};

use super::saved::Lost;
use super::{Halt, Phase, Twin};

/// Attempts with poses deeper than the saved state.
const DEEPER: u32 = 3;

impl Twin {
    /// Notes where the instrument is at a saved state.
    pub(super) fn keep_place(&mut self, tip: [f64; 3], shaft: [f64; 2], depth_m: f64, phase: Phase) {
        let saved = &mut self.saved;
        if let (Some(own), Some(contact)) = (&mut saved.contact, &self.contact) {
            own.take_over(contact);
        }
        (saved.tip, saved.shaft, saved.depth_m, saved.phase) = (tip, shaft, depth_m, phase);
    }

    /// Whether a pose may be tried.
    ///
    /// # Errors
    /// The loss, while the pose is too deep.
    pub(super) fn try_again(&mut self, tip: &Tip) -> Result<(), Halt> {
        let Some(lost) = &self.progress.lost else { return Ok(()) };
        if tip.depth > 0.0 && tip.depth > lost.deepest_m && lost.tries >= DEEPER {
            return Err(lost.halt.clone());
        }
        if tip.depth <= 0.0 {
            self.undeform();
        }
        Ok(())
    }

    /// Factor on the length of a stride: half of the last one at each try.
    pub(super) fn care(&self) -> f64 {
        self.progress.lost.as_ref().map_or(1.0, |lost| 0.5_f64.powi(1 + lost.tries.min(DEEPER) as i32))
    }

    /// Back to the undeformed tissue.
    pub(super) fn undeform(&mut self) {
        self.solver.reset();
        if let Some(contact) = &mut self.contact {
            contact.reset(&mut self.solver);
        }
        self.progress.pace.reset();
        self.progress.steps_since_save = 0;
        self.progress.constraint_error_m = 0.0;
        self.progress.folded_energy = 0.0;
        self.progress.discretisation_error = 0.0;
        self.begin();
    }

    /// The instrument is where it is before the first pose.
    pub(super) fn begin(&mut self) {
        let depth = match &self.contact {
            Some(Contact::Frictional(needle)) => needle.start(),
            _ => 0.0,
        };
        let phase = if depth > 0.0 { Phase::Penetration } else { Phase::Approach };
        let p = &mut self.progress;
        (p.tip, p.shaft, p.phase) = ([0.0, 0.0, 0.0 - depth], [0.0; 2], phase);
        let tip = p.tip;
        self.keep_place(tip, [0.0; 2], depth, phase);
    }

    /// Goes back to the saved state after a pose at a depth was lost.
    pub(super) fn fall_back(&mut self, halt: &Halt, depth_m: f64) {
        let (deepest_m, tries) = match &self.progress.lost {
            Some(lost) if lost.tries < DEEPER => (lost.deepest_m.min(self.saved.depth_m), lost.tries + 1),
            Some(lost) => (0.5 * lost.deepest_m.min(depth_m), lost.tries),
            None => (self.saved.depth_m, 0),
        };
        self.progress.lost = Some(Lost { halt: halt.clone(), deepest_m, tries });
        // no factor of the tries is kept: the step that the saved state needs is found anew
        self.solver.restore(0.0);
        if let (Some(contact), Some(saved)) = (&mut self.contact, &self.saved.contact) {
            contact.return_to(saved, &mut self.solver);
        }
        self.solver.refresh_step();
        self.progress.pace.reset();
        self.progress.pace.unsettle();
        let p = &mut self.progress;
        (p.tip, p.shaft, p.phase) = (self.saved.tip, self.saved.shaft, self.saved.phase);
        self.progress.steps_since_save = 0;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::twin::{StampedPose, Trouble};

    fn force(twin: &mut Twin, depth_m: f64) -> Result<f64, Halt> {
        let pose = StampedPose { time_s: 0.0, pose: twin.pose_at_depth(depth_m) };
        twin.step(pose).map(|p| p.force_n[2])
    }

    fn lose(twin: &mut Twin, depth_m: f64) -> Halt {
        let halt = Halt::Diverged { trouble: Trouble::NotFinite, tries: 1, step: 0, depth_m };
        // a solution that was lost
        let through = [f64::NAN; 3];
        (0..twin.solver.roles().len()).for_each(|n| twin.solver.prescribe(n, through));
        twin.solver.advance(&mtled::solver::Advance { steps: 200, travel: [0.0, 0.0, 1e-3] });
        assert!(!twin.solver.balance().kinetic.is_finite(), "it ends before its last step and says so");
        twin.fall_back(&halt, depth_m);
        halt
    }

    #[test]
    fn a_lost_solution_comes_back_from_the_last_good_state() {
        for preset in ["compression", "needle_insertion"] {
            let mut twin = Twin::new(&Scene::preset(preset).unwrap()).unwrap();
            let walk = |twin: &mut Twin| (1..=200).map(|i| force(twin, 1e-5 * f64::from(i)).unwrap()).last().unwrap();
            let seen = walk(&mut twin);
            lose(&mut twin, 2e-3);
            let back = (0..100).map(|_| force(&mut twin, 2e-3).unwrap()).last().unwrap();
            assert!((back / seen - 1.0).abs() < 0.02, "{preset}: {back} N, {seen} N before");
            // lost again and again: deeper places are not tried for ever, shallower ones are, and out of the tissue it is as new
            let halts: Vec<Halt> = (0..=DEEPER).map(|_| lose(&mut twin, 2e-3)).collect();
            assert_eq!(force(&mut twin, 2.4e-3), Err(halts[0].clone()), "{preset}");
            assert!(force(&mut twin, 1e-4).is_ok(), "{preset}");
            for _ in 0..20 {
                lose(&mut twin, 1e-4);
            }
            assert!(force(&mut twin, 1e-4).is_err(), "{preset}");
            assert_eq!(force(&mut twin, -1e-4).unwrap().abs(), 0.0, "{preset}");
            let again = walk(&mut twin);
            assert!((again / seen - 1.0).abs() < 0.01, "{preset}: {again} N, {seen} N at first");
        }
    }
}
