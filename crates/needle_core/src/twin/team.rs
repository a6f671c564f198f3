//! Siblings that take their poses together: the internal forces of up to eight are evaluated at once (`solver::team`).
//!
//! All else is each twin's own, the number of its steps as well, so a twin that can't go with the others takes its pose alone: one that
//! was lost, or has a jump to make in strides. Trouble is a twin's own too: it goes back and tries again by itself, while the others'
//! answers stand.

use crate::instrument::{Contact, Tip};
use mtled::solver::{self, Solver};

use super::step::Move;
use super::{Halt, Prediction, StampedPose, Twin};

/// What siblings need to take their poses together.
#[derive(Debug)]
pub struct Team(solver::Team);

/// Something of each place of a team; `None` where nobody takes part.
pub type Places<T> = [Option<T>; Team::MOST];

/// Those that are on their way to a pose, and how.
type OnTheirWay = Places<(Tip, Move)>;

impl Team {
    /// Most twins of a team.
    pub const MOST: usize = solver::Team::MOST;

    /// A team of up to eight siblings ([`Twin::sibling`]), who keep their places in it; `None` for twins that are none, for a needle with
    /// friction, for an own instrument, for different laws, and for one that relaxes or has the logarithmic energy of volume. Of another
    /// team on the same cloud it shares what it can.
    #[must_use]
    pub fn new(twins: &[&Twin], beside: Option<&Self>) -> Option<Self> {
        if twins.iter().any(|twin| matches!(twin.contact, None | Some(Contact::Frictional(_) | Contact::Own(_)))) {
            return None;
        }
        let solvers: Vec<&Solver> = twins.iter().map(|twin| &twin.solver).collect();
        solver::Team::new(&solvers, beside.map(|team| &team.0)).map(Self)
    }

    /// [`Twin::follow`] of each twin, to a pose of its own.
    ///
    /// Allocates nothing, takes no lock, and stays on the caller's thread.
    pub fn follow(
        &mut self,
        twins: &mut Places<&mut Twin>,
        poses: &[StampedPose; Self::MOST],
    ) -> Places<Result<Prediction, Halt>> {
        self.walk(twins, poses, Twin::admit_next)
    }

    /// [`Twin::step`] of each twin.
    pub fn step(
        &mut self,
        twins: &mut Places<&mut Twin>,
        poses: &[StampedPose; Self::MOST],
    ) -> Places<Result<Prediction, Halt>> {
        self.walk(twins, poses, Twin::admit)
    }

    fn walk(
        &mut self,
        twins: &mut Places<&mut Twin>,
        poses: &[StampedPose; Self::MOST],
        admit: fn(&Twin, &StampedPose) -> Result<Tip, Halt>,
    ) -> Places<Result<Prediction, Halt>> {
        let (mut answers, mut ways) = ([const { None }; Self::MOST], [None; Self::MOST]);
        for (k, twin) in twins.iter_mut().enumerate() {
            let Some(twin) = twin else { continue };
            match admit(twin, &poses[k]) {
                Ok(tip) if twin.goes_at_once(&tip) => {
                    twin.happened.begin();
                    ways[k] = Some((tip, twin.set_out(poses[k].time_s, &tip)));
                }
                Ok(_) => answers[k] = Some(twin.step(poses[k])),
                Err(halt) => answers[k] = Some(Err(halt)),
            }
        }
        self.advance(twins, poses, &ways);
        for (k, twin) in twins.iter_mut().enumerate() {
            if let (Some(twin), Some((tip, way))) = (twin, &ways[k]) {
                let outcome = twin.end(poses[k].time_s, tip, way);
                answers[k] = Some(twin.close(poses[k].time_s, tip.depth, outcome));
            }
        }
        answers
    }

    /// Takes the steps of all that are on their way.
    fn advance(&mut self, twins: &mut Places<&mut Twin>, poses: &[StampedPose; Self::MOST], ways: &OnTheirWay) {
        let steps = ways.map(|way| way.map_or(0, |(_, way)| way.steps));
        let travel = ways.map(|way| way.map_or([0.0; 3], |(_, way)| way.travel));
        let mut places = poses.iter().zip(steps);
        let mut members = twins.each_mut().map(|twin| {
            let (pose, steps) = places.next()?;
            let twin = twin.as_deref_mut().filter(|_| steps > 0)?;
            twin.solver.relax_until(pose.time_s);
            Some(&mut twin.solver)
        });
        self.0.advance(&mut members, &steps, &travel);
    }
}

impl Twin {
    /// Whether a pose is one move, and nothing is in the way of making it with others.
    fn goes_at_once(&self, tip: &Tip) -> bool {
        self.progress.lost.is_none() && self.way(tip).places().next().is_none()
    }

    /// The answer to a pose for which a team has taken the steps.
    fn end(&mut self, time_s: f64, tip: &Tip, way: &Move) -> Result<Prediction, Halt> {
        let mut answer = if way.steps == 0 {
            self.stay(time_s, tip, way.phase)
        } else {
            let balance = self.make_safe(way.steps, tip, way.phase, time_s)?;
            self.progress.pace.judge(&balance, way.moves);
            let left = self.progress.pace.most().saturating_sub(way.steps);
            let calmed = self.calm(&balance, tip, way.phase, time_s, left)?;
            let moving = way.moves && calmed.is_none();
            let (balance, further) = calmed.unwrap_or((balance, 0));
            if further > 0 {
                self.progress.pace.note(&balance);
            }
            self.arrive(time_s, tip, way.phase, &balance, way.steps + further, moving)
        };
        answer.event = self.happened.first();
        Ok(answer)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::scene::{Override, Scene};
    use mtled::solver::{Advance, Role};

    fn depth(team: &mut Team, twins: &mut [Twin], pose: u32) -> Vec<Prediction> {
        let depth_m = 1e-5 * f64::from(pose);
        let at = |twin: &Twin| StampedPose { time_s: 1e-3 * f64::from(pose), pose: twin.pose_at_depth(depth_m) };
        let poses = [at(&twins[0]); Team::MOST];
        let mut all = twins.iter_mut();
        let answers = team.step(&mut std::array::from_fn(|_| all.next()), &poses);
        answers.into_iter().flatten().map(Result::unwrap).collect()
    }

    /// A member that is torn comes back from its saved state, and the others go on as they would without.
    #[test]
    fn trouble_stays_with_the_member_that_has_it() {
        let coarse = [Override::text("discretisation.spacing_m", "0.004", "test")];
        let first = Twin::new(&Scene::preset("compression").unwrap().with(&coarse).unwrap()).unwrap();
        let softer = Override::typed("material.shear_modulus_pa", 1500.0, "test");
        let other = first.scene().with(&[softer]).unwrap();
        let [mut twins, mut control] = [0, 1].map(|_| vec![first.double(), first.sibling(&other).unwrap()]);
        let mut teams = [&twins, &control].map(|t| Team::new(&[&t[0], &t[1]], None).unwrap());
        for pose in 1..100 {
            depth(&mut teams[0], &mut twins, pose);
            depth(&mut teams[1], &mut control, pose);
        }
        // the plate goes through most of the sample at once
        let (through, torn) = (-0.8 * twins[0].fixed.height, &mut twins[0].solver);
        let held: Vec<usize> = (0..torn.roles().len()).filter(|&n| torn.roles()[n] == Role::Instrument).collect();
        held.iter().for_each(|&n| torn.prescribe(n, [0.0, 0.0, through]));
        torn.advance(&Advance { steps: 1, travel: [0.0, 0.0, -through] });
        let (found, expected) = (depth(&mut teams[0], &mut twins, 100), depth(&mut teams[1], &mut control, 100));
        assert!(twins[0].recoveries() > 0 && twins[1].recoveries() == 0);
        // but for when masses are brought up to date
        let [a, b] = [&found, &expected].map(|answers| answers[1].force_n[2]);
        assert!(b > 1e-3 && (a / b - 1.0).abs() < 1e-5, "{a} N, {b} N");
        // and they go on together
        let (mut found, mut expected) = (found, expected);
        for pose in 101..140 {
            found = depth(&mut teams[0], &mut twins, pose);
            expected = depth(&mut teams[1], &mut control, pose);
        }
        for (a, b) in found.iter().zip(&expected) {
            let (a, b) = (a.force_n[2], b.force_n[2]);
            assert!(b > 1e-3 && (a / b - 1.0).abs() < 0.05, "{a} N, {b} N without the trouble");
        }
    }
}
