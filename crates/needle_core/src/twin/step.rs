//! A pose in, a prediction out.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::instrument::reading::not_a_place;
use crate::instrument::{Bending, Contact, Tip};
use crate::scene::Dimension;
use mtled::solver::Balance;

use super::{Halt, Health, Phase, Pose, Prediction, Progress, StampedPose, Twin, pierce, recovered};

/// Power iterations after which the fastest mode is known to a per cent.
const FASTEST_ITERATIONS: usize = 400;
/// Largest tilt of the instrument's axis (sine).
const ALIGNMENT: f64 = 0.02;
/// Largest tilt of an inserted needle (sine).
const INSERTED_ALIGNMENT: f64 = 0.35;
/// Largest tilt (sine) of an axisymmetric model's instrument, or out of a plane of symmetry, and largest distance from axis or plane over
/// the height of the body. The model cannot follow either; smaller values are taken for sensor noise.
const SYMMETRIC: f64 = 2e-3;
/// Steps between two measurements of the constraint error and of what has folded.
const LOOK: u64 = 64;

/// What a place that the instrument goes to is worth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    /// Way that the tissue is taken along, m.
    pub travel: [f64; 3],
    /// Whether the instrument moves it.
    pub moves: bool,
    pub phase: Phase,
    pub steps: u32,
}

impl Twin {
    /// Advances the tissue to a pose and predicts the force.
    ///
    /// Allocates nothing, takes no lock. The same poses give the same bits, whatever the number of threads; a clock is read only
    /// after a thread has kept the others waiting.
    ///
    /// # Errors
    /// [`Halt::Pose`] if the pose can't be used (state untouched), [`Halt::Diverged`] if the solution is lost, [`Halt::Interrupted`].
    pub fn step(&mut self, pose: StampedPose) -> Result<Prediction, Halt> {
        let tip = self.admit(&pose)?;
        self.try_again(&tip)?;
        let outcome = self.walk(pose, tip);
        self.close(pose.time_s, tip.depth, outcome)
    }

    /// Ends a pose: what the next ones begin from.
    pub(super) fn close(
        &mut self,
        time_s: f64,
        depth_m: f64,
        outcome: Result<Prediction, Halt>,
    ) -> Result<Prediction, Halt> {
        match &outcome {
            Ok(_) => (self.progress.lost, self.progress.seen_s) = (None, Some(time_s)),
            Err(halt) => self.fall_back(halt, depth_m),
        }
        outcome
    }

    /// As [`Twin::step`], for a stream that comes from an instrument: a jump that no instrument makes is refused. What it
    /// may make in the time since the last pose is in [`crate::instrument::reading::SPEED_M_PER_S`], or twice the speed of the
    /// scene's own motion.
    ///
    /// # Errors
    /// As [`Twin::step`]; [`Halt::Pose`] for a jump.
    pub fn follow(&mut self, pose: StampedPose) -> Result<Prediction, Halt> {
        self.admit_next(&pose)?;
        self.step(pose)
    }

    /// Checks a pose of a stream.
    pub(super) fn admit_next(&self, pose: &StampedPose) -> Result<Tip, Halt> {
        let tip = self.admit(pose)?;
        match self.too_fast(&tip, pose.time_s) {
            Some(reason) => Err(Halt::Pose { reason }),
            None => Ok(tip),
        }
    }

    fn walk(&mut self, pose: StampedPose, tip: Tip) -> Result<Prediction, Halt> {
        let mut steps = 0_u32;
        self.happened.begin();
        let way = self.way(&tip);
        self.time(pose.time_s, &tip, way.moves());
        let most = self.most_of(way.strides());
        for (made, between) in (0..).zip(way.places()) {
            // each that follows has its step
            let kept = way.strides().saturating_sub(made);
            steps =
                steps.saturating_add(self.go(pose, between, most.saturating_sub(steps.saturating_add(kept)))?.steps);
        }
        let last = self.go(pose, tip, most.saturating_sub(steps))?;
        Ok(Prediction { steps: steps.saturating_add(last.steps), event: self.happened.first(), ..last })
    }

    /// Says how long each of so many moves to a place takes.
    pub(super) fn time(&mut self, time_s: f64, tip: &Tip, moves: f64) {
        let whole_s = self.progress.speed.time_to(time_s, tip.depth);
        if let Some(Contact::Frictional(needle)) = &mut self.contact {
            needle.elapse(whole_s.map(|whole_s| whole_s / moves));
        }
    }

    /// Most steps for a way in so many strides: those of a pose for each [`pierce::STRIDES_OF_A_POSE`].
    pub(super) fn most_of(&self, strides: u32) -> u32 {
        self.progress.pace.most().saturating_mul(strides.div_ceil(pierce::STRIDES_OF_A_POSE).max(1))
    }

    /// Takes the tissue to a place at once, in `most` steps or one.
    pub(super) fn go(&mut self, pose: StampedPose, tip: Tip, most: u32) -> Result<Prediction, Halt> {
        let Move { travel, moves, phase, steps } = self.set_out(pose.time_s, &tip);
        if steps == 0 {
            return Ok(self.stay(pose.time_s, &tip, phase));
        }
        let steps = steps.min(most.max(1));
        let mut last = self.advance_safely(steps, travel, &tip, phase, pose.time_s)?;
        self.progress.pace.judge(&last, moves);
        let mut taken = steps;
        let left = most.saturating_sub(steps);
        let further = if matches!(self.contact, Some(Contact::Frictional(_))) {
            self.come_to_rest(&last, &tip, phase, pose.time_s, left)?
        } else {
            self.calm(&last, &tip, phase, pose.time_s, left)?
        };
        let moving = moves && further.is_none();
        if let Some((balance, further)) = further {
            self.progress.pace.note(&balance);
            last = balance;
            taken += further;
        }
        Ok(self.arrive(pose.time_s, &tip, phase, &last, taken, moving))
    }

    /// Lets the instrument hold the tissue at a place, and says how many steps that is worth.
    pub(super) fn set_out(&mut self, time_s: f64, tip: &Tip) -> Move {
        let Some(contact) = &mut self.contact else {
            return Move { travel: [0.0; 3], moves: false, phase: Phase::Approach, steps: 0 };
        };
        let needle = self.fixed.scene.instrument.as_ref().and_then(|i| i.needle());
        let bevelled = needle.filter(|needle| needle.bevel.is_some()).map_or(0.0, |needle| 0.5 * needle.diameter.get());
        let turned = bevelled * (tip.roll - self.progress.roll).sin().abs();
        let moved: [f64; 3] = std::array::from_fn(|k| tip.offset[k] - self.progress.tip[k]);
        self.solver.begin_cut();
        let (phase, event) = contact.impose(tip, &mut self.solver);
        // a membrane that is pressed holds all of the tissue off the needle
        let slips = matches!(contact, Contact::Frictional(needle) if needle.region().is_some());
        let bent = contact.shaft().map_or(0.0, Bending::moved);
        self.happened.see(event, tip, phase, self.contact.as_ref(), &self.fixed.along);
        // a needle that tilts moves the tissue even if its tip stays
        let shaft = tip.axis_at(0.0);
        let swung = [0, 1].map(|k| shaft[k] - self.progress.shaft[k]);
        let distance = moved.iter().map(|x| x * x).sum::<f64>().sqrt().max(swung[0].hypot(swung[1]));
        // sideways the middle of what is in the tissue counts
        let middle = [0.5 * (moved[0] + swung[0]), 0.5 * (moved[1] + swung[1]), -moved[2]];
        // above the surface the instrument moves, but not the tissue
        let apart = phase == Phase::Approach && self.progress.phase == Phase::Approach;
        // a shaft that bends moves it, too, even where its driver stands
        let distance = distance.max(bent).max(turned);
        let (distance, travel) = if apart { (0.0, [0.0; 3]) } else { (distance, middle) };
        let relaxed = self.solver.stress_relaxation(time_s);
        let unpredicted = self.solver.unpredicted(travel);
        let steps = self.progress.pace.steps(distance, unpredicted, self.solver.slowest(), relaxed, slips);
        Move { travel, moves: distance > 0.0, phase, steps }
    }

    /// The answer at a place that needs no step.
    pub(super) fn stay(&mut self, time_s: f64, tip: &Tip, phase: Phase) -> Prediction {
        if self.contact.is_some() {
            self.solver.rest(time_s);
        }
        let balance = self.solver.balance();
        self.arrive(time_s, tip, phase, &balance, 0, false)
    }

    /// The answer after so many steps, the last of them of the motion to the place (`moving`) or at rest.
    pub(super) fn arrive(
        &mut self,
        time_s: f64,
        tip: &Tip,
        phase: Phase,
        balance: &Balance,
        taken: u32,
        moving: bool,
    ) -> Prediction {
        let corrected = |v| self.corrected(v, tip.depth);
        let (force_n, base_force_n) = (corrected(balance.instrument), corrected(balance.base));
        let torque_nm = corrected(self.torque(balance, tip));
        let (template_force_n, template_torque_nm) = self.template(tip);
        let force_n = std::array::from_fn(|k| force_n[k] + template_force_n[k]);
        let torque_nm = std::array::from_fn(|k| torque_nm[k] + template_torque_nm[k]);
        self.happened.close(force_n);
        self.progress.tip = tip.offset;
        self.progress.shaft = tip.axis_at(0.0);
        self.progress.roll = tip.roll;
        self.progress.phase = phase;
        let before = self.progress.steps;
        self.progress.steps += u64::from(taken);
        let steps = self.progress.steps;
        if steps / LOOK > before / LOOK {
            self.progress.constraint_error_m = self.constraint_error();
            let strain = balance.strain.max(self.energy_floor());
            self.progress.folded_energy = self.folds.energy(&self.fixed.tissue, &self.solver, strain);
        }
        if recovered::is_due(before, steps) {
            self.progress.discretisation_error = self.discretisation_error();
        }
        Prediction {
            time_s,
            depth_m: tip.depth,
            force_n,
            base_force_n,
            template_force_n,
            torque_nm,
            phase,
            event: None,
            steps: taken,
            health: self.health(balance, moving),
        }
    }

    fn health(&self, balance: &Balance, moving: bool) -> Health {
        // the approximations are those of a motion
        let known = moving && !matches!(self.contact, Some(Contact::Frictional(_)));
        Health {
            min_jacobian: self.solver.min_jacobian(),
            kinetic_to_strain_energy: self.energies(balance),
            force_imbalance: self.progress.pace.imbalance,
            approximations_apart_n: if known { 2.0 * balance.error_estimate } else { f64::INFINITY },
            constraint_error_m: self.progress.constraint_error_m,
            folded_energy: self.progress.folded_energy,
            discretisation_error: self.progress.discretisation_error,
        }
    }

    /// Estimated error of the discretisation, of the force.
    fn discretisation_error(&mut self) -> f64 {
        match self.correction() {
            Some(correction) if correction.left > 0.0 => correction.left,
            _ => recovered::effectivity(&self.fixed.scene) * self.recovered.share(&self.fixed.tissue, &self.solver),
        }
    }

    /// Moment M of the forces on the instrument about the load cell's origin o, N m: M - o x F, with M about the frame's origin.
    fn torque(&self, balance: &Balance, tip: &Tip) -> [f64; 3] {
        let entry = self.path().entry;
        let start = [entry[0], entry[1], self.fixed.top];
        let cell = self.load_cell(tip);
        let o: [f64; 3] = std::array::from_fn(|k| start[k] + cell[k]);
        let of_force = cross(&o, &balance.instrument);
        std::array::from_fn(|k| balance.moment[k] - of_force[k])
    }

    /// The load cell's origin relative to the entry point, m.
    fn load_cell(&self, tip: &Tip) -> [f64; 3] {
        let height = self.fixed.scene.instrument.map_or(0.0, |i| i.load_cell_height.get());
        let up = [tip.slope[0], tip.slope[1], 1.0];
        let length = up.iter().map(|x| x * x).sum::<f64>().sqrt();
        std::array::from_fn(|k| tip.offset[k] + height * up[k] / length)
    }

    /// Force in N of a template on a needle that it holds as well, and its torque about the load cell in N m: what they take from that.
    fn template(&self, tip: &Tip) -> ([f64; 3], [f64; 3]) {
        let Some((by, at)) = self.contact.as_ref().and_then(Contact::shaft).and_then(Bending::template) else {
            return ([0.0; 3], [0.0; 3]);
        };
        let cell = self.load_cell(tip);
        (by, cross(&std::array::from_fn(|k| at[k] - cell[k]), &by))
    }

    /// Limits the steps per pose to what there is time for: a live twin that can't keep up takes fewer, larger steps rather
    /// than fall behind. Offline only the scene's `stepping.max_steps_per_pose` applies.
    pub fn limit_steps(&mut self, most_per_pose: u32) {
        self.progress.pace.limit = most_per_pose;
    }

    /// Watches a flag: once it is set, a pose that is being computed ends within a few steps with [`Halt::Interrupted`].
    pub fn stop_on(&mut self, flag: Arc<AtomicBool>) {
        self.solver.stop_on(flag);
    }

    /// Angular frequency of the fundamental mode, rad per step.
    #[must_use]
    pub fn slowest(&self) -> f64 {
        self.solver.slowest()
    }

    /// Angular frequency of the fastest mode of the present state, rad per step: the explicit step is stable below 2.
    /// Costs hundreds of evaluations of the internal force; not for the stepping path.
    #[must_use]
    pub fn fastest(&mut self) -> f64 {
        self.solver.fastest(FASTEST_ITERATIONS)
    }

    /// Back to the undeformed state.
    pub fn reset(&mut self) {
        self.undeform();
        self.progress = Progress::new(self.progress.pace.clone());
        self.happened.reset();
        self.begin();
    }

    /// Checks a pose and expresses its tip relative to the entry point.
    pub(super) fn admit(&self, pose: &StampedPose) -> Result<Tip, Halt> {
        let Pose { tip, axis, roll_rad } = pose.pose;
        let refuse = |reason: String| Err(Halt::Pose { reason });
        if !(pose.time_s.is_finite() && tip.iter().chain(&axis).chain([&roll_rad]).all(|x| x.is_finite())) {
            return refuse("it holds a number that is not finite".into());
        }
        let path = self.path();
        let offset = [tip[0] - path.entry[0], tip[1] - path.entry[1], tip[2] - self.fixed.top];
        if let Some(reason) = not_a_place(&offset, pose.time_s) {
            return refuse(reason);
        }
        let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > 1e-3 {
            return refuse(format!("its axis has length {length:.4}, not 1"));
        }
        if let Some(reason) = self.asymmetry(&pose.pose) {
            return refuse(reason);
        }
        let tilt = if self.inserted() { INSERTED_ALIGNMENT } else { ALIGNMENT };
        let own = self.pose_at_depth(0.0).axis;
        if sine(&axis, &own) > tilt || axis[2] >= 0.0 {
            return refuse(format!(
                "its axis ({:.3}, {:.3}, {:.3}) is not that of the scene's instrument, ({:.3}, {:.3}, {:.3}); a tilt of \
                 {tilt} (sine) from that is taken now",
                axis[0], axis[1], axis[2], own[0], own[1], own[2]
            ));
        }
        let depth = self.depth_of(&pose.pose);
        if depth >= self.fixed.reach {
            return refuse(format!(
                "depth {depth:.6} m is beyond {:.6} m, the deepest that this scene's cloud was made for \
                 (motion.depth_m, the sample's height)",
                self.fixed.reach
            ));
        }
        if let Some((at, region)) = self.along().rigid().filter(|(at, _)| depth > *at) {
            return refuse(format!(
                "depth {depth:.6} m is within region \"{region}\", which is rigid and begins at {at:.6} m on this path"
            ));
        }
        let side = (0..2).map(|k| (offset[k] + path.slope[k] * offset[2]).powi(2)).sum::<f64>().sqrt();
        if side > self.side_reach() && depth > 0.0 {
            return refuse(format!(
                "the tip is {side:.6} m beside the scene's path; this scene takes {:.6} m (instrument.entry_x_m, entry_y_m)",
                self.side_reach()
            ));
        }
        let roll = roll_rad;
        if self.dimension() == Dimension::Axisymmetric {
            return Ok(Tip { offset: [0.0, 0.0, offset[2]], depth, slope: [0.0; 2], roll });
        }
        let slope = [axis[0] / axis[2], axis[1] / axis[2], 0.0];
        let Some(mirror) = self.fixed.mirror else {
            return Ok(Tip { offset, depth, slope: [slope[0], slope[1]], roll });
        };
        let [x, y, _] = mirror.within(&slope);
        Ok(Tip { offset: mirror.within(&offset), depth, slope: [x, y], roll })
    }

    /// Why a model with a symmetry can't follow a pose, if it can't.
    fn asymmetry(&self, pose: &Pose) -> Option<String> {
        let Pose { tip, axis, roll_rad } = pose;
        let (beside, tilt, of, model) = match (self.dimension(), &self.fixed.mirror) {
            (Dimension::Axisymmetric, _) => {
                (tip[0].hypot(tip[1]), axis[0].hypot(axis[1]), "the sample's axis", "an axisymmetric model")
            }
            (_, Some(mirror)) => {
                (mirror.across(tip).abs(), mirror.across(axis).abs(), "the plane of symmetry", "a mirrored model")
            }
            _ => return None,
        };
        let most = SYMMETRIC * self.fixed.height;
        let bevelled = self.fixed.scene.instrument.as_ref().and_then(|i| i.needle()).is_some_and(|n| n.bevel.is_some());
        let what = if bevelled && roll_rad.sin().abs() > SYMMETRIC {
            format!("its bevel is turned by {roll_rad:.4} rad out of {of}, and a sine of {SYMMETRIC} is taken")
        } else if tilt > SYMMETRIC {
            format!("its axis leans by {tilt:.4} (sine) from {of}, and {SYMMETRIC} is taken")
        } else if tip[2] < self.fixed.top && beside > most {
            format!("its tip is {beside:.6} m beside {of}, and {most:.6} m is taken")
        } else {
            return None;
        };
        Some(format!("{what} by {model}: set discretisation.dimension = \"full\""))
    }
}

/// Sine of the angle between two unit vectors.
fn sine(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    cross(a, b).iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
