//! Live members: they follow a stream of poses, are updated from the load cell, and predict the next motion.

use super::assimilate::{Assimilation, Observed, Tracked};
use super::course::{against, between};
use super::path::distinct;
use super::together::Together;
use super::{Band, EnsembleError, Member, Spread};
use crate::compare::learning::Swing;
use needle_core::scene::Recorded;
use needle_core::twin::{Halt, Motion, Places, Pose, Prediction, StampedPose, Team, Twin};

/// Function that advances a twin to a pose; [`WayOfTeam`] is the same for a team.
type Way<T> = fn(&mut T, StampedPose) -> Result<Prediction, Halt>;
type WayOfTeam = fn(&mut Team, &mut Places<&mut Twin>, &[StampedPose; Team::MOST]) -> Places<Result<Prediction, Halt>>;

/// Twins of the members. All are advanced in the calling thread.
pub struct Live {
    /// A twin for each run that members share, and by how much its instrument is less deep, m. `None` if the scene
    /// can't be discretised.
    twins: Vec<(Option<Twin>, f64)>,
    /// The twins that are stepped as teams.
    teams: Vec<Together>,
    /// One scratch copy of a twin for each cloud, made at the first look-ahead.
    doubles: Vec<Twin>,
    /// For each member: index of its twin, its force over that of the twin, and the reading of the load cell without
    /// load, N.
    members: Vec<(usize, f64, f64)>,
    /// Force of each twin at the last pose, N; not a number if there is none.
    force_n: Vec<f64>,
    /// Possible error of the force because of oscillating tissue, N: that of the twin that oscillates most.
    swing: Swing,
    doubt_n: f64,
    /// Positions of targets, m.
    positions: Vec<Vec<[f64; 3]>>,
    /// Why a twin has no answer to the last pose; that of the first such twin.
    halt: Option<Halt>,
    /// The last pose.
    last: Option<StampedPose>,
    /// The filter, and the members that had an answer at its first measurement.
    learnt: Option<(Assimilation, Vec<usize>)>,
}

/// The members' predictions for the next part of the motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ahead {
    /// Travel of the tip from the last pose, m; starts at 0.
    pub way_m: Vec<f64>,
    /// Force of each member at each of these positions, N.
    pub forces_n: Vec<Vec<f64>>,
    /// Targets of each member at the first position, m.
    pub targets_now: Vec<Vec<[f64; 3]>>,
    /// Targets of each member at the last position, m.
    pub targets_ahead: Vec<Vec<[f64; 3]>>,
}

/// The members' predictions at a pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Time of the pose, s.
    pub time_s: f64,
    /// Expected reading of the load cell for each member, N; not a number if it has no answer.
    pub forces_n: Vec<f64>,
    /// Targets of each member, m; empty if it has no answer, or if they were not requested.
    pub targets_m: Vec<Vec<[f64; 3]>>,
    /// Possible error of the forces because tissue oscillates, N.
    pub doubt_n: f64,
}

/// Whether members can follow poses live.
///
/// # Errors
/// [`EnsembleError::NotLive`] if the clock of the force is uncertain: its future readings are not known yet.
pub fn check_live(members: &[Member]) -> Result<(), EnsembleError> {
    let late = members.iter().any(|member| member.shift.time_offset_s != 0.0);
    let key = Recorded::KEYS.iter().find(|(_, recorded, _)| *recorded == Recorded::TimeOffset).map(|(key, ..)| *key);
    if late { Err(EnsembleError::NotLive(key.unwrap_or_default())) } else { Ok(()) }
}

impl Live {
    /// Builds a twin for each member. Members with the same mechanics share one. `trouble` is called with the reason
    /// if one can't be built.
    ///
    /// # Errors
    /// [`EnsembleError::Threads`].
    pub fn build(members: &[Member], mut trouble: impl FnMut(usize, String)) -> Result<Self, EnsembleError> {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        let (first, run_of) = distinct(members);
        let mut built = Vec::new();
        for k in first {
            let scene = &members[k].scene;
            let before = || built.iter().find_map(|(twin, _): &(Option<Twin>, f64)| twin.as_ref()?.sibling(scene));
            let twin = alone.install(|| before().map_or_else(|| Twin::new(scene), Ok));
            let twin = twin.map_err(|error| trouble(k, error.to_string())).ok();
            built.push((twin, members[k].shift.contact_depth_m));
        }
        Ok(Self {
            force_n: vec![f64::NAN; built.len()],
            swing: Swing::default(),
            doubt_n: 0.0,
            positions: vec![Vec::new(); built.len()],
            doubles: Vec::new(),
            teams: Together::all_of(&built),
            halt: None,
            last: None,
            learnt: None,
            twins: built,
            members: run_of
                .iter()
                .zip(members)
                .map(|(k, member)| (*k, member.factor, member.shift.force_zero_n))
                .collect(),
        })
    }

    /// Advances every member to a pose of an instrument that is tracked. A twin without an answer stays so until it
    /// recovers automatically ([`Twin::follow`]).
    pub fn follow(&mut self, pose: &StampedPose) {
        self.advance(pose, Twin::follow, Team::follow);
    }

    /// Advances every member to a pose, whatever the distance ([`Twin::step`]).
    pub fn step(&mut self, pose: &StampedPose) {
        self.advance(pose, Twin::step, Team::step);
    }

    fn advance(&mut self, pose: &StampedPose, alone: Way<Twin>, together: WayOfTeam) {
        (self.last, self.halt) = (Some(*pose), None);
        for t in 0..self.teams.len() {
            let of_team = &self.teams[t].places;
            let mut poses = [*pose; Team::MOST];
            of_team.iter().zip(&mut poses).for_each(|(k, pose)| *pose = moved(pose, -self.twins[*k].1));
            let mut twins = [const { None }; Team::MOST];
            for (k, (twin, _)) in self.twins.iter_mut().enumerate() {
                if let Some(place) = of_team.iter().position(|own| *own == k) {
                    twins[place] = twin.as_mut();
                }
            }
            let answers = together(&mut self.teams[t].team, &mut twins, &poses);
            for (place, answer) in answers.into_iter().enumerate() {
                if let Some(answer) = answer {
                    self.answered(self.teams[t].places[place], pose, answer);
                }
            }
        }
        for k in 0..self.twins.len() {
            if self.teams.iter().any(|team| team.places.contains(&k)) {
                continue;
            }
            let (twin, shallower_m) = &mut self.twins[k];
            if let Some(twin) = twin {
                let answer = alone(twin, moved(pose, -*shallower_m));
                self.answered(k, pose, answer);
            }
        }
    }

    /// Stores the answer of one twin.
    fn answered(&mut self, k: usize, pose: &StampedPose, answer: Result<Prediction, Halt>) {
        self.force_n[k] = answer.as_ref().map_or(f64::NAN, |p| against(p, pose));
        if let Ok(prediction) = &answer {
            self.doubt_n = self.swing.see(pose.time_s, self.force_n[k], &prediction.health);
        }
        self.halt = self.halt.take().or(answer.err());
        self.positions[k].clear();
        if let (Some(twin), true) = (&self.twins[k].0, self.force_n[k].is_finite()) {
            twin.target_positions(&mut self.positions[k]);
        }
    }

    /// Expected reading of the load cell at the last pose for each member, N, positive against the insertion. Not a
    /// number if the member has no answer.
    pub fn forces(&self) -> impl Iterator<Item = f64> {
        self.members.iter().map(|(k, factor, zero)| factor * self.force_n[*k] + zero)
    }

    /// Why there is no answer to the last pose; that of the first such twin.
    #[must_use]
    pub const fn halt(&self) -> Option<&Halt> {
        self.halt.as_ref()
    }

    /// The members' predictions at the last pose, with their targets if requested.
    #[must_use]
    pub fn told(&self, with_targets: bool) -> Told {
        let targets_m = match with_targets {
            true => self.members.iter().map(|(k, ..)| self.positions[*k].clone()).collect(),
            false => Vec::new(),
        };
        let time_s = self.last.map_or(f64::NAN, |pose| pose.time_s);
        Told { time_s, forces_n: self.forces().collect(), targets_m, doubt_n: self.doubt_n }
    }

    /// The filter and its members. Before the first measurement these are the members that have an answer now.
    fn learning(&mut self, told: &Told) -> Option<&mut (Assimilation, Vec<usize>)> {
        if self.learnt.is_none() {
            let used: Vec<usize> = (0..told.forces_n.len()).filter(|k| told.forces_n[*k].is_finite()).collect();
            self.learnt = Assimilation::new(used.len()).map(|filter| (filter, used));
        }
        self.learnt.as_mut()
    }

    /// Assimilates a reading of the load cell at the pose of these predictions. Returns false if the reading is not
    /// used, because a member of the filter had no answer then.
    pub fn measured(&mut self, measured_n: f64, told: &Told) -> bool {
        let Some((filter, used)) = self.learning(told) else { return false };
        let members_n: Vec<f64> = used.iter().map(|k| told.forces_n[*k]).collect();
        let complete = members_n.iter().all(|f| f.is_finite()) && measured_n.is_finite();
        if complete {
            filter.take(&Observed { time_s: told.time_s, measured_n, members_n, doubt_n: told.doubt_n });
        }
        complete
    }

    /// Assimilates positions of the targets, m (not a number if one was not seen), measured at a fraction `share` of
    /// the interval between two poses. Returns false if they are not used, because a member of the filter has no
    /// answer.
    pub fn tracked(&mut self, measured_m: &[[f64; 3]], from: &Told, to: &Told, share: f64) -> bool {
        let Some((filter, used)) = self.learning(from) else { return false };
        let of_member = |k: &usize| {
            let both = from.targets_m.get(*k).zip(to.targets_m.get(*k));
            both.map(|(a, b)| between(a, b, share)).filter(|places| places.len() == measured_m.len())
        };
        let Some(members_m) = used.iter().map(of_member).collect() else { return false };
        let time_s = from.time_s + share * (to.time_s - from.time_s);
        filter.track(&Tracked { time_s, measured_m: measured_m.to_vec(), members_m });
        true
    }

    /// The filter, once a load cell or tracked points were assimilated.
    #[must_use]
    pub fn assimilation(&self) -> Option<&Assimilation> {
        self.learnt.as_ref().map(|(filter, _)| filter)
    }

    /// Band of the force at the last pose, with the number of members that have an answer; `None` without answers.
    /// After assimilation it is the band of the next reading of the load cell.
    #[must_use]
    pub fn band(&self) -> Option<(Band, usize)> {
        let all: Vec<f64> = self.forces().collect();
        let count = all.iter().filter(|f| f.is_finite()).count();
        if let Some((filter, used)) = &self.learnt {
            let of_members = used.iter().map(|k| all[*k]).collect();
            let time_s = self.last.map_or(f64::NAN, |pose| pose.time_s);
            let (members_n, doubt_n) = (of_members, self.doubt_n);
            let forecast = filter.forecast(&Observed { time_s, measured_n: f64::NAN, members_n, doubt_n });
            return forecast.map(|f| (Band::normal(f.mean_n, f.standard_deviation_n), count));
        }
        Band::of(all.into_iter()).map(|band| (band, count))
    }

    /// Each target at the last pose, in the scene's order; empty without an answer.
    #[must_use]
    pub fn targets(&self) -> Vec<Spread> {
        let places = self.places(&self.positions);
        let count = places.iter().map(Vec::len).max().unwrap_or(0);
        (0..count).filter_map(|t| Spread::of(places.iter().filter_map(|of| of.get(t).copied()))).collect()
    }

    /// Predictions of every member for the next part of the motion. `None` without a pose, without an answer, or if a
    /// member of the filter has none.
    pub fn ahead(&mut self, motion: &Motion) -> Option<Ahead> {
        let from = self.last?;
        let mut forces: Vec<Vec<f64>> = Vec::new();
        let mut positions: Vec<Vec<[f64; 3]>> = Vec::new();
        let mut way = Vec::new();
        let places = motion.poses as usize;
        for (k, (twin, shallower_m)) in self.twins.iter().enumerate() {
            let (mut force, mut targets) = (vec![f64::NAN; places + 1], Vec::new());
            if let (Some(twin), true) = (twin, self.force_n[k].is_finite()) {
                let double = double_of(&mut self.doubles, twin);
                double.take_over(twin);
                if double.look_ahead(&moved(&from, -*shallower_m), motion, &mut way).is_ok() {
                    force[0] = self.force_n[k];
                    force[1..].iter_mut().zip(&way).for_each(|(f, p)| *f = against(p, &from));
                    double.target_positions(&mut targets);
                }
            }
            forces.push(force);
            positions.push(targets);
        }
        let at = |place: usize| self.of_members(|k, factor, zero| factor * forces[k][place] + zero);
        let columns: Vec<Vec<f64>> = (0..=places).map(at).collect::<Option<_>>()?;
        let members = columns[0].len();
        if columns.iter().any(|column| column.len() != members) {
            return None;
        }
        Some(Ahead {
            way_m: (0..=places).map(|i| motion.distance_m * i as f64 / places as f64).collect(),
            forces_n: (0..members).map(|m| columns.iter().map(|column| column[m]).collect()).collect(),
            targets_now: self.places(&self.positions),
            targets_ahead: self.places(&positions),
        })
    }

    /// A quantity of each member with an answer, after the update by measurements. `None` without answers, or if a
    /// member of the filter has none.
    fn of_members(&self, value: impl Fn(usize, f64, f64) -> f64) -> Option<Vec<f64>> {
        let all: Vec<f64> = self.members.iter().map(|&(k, factor, zero)| value(k, factor, zero)).collect();
        let Some((filter, used)) = &self.learnt else {
            let finite: Vec<f64> = all.into_iter().filter(|x| x.is_finite()).collect();
            return (!finite.is_empty()).then_some(finite);
        };
        let of_used: Vec<f64> = used.iter().map(|k| all[*k]).collect();
        of_used.iter().all(|x| x.is_finite()).then(|| filter.analysed(&of_used))
    }

    /// Positions of the targets of each member, after the update by measurements.
    fn places(&self, positions: &[Vec<[f64; 3]>]) -> Vec<Vec<[f64; 3]>> {
        let count = positions.iter().map(Vec::len).max().unwrap_or(0);
        let coordinate = |t: usize, c: usize| {
            self.of_members(|k, _, _| positions[k].get(t).map_or(f64::NAN, |p| p[c])).unwrap_or_default()
        };
        let columns: Vec<[Vec<f64>; 3]> = (0..count).map(|t| [0, 1, 2].map(|c| coordinate(t, c))).collect();
        let members = columns.iter().flatten().map(Vec::len).min().unwrap_or(0);
        (0..members).map(|m| columns.iter().map(|xyz| [0, 1, 2].map(|c| xyz[c][m])).collect()).collect()
    }

    /// Resets all members to the undeformed state, and the filter.
    pub fn reset(&mut self) {
        self.twins.iter_mut().filter_map(|(twin, _)| twin.as_mut()).for_each(Twin::reset);
        self.force_n.fill(f64::NAN);
        self.positions.iter_mut().for_each(Vec::clear);
        (self.halt, self.last, self.learnt) = (None, None, None);
        (self.swing, self.doubt_n) = (Swing::default(), 0.0);
    }
}

/// The scratch copy for the cloud of a twin; it is made at the first use.
fn double_of<'a>(doubles: &'a mut Vec<Twin>, twin: &Twin) -> &'a mut Twin {
    let place = doubles.iter().position(|double| double.is_sibling_of(twin)).unwrap_or_else(|| {
        doubles.push(twin.double());
        doubles.len() - 1
    });
    &mut doubles[place]
}

/// A pose with the instrument advanced along its axis by a distance, m.
fn moved(pose: &StampedPose, by_m: f64) -> StampedPose {
    let Pose { tip, axis, .. } = pose.pose;
    StampedPose { pose: Pose { tip: std::array::from_fn(|i| tip[i] + by_m * axis[i]), ..pose.pose }, ..*pose }
}
