//! The force along a member's run.
//!
//! The load cell's zero and clock do not change the mechanics, so members that differ in these alone share a run. So
//! do members with the same values (frequent in a design of a sensitivity analysis), and those that differ in a
//! modulus to which the force is proportional.
//!
//! ```text
//! F_k(t) = a_k F(d(t - tau_k) - c_k) + b_k      a: factor, c: contact depth, tau: time offset, b: zero
//! ```

use std::collections::BTreeMap;

use super::course::{Course, INTERRUPTED, MemberPath, deeper};
use super::{Crew, EnsembleError, Member, together};
use crate::compare::{Finished, Keep, Session};
use needle_core::scene::Scene;
use needle_core::twin::{Team, Twin};
use needle_recording::Reading;

/// Paths of several members.
#[derive(Clone, Debug, PartialEq)]
pub struct Paths {
    /// The result of each member, or the reason why its run did not complete.
    pub of_member: Vec<Result<MemberPath, String>>,
    /// Number of runs of a twin.
    pub runs: usize,
}

/// Runs members over readings. Those with a common cloud are stepped as teams, if there are enough of them for the
/// threads. The bits are the same as with a separate twin for each member.
///
/// # Errors
/// [`EnsembleError::Threads`].
pub fn paths(members: &[Member], readings: &[Reading], crew: &Crew) -> Result<Paths, EnsembleError> {
    tracked_paths(members, readings, &[], crew)
}

/// The same with the targets at given times (s, on the readings' clock).
///
/// # Errors
/// [`EnsembleError::Threads`].
pub fn tracked_paths(
    members: &[Member],
    readings: &[Reading],
    times_s: &[f64],
    crew: &Crew,
) -> Result<Paths, EnsembleError> {
    paths_beside(members, readings, times_s, crew, None)
}

/// The same, with a twin whose cloud members share if theirs is the same.
pub(super) fn paths_beside(
    members: &[Member],
    readings: &[Reading],
    times_s: &[f64],
    crew: &Crew,
    twin: Option<&Twin>,
) -> Result<Paths, EnsembleError> {
    let (first, run_of) = distinct(members);
    // if the first member with a cloud can't be built, its own run reports that
    let build = |scene: &Scene| twin.and_then(|twin| twin.sibling(scene)).or_else(|| Twin::new(scene).ok());
    let cloud = if first.len() > 1 { build(&members[first[0]].scene) } else { None };
    let course = Course { readings, times_s, cancel: crew.cancel.clone() };
    let groups = together::groups(first.len(), crew.threads);
    let beside = cloud.as_ref().filter(|_| groups.iter().any(|g| g.len() > 1)).and_then(|c| Team::new(&[c], None));
    let of_group = |g: usize| {
        let members: Vec<&Member> = groups[g].iter().map(|k| &members[first[*k]]).collect();
        let found = together::run(&members, cloud.as_ref(), beside.as_ref(), &course);
        let found = found.unwrap_or_else(|| members.iter().map(|m| mechanics(m, cloud.as_ref(), &course)).collect());
        // a worker thread has reported one of these members as done
        (1..members.len()).for_each(|_| (crew.done)());
        found
    };
    let runs: Vec<Result<MemberPath, String>> = crew.each(groups.len(), of_group)?.into_iter().flatten().collect();
    let of_member = members.iter().zip(run_of).map(|(member, k)| Ok(recorded(member, readings, runs[k].as_ref()?)));
    let of_member = of_member.map(|path: Result<_, &String>| path.map_err(Clone::clone)).collect();
    Ok(Paths { of_member, runs: runs.len() })
}

/// The first member with each distinct mechanics, and for each member the index of its own.
#[must_use]
pub fn distinct(members: &[Member]) -> (Vec<usize>, Vec<usize>) {
    let (mut numbers, mut first) = (BTreeMap::new(), Vec::new());
    let number = |(k, member): (usize, &Member)| {
        let mechanics = (member.scene.to_toml(), member.shift.contact_depth_m.to_bits());
        *numbers.entry(mechanics).or_insert_with(|| {
            first.push(k);
            first.len() - 1
        })
    };
    let run_of = members.iter().enumerate().map(number).collect();
    (first, run_of)
}

/// Runs a member's scene, on the given twin's cloud if that is the same. The result is that of any run of the scene.
fn mechanics(member: &Member, cloud: Option<&Twin>, course: &Course) -> Result<MemberPath, String> {
    let mut cancel = course.cancel.clone();
    if cancel.is_cancelled() {
        return Err(INTERRUPTED.to_owned());
    }
    let session =
        Session::sibling(&member.scene, cloud, "ensemble", Keep::ANSWERS).map_err(|error| error.to_string())?;
    let touched = course.readings.iter().map(|reading| deeper(reading, -member.shift.contact_depth_m));
    let Finished { run, answered: at, .. } = session.run(touched, &mut cancel);
    if let Some(why) = run.diverged {
        return Err(why);
    }
    let mut force_n = vec![f64::NAN; course.readings.len()];
    for (i, answer) in at.iter().zip(&run.answers) {
        force_n[*i] = answer.predicted_n;
    }
    if cancel.is_cancelled() { Err(INTERRUPTED.to_owned()) } else { Ok(course.path(force_n, &at, &run.targets)) }
}

/// Applies the member's zero, clock and factor to a run: the expected readings of the load cell.
fn recorded(member: &Member, readings: &[Reading], run: &MemberPath) -> MemberPath {
    let (tau, zero) = (member.shift.time_offset_s, member.shift.force_zero_n);
    let late =
        |i: usize| if tau == 0.0 { run.force_n[i] } else { at(readings, &run.force_n, readings[i].time_s - tau) };
    MemberPath {
        force_n: (0..readings.len()).map(|i| member.factor * late(i) + zero).collect(),
        targets: run.targets.clone(),
        tracked: run.tracked.clone(),
    }
}

/// Force at a time, interpolated linearly between readings and constant outside.
fn at(readings: &[Reading], force_n: &[f64], time_s: f64) -> f64 {
    let after = readings.partition_point(|reading| reading.time_s < time_s);
    let (Some(next), Some(before)) = (readings.get(after), after.checked_sub(1)) else {
        return force_n.get(after).or(force_n.last()).copied().unwrap_or(f64::NAN);
    };
    let share = (time_s - readings[before].time_s) / (next.time_s - readings[before].time_s);
    force_n[before] + share * (force_n[after] - force_n[before])
}
