//! Divergence contained in one place: what counts as trouble, the way back to the last good state, and when to give up.
//!
//! Masses follow the stiffness of the deformed tissue (`solver::mass`), so a stable step stays stable. What that does not
//! prevent is handled here: the state is checked after every pose, and if it is not acceptable, the twin goes back to the
//! last good one and tries again with twice the mass, twice the steps and zero velocities, up to [`TRIES`] times.

use mtled::material::neo_hookean::{cofactor, determinant};
use mtled::solver::{Advance, Balance};

use crate::instrument::Tip;

use super::{Halt, Phase, Trouble, Twin};

/// Steps between two saved states.
const SAVE: u32 = 64;
/// Attempts after a divergence, each with twice the mass and twice the steps of the one before.
pub(super) const TRIES: u32 = 6;
/// Steps of all tries together, if one pose alone has fewer: six tries of a pose of [`SAVE`] steps.
const MOST_STEPS: u32 = 128 * SAVE;
/// The same over what one pose may cost, where there is a limit on that: a live twin is back within a second.
const MOST_POSES: u32 = 100;
/// Volume ratio at which a point counts as inverted.
const INVERTED: f64 = 1e-3;
/// Kinetic over strain energy beyond which a motion is not quasi-static.
const RUNAWAY: f64 = 10.0;
/// Strain energy, over mu H^3, below which the ratio is not evaluated.
const ENERGY_FLOOR: f64 = 1e-6;

impl Twin {
    /// Advances; on trouble goes back to the saved state and tries again with smaller steps.
    pub(super) fn advance_safely(
        &mut self,
        steps: u32,
        travel: [f64; 3],
        tip: &Tip,
        phase: Phase,
        time_s: f64,
    ) -> Result<Balance, Halt> {
        self.solver.refresh_if_due();
        // after the estimate, which takes the force of the last step for that of the present state
        self.solver.relax_until(time_s);
        self.solver.advance(&Advance { steps, travel });
        self.make_safe(steps, tip, phase, time_s)
    }

    /// What has to follow an advance of so many steps: on trouble the way back.
    pub(super) fn make_safe(&mut self, steps: u32, tip: &Tip, phase: Phase, time_s: f64) -> Result<Balance, Halt> {
        self.progress.steps_since_save += steps;
        let mut balance = self.solver.balance();
        let mut finer = steps.max(SAVE);
        let mut left = self.progress.pace.limit.saturating_mul(MOST_POSES).clamp(2 * finer, MOST_STEPS.max(4 * finer));
        let mut tries = 0;
        while tries < TRIES && left > finer && !self.solver.is_stopped() {
            if self.trouble(&balance).is_none() {
                self.keep(tip, phase, time_s);
                return Ok(balance);
            }
            tries += 1;
            self.progress.recoveries += 1;
            finer = finer.saturating_mul(2);
            left = left.saturating_sub(finer);
            self.solver.restore(2.0);
            self.solver.relax_again(time_s);
            self.solver.refresh_step();
            let taken = self.solver.advance(&Advance { steps: finer, travel: [0.0; 3] });
            self.progress.steps += u64::from(taken);
            balance = self.solver.balance();
        }
        match self.trouble(&balance) {
            None => {
                self.keep(tip, phase, time_s);
                Ok(balance)
            }
            Some(_) if self.solver.is_stopped() => Err(Halt::Interrupted),
            Some(trouble) => Err(Halt::Diverged { trouble, tries, step: self.progress.steps, depth_m: tip.depth }),
        }
    }

    /// The present state is good.
    fn keep(&mut self, tip: &Tip, phase: Phase, time_s: f64) {
        self.solver.commit(time_s);
        if self.progress.steps_since_save >= SAVE {
            self.solver.save();
            self.keep_place(tip.offset, tip.axis_at(0.0), tip.depth, phase);
            self.progress.steps_since_save = 0;
        }
    }

    /// What is wrong with the present state, if anything.
    fn trouble(&self, b: &Balance) -> Option<Trouble> {
        let finite = b.instrument.iter().chain(&b.base).all(|f| f.is_finite());
        if !(finite && b.kinetic.is_finite() && b.strain.is_finite()) {
            return Some(Trouble::NotFinite);
        }
        if self.solver.min_jacobian() < INVERTED {
            return Some(self.inverted());
        }
        let limit = RUNAWAY * b.strain.max(self.energy_floor());
        (b.kinetic > limit).then_some(Trouble::RunsAway { kinetic_j: b.kinetic, strain_j: b.strain })
    }

    /// The point with the smallest volume ratio.
    fn inverted(&self) -> Trouble {
        let ratio = |p: usize| {
            let f = self.solver.deformation(p);
            determinant(&f, &cofactor(&f))
        };
        let least = (0..self.integration_points()).map(|p| (p, ratio(p))).min_by(|a, b| a.1.total_cmp(&b.1));
        let (point, volume_ratio) = least.unwrap_or((0, f64::NAN));
        Trouble::Inverted { point, place: self.fixed.tissue.place(point), volume_ratio }
    }

    /// Strain energy below which the kinetic energy is not compared with it, J.
    pub(super) fn energy_floor(&self) -> f64 {
        ENERGY_FLOOR * self.fixed.scene.material.shear_modulus() * self.fixed.height.powi(3)
    }

    /// Kinetic over strain energy.
    pub(super) fn energies(&self, balance: &Balance) -> f64 {
        balance.kinetic / balance.strain.max(self.energy_floor())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use mtled::solver::Role;

    #[test]
    fn each_trouble_is_known_by_its_own_sign() {
        let mut twin = Twin::new(&Scene::preset("compression").unwrap()).unwrap();
        let good = Balance { strain: 1e-3, kinetic: 9e-3, ..Balance::default() };
        assert_eq!(twin.trouble(&good), None);
        for bad in [
            Balance { instrument: [0.0, 0.0, f64::NAN], ..good },
            Balance { base: [f64::INFINITY, 0.0, 0.0], ..good },
            Balance { kinetic: f64::NAN, ..good },
            Balance { strain: f64::INFINITY, ..good },
        ] {
            assert_eq!(twin.trouble(&bad), Some(Trouble::NotFinite), "{bad:?}");
        }
        let fast = Balance { kinetic: 1.1e-2, ..good };
        assert_eq!(twin.trouble(&fast), Some(Trouble::RunsAway { kinetic_j: 1.1e-2, strain_j: 1e-3 }));
        // next to no energy at all is no running away
        let floor = twin.energy_floor();
        assert_eq!(twin.trouble(&Balance { kinetic: 9.0 * floor, strain: 0.0, ..good }), None);
        assert!(twin.trouble(&Balance { kinetic: 11.0 * floor, strain: 0.0, ..good }).is_some());
        // the plate goes through the sample at once
        let held: Vec<usize> =
            (0..twin.solver.roles().len()).filter(|&n| twin.solver.roles()[n] == Role::Instrument).collect();
        assert!(!held.is_empty());
        let through = -1.2 * twin.fixed.height;
        held.iter().for_each(|&n| twin.solver.prescribe(n, [0.0, 0.0, through]));
        twin.solver.advance(&Advance { steps: 1, travel: [0.0, 0.0, -through] });
        let Some(Trouble::Inverted { volume_ratio, place, .. }) = twin.trouble(&good) else {
            panic!("{:?}", twin.trouble(&good));
        };
        assert!(volume_ratio < INVERTED && (0.0..=twin.fixed.height).contains(&place[2]), "{volume_ratio} {place:?}");
    }

    /// The tries of a live twin cost no more than a second of its poses, and those that hold no numbers end at once.
    #[test]
    fn the_tries_are_bounded() {
        let mut twin = Twin::new(&Scene::preset("compression").unwrap()).unwrap();
        let tip = Tip { offset: [0.0, 0.0, -1e-3], depth: 1e-3, slope: [0.0; 2], roll: 0.0 };
        for (limit, tries) in [(1, 1), (10, 3), (u32::MAX, TRIES)] {
            twin.limit_steps(limit);
            (0..twin.solver.roles().len()).for_each(|n| twin.solver.prescribe(n, [f64::NAN; 3]));
            let lost = twin.advance_safely(limit.min(SAVE), [0.0, 0.0, 1e-3], &tip, Phase::Indentation, 0.0);
            assert!(matches!(lost, Err(Halt::Diverged { tries: t, .. }) if t == tries), "{limit}: {lost:?}");
            twin.reset();
        }
    }

    /// An interrupt is heard within a few steps, in the pose itself and in its tries, and leaves the last good state.
    #[test]
    fn an_interrupt_is_heard_inside_a_pose() {
        let new = || Twin::new(&Scene::preset("compression").unwrap()).unwrap();
        let at = |twin: &Twin, depth_m| crate::twin::StampedPose { time_s: 0.0, pose: twin.pose_at_depth(depth_m) };
        let flag = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(true));
        let mut twin = new();
        twin.stop_on(std::sync::Arc::clone(&flag));
        assert!(twin.solver.advance(&Advance { steps: 100_000, travel: [0.0; 3] }) <= 24);
        // a pose that diverges: no try is made
        let mut twin = new();
        twin.stop_on(std::sync::Arc::clone(&flag));
        let tip = Tip { offset: [0.0, 0.0, -1e-3], depth: 1e-3, slope: [0.0; 2], roll: 0.0 };
        (0..twin.solver.roles().len()).for_each(|n| twin.solver.prescribe(n, [f64::NAN; 3]));
        let lost = twin.advance_safely(2000, [0.0, 0.0, 1e-3], &tip, Phase::Indentation, 0.0);
        assert_eq!((lost, twin.progress.steps), (Err(Halt::Interrupted), 0));
        // afterwards the instrument may rest where the saved state was left, and is answered
        let mut twin = new();
        twin.step(at(&twin, 1e-4)).unwrap();
        twin.stop_on(std::sync::Arc::clone(&flag));
        assert_eq!(twin.step(at(&twin, 2e-3)), Err(Halt::Interrupted));
        flag.store(false, std::sync::atomic::Ordering::Relaxed);
        for _ in 0..50 {
            let force = twin.step(at(&twin, 1e-4)).unwrap().force_n[2];
            assert!(force.is_finite() && force > 0.0, "{force} N");
        }
    }
}
