//! Members that are stepped as a team ([`Team`]).
//!
//! A member has the same bits in a team as alone, so the grouping affects only the time. A team uses one thread. It
//! costs about as much as [`FEWEST`] members with a twin each, whatever its size.

use super::Member;
use super::course::{Course, INTERRUPTED, MemberPath, against, deeper};
use crate::compare::TargetRow;
use crate::compare::session::{not_finite, stamped};
use needle_core::twin::{Halt, Places, Prediction, StampedPose, Team, Twin};

/// Smallest number of members for which a team is faster.
const FEWEST: usize = 5;
/// Groups the runs 0, 1, ..., each group in order. Teams are filled completely, unless threads would be idle. Groups
/// too small for a team run separately.
pub(super) fn groups(runs: usize, threads: usize) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..runs).collect();
    let most = runs.div_ceil(threads.max(1)).clamp(1, Team::MOST);
    let alone = |group: &[usize]| group.iter().map(|k| vec![*k]).collect();
    let worth = |group: &[usize]| if group.len() < FEWEST { alone(group) } else { vec![group.to_vec()] };
    all.chunks(most).flat_map(worth).collect()
}

/// Runs members as one team; `None` if they can't form one.
pub(super) fn run(
    members: &[&Member],
    cloud: Option<&Twin>,
    beside: Option<&Team>,
    course: &Course,
) -> Option<Vec<Result<MemberPath, String>>> {
    if members.len() < FEWEST || course.is_stopped() {
        return None;
    }
    let build = |member: &&Member| cloud?.sibling(&member.scene);
    let mut twins: Vec<Twin> = members.iter().map(build).collect::<Option<_>>()?;
    let mut team = Team::new(&twins.iter().collect::<Vec<_>>(), beside)?;
    let mut runs: Vec<Run> = members.iter().map(|_| Run::new(course.readings.len())).collect();
    twins.iter_mut().for_each(|twin| twin.stop_on(course.cancel.flag()));
    for (i, reading) in course.readings.iter().enumerate() {
        if course.is_stopped() {
            break;
        }
        let of = |k: usize| k.min(members.len() - 1);
        let poses: [StampedPose; Team::MOST] =
            std::array::from_fn(|k| stamped(&twins[of(k)], deeper(reading, -members[of(k)].shift.contact_depth_m)));
        let mut present = twins.iter_mut().zip(&runs).map(|(twin, run)| run.lost.is_none().then_some(twin));
        let mut places: Places<&mut Twin> = std::array::from_fn(|_| present.next().flatten());
        let answers = team.follow(&mut places, &poses);
        for (k, answer) in answers.into_iter().enumerate() {
            if let Some(answer) = answer {
                runs[k].take(i, &twins[k], &poses[k], answer);
            }
        }
    }
    Some(runs.into_iter().map(|run| run.end(course)).collect())
}

/// State of a member's run.
struct Run {
    force_n: Vec<f64>,
    /// Indices of the readings that were answered.
    at: Vec<usize>,
    targets: Vec<TargetRow>,
    /// Time of the first answer, s.
    begin_s: Option<f64>,
    /// Why the run did not complete.
    lost: Option<String>,
}

impl Run {
    fn new(readings: usize) -> Self {
        Self { force_n: vec![f64::NAN; readings], at: Vec::new(), targets: Vec::new(), begin_s: None, lost: None }
    }

    /// Takes the answer to a reading, as [`super::super::Session::run`] does.
    fn take(&mut self, reading: usize, twin: &Twin, pose: &StampedPose, answer: Result<Prediction, Halt>) {
        match answer {
            Ok(answer) if answer.force_n.iter().all(|f| f.is_finite()) => {
                self.force_n[reading] = against(&answer, pose);
                self.at.push(reading);
                self.see_targets(twin, &answer);
            }
            Ok(answer) => self.lost = Some(not_finite(answer.depth_m)),
            Err(Halt::Pose { .. }) => {}
            Err(halt) => self.lost = Some(halt.to_string()),
        }
    }

    fn see_targets(&mut self, twin: &Twin, answer: &Prediction) {
        if !twin.scene().targets.is_empty() {
            let mut positions = Vec::new();
            twin.target_positions(&mut positions);
            let time_s = answer.time_s - *self.begin_s.get_or_insert(answer.time_s);
            self.targets.push(TargetRow { time_s, depth_m: answer.depth_m, positions });
        }
    }

    fn end(self, course: &Course) -> Result<MemberPath, String> {
        match self.lost {
            Some(why) => Err(why),
            None if course.is_stopped() => Err(INTERRUPTED.to_owned()),
            None => Ok(course.path(self.force_n, &self.at, &self.targets)),
        }
    }
}

/// A team of live members.
pub(super) struct Together {
    pub team: Team,
    /// Index of the twin at each place.
    pub places: Vec<usize>,
}

impl Together {
    /// Groups all twins that can form a team.
    pub(crate) fn all_of(twins: &[(Option<Twin>, f64)]) -> Vec<Self> {
        let mut teams: Vec<Self> = Vec::new();
        let mut left: Vec<usize> = (0..twins.len()).filter(|k| twins[*k].0.is_some()).collect();
        while let Some(first) = left.first().and_then(|k| twins[*k].0.as_ref()) {
            let is_sibling = |k: &usize| twins[*k].0.as_ref().is_some_and(|twin| twin.is_sibling_of(first));
            let places: Vec<usize> = left.iter().copied().filter(is_sibling).take(Team::MOST).collect();
            left.retain(|k| !places.contains(k));
            let of_team: Vec<&Twin> = places.iter().filter_map(|k| twins[*k].0.as_ref()).collect();
            let team = if of_team.len() < FEWEST { None } else { Team::new(&of_team, teams.last().map(|t| &t.team)) };
            teams.extend(team.map(|team| Self { team, places }));
        }
        teams
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn teams_are_full_unless_threads_would_be_idle() {
        let sizes = |runs, threads| groups(runs, threads).iter().map(Vec::len).collect::<Vec<_>>();
        assert_eq!(sizes(4, 1), [1; 4]);
        assert_eq!(sizes(12, 2), [6, 6]);
        assert_eq!(sizes(16, 2), [8, 8]);
        assert_eq!(sizes(20, 1), [8, 8, 1, 1, 1, 1]);
        assert_eq!(sizes(21, 2), [8, 8, 5]);
        assert_eq!(sizes(32, 16), [1; 32]);
        assert_eq!(sizes(0, 2), [0; 0]);
        for (runs, threads) in [(37, 2), (100, 3), (1000, 16)] {
            assert_eq!(groups(runs, threads).concat(), (0..runs).collect::<Vec<_>>());
        }
    }
}
