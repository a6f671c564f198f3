//! Ensembles: many twins of one scene with different values of the uncertain keys. They give the band of the force.
//!
//! Each member is a twin with the values of one low-discrepancy point of `[uncertainty]`, and answers the same
//! readings. So member k computes the same bits as a single run of its scene, whatever else runs at the same time.
//! Members that have the same cloud share it ([`Twin::sibling`](needle_core::twin::Twin::sibling)). Members with the
//! same mechanics share a run (`path`). Each run uses one thread.

pub mod assimilate;
mod band;
mod course;
mod crew;
mod error;
mod live;
mod member;
mod path;
pub mod points;
mod result;
mod together;

pub use assimilate::{Assimilated, Assimilation};
pub use band::{Band, Spread};
pub use course::MemberPath;
pub use crew::Crew;
pub use error::EnsembleError;
pub use live::{Ahead, Live, Told, check_live};
pub use member::{Member, Shift, Size, check, members};
pub use path::{Paths, distinct, paths, tracked_paths};
pub use result::Ensemble;

use std::time::Instant;

use super::Run;
use super::rows::at_rest;
use assimilate::{Observed, Tracked};
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use needle_recording::{MarkerSample, Reading};

/// The input of a finished run.
#[derive(Clone, Copy, Debug)]
pub struct Driven<'a> {
    /// All readings of the instrument's position.
    pub readings: &'a [Reading],
    /// Indices of the readings that were answered ([`super::Finished::answered`]).
    pub at: &'a [usize],
    /// Tracked points, in the order of time.
    pub sightings: &'a [MarkerSample],
    /// The twin of that run. Members share its cloud if theirs is the same.
    pub twin: Option<&'a Twin>,
}

/// Runs [`members`] of a scene over the readings of a finished run and adds the result to it. A member that does not
/// complete its run is left out; the run's losses report it.
///
/// # Errors
/// [`EnsembleError::Threads`] if no thread can be started.
pub fn add(
    run: &mut Run,
    scene: &Scene,
    members: &[Member],
    driven: Driven,
    size: Size,
    crew: &Crew,
) -> Result<(), EnsembleError> {
    let begun = Instant::now();
    let Driven { readings, at, sightings, twin } = driven;
    let mut sightings = sightings.to_vec();
    let (before, targets) = (sightings.len(), scene.targets.len());
    sightings.retain(|seen| seen.positions.len() == targets);
    if sightings.len() < before {
        let odd = before - sightings.len();
        run.losses.push(format!(
            "{odd} of {before} sets of tracked points are not used: the scene has {targets} targets, one for each point"
        ));
    }
    let times: Vec<f64> = sightings.iter().map(|seen| seen.time_s).collect();
    let Paths { of_member, runs } = path::paths_beside(members, readings, &times, crew, twin)?;
    let used: Vec<&MemberPath> = of_member.iter().filter_map(|path| path.as_ref().ok()).collect();
    let spread = |t: usize| Spread::of(used.iter().filter_map(|path| path.targets.get(t).copied()));
    let assimilated = measured(run, members, &of_member, Driven { sightings: &sightings, ..driven });
    run.ensemble = Some(Ensemble {
        members: size.members,
        used: used.len(),
        runs,
        seed: size.seed,
        keys: scene.uncertainty.clone(),
        bands: at.iter().map(|&i| Band::of(used.iter().map(|path| path.force_n[i]))).collect(),
        target_depth_m: run.answers.iter().map(|a| a.depth_m).fold(0.0, f64::max),
        targets: (0..scene.targets.len()).filter_map(spread).collect(),
        assimilated,
        wall_s: begun.elapsed().as_secs_f64(),
    });
    let lost: Vec<(usize, &String)> =
        of_member.iter().enumerate().filter_map(|(k, path)| Some((k, path.as_ref().err()?))).collect();
    if let Some((first, why)) = lost.first() {
        let (count, of) = (lost.len(), size.members);
        run.losses.push(format!("{count} of {of} members left out of the ensemble; the first, member {first}: {why}"));
    }
    Ok(())
}

/// Assimilates the measurements, except while the tissue oscillates after it separated from the instrument.
fn measured(
    run: &Run,
    members: &[Member],
    paths: &[Result<MemberPath, String>],
    Driven { readings, at, sightings, .. }: Driven,
) -> Option<(Vec<usize>, Assimilated)> {
    let used: Vec<(&Member, &MemberPath)> =
        members.iter().zip(paths).filter_map(|(member, path)| Some((member, path.as_ref().ok()?))).collect();
    let observed = |(i, at_rest): (usize, bool)| {
        let answer = run.answers.get(i)?;
        let members_n: Vec<f64> = used.iter().map(|(_, path)| path.force_n[at[i]]).collect();
        let measured_n = answer.measured_n.filter(|m| m.is_finite() && at_rest)?;
        let complete = members_n.iter().all(|f| f.is_finite());
        complete.then_some((i, Observed { time_s: answer.time_s, measured_n, members_n, doubt_n: 0.0 }))
    };
    let rests = at_rest(&run.answers);
    let (answers, observed): (Vec<usize>, Vec<Observed>) =
        rests.iter().copied().enumerate().filter_map(observed).unzip();
    let values: Vec<Vec<f64>> = used.iter().map(|(member, _)| member.values.clone()).collect();
    // the time of a run starts at the first reading that was answered
    let begin_s = at.first().and_then(|i| readings.get(*i)).map_or(0.0, |reading| reading.time_s);
    let seen = |(i, seen): (usize, &MarkerSample)| {
        let time_s = seen.time_s - begin_s;
        let next = run.answers.partition_point(|a| a.time_s < time_s);
        let members_m: Option<Vec<_>> = used.iter().map(|(_, path)| path.tracked.get(i)?.clone()).collect();
        let tracked = Tracked { time_s, measured_m: seen.positions.clone(), members_m: members_m? };
        rests.get(next).copied().unwrap_or(false).then_some(tracked)
    };
    let tracked: Vec<Tracked> = sightings.iter().enumerate().filter_map(seen).collect();
    assimilate::assimilate(&observed, &tracked, &values).map(|found| (answers, found))
}
