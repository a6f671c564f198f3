//! Ensembles: many twins of one scene with different values of the uncertain keys. They give the band of the force.
//!
//! Each member is a twin with the values of one low-discrepancy point of `[uncertainty]`, and answers the same
//! readings. So member k computes the same bits as a single run of its scene, whatever else runs at the same time.
//! Members that have the same cloud share it ([`Twin::sibling`](needle_core::twin::Twin::sibling)). Members with the
//! same mechanics share a run (`path`). Each run uses one thread.

pub mod assimilate;
mod band;
mod crew;
mod error;
mod live;
mod member;
mod path;
pub mod points;
mod together;

pub use assimilate::{Assimilated, Assimilation};
pub use band::{Band, Spread};
pub use crew::Crew;
pub use error::EnsembleError;
pub use live::{Ahead, Live, Told, check_live};
pub use member::Shift;
pub use member::{Member, check, members};
pub use path::{MemberPath, Paths, distinct, paths, tracked_paths};

use std::time::Instant;

use super::Run;
use super::rows::at_rest;
use assimilate::{Observed, Tracked};
use needle_core::scene::{Scene, Uncertain};
use needle_core::twin::Twin;
use needle_recording::{MarkerSample, Reading};

/// Result of an ensemble for a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ensemble {
    /// Number of members that were requested.
    pub members: usize,
    /// Number of members that completed their run. The others are left out of all results.
    pub used: usize,
    /// Number of runs of a twin.
    pub runs: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Keys that were drawn.
    pub keys: Vec<Uncertain>,
    /// Band of the force at each answer of the run; `None` if no member has an answer.
    pub bands: Vec<Option<Band>>,
    /// Depth to which [`Ensemble::targets`] refer, the largest of the run, m.
    pub target_depth_m: f64,
    /// Each target of the scene at that depth; empty if no member reached it.
    pub targets: Vec<Spread>,
    /// Data assimilation, if there were measurements: the answers that the load cell's readings belong to, and the
    /// result.
    pub assimilated: Option<(Vec<usize>, Assimilated)>,
    /// Wall time of all members, building included, s.
    pub wall_s: f64,
}

impl Ensemble {
    /// Mean width of the band, N; `None` without a band.
    #[must_use]
    pub fn mean_width_n(&self) -> Option<f64> {
        let widths: Vec<f64> = self.bands.iter().flatten().map(|band| band.high_n - band.low_n).collect();
        (!widths.is_empty()).then(|| widths.iter().sum::<f64>() / widths.len() as f64)
    }

    /// Share of a run's measured forces inside the band; `None` without measured forces.
    #[must_use]
    pub fn share_inside(&self, run: &Run) -> Option<f64> {
        let both =
            |(a, band): (&super::Answer, &Option<Band>)| Some((a.measured_n.filter(|m| m.is_finite())?, (*band)?));
        let inside: Vec<bool> =
            run.answers.iter().zip(&self.bands).filter_map(both).map(|(measured, band)| band.holds(measured)).collect();
        (!inside.is_empty()).then(|| inside.iter().filter(|i| **i).count() as f64 / inside.len() as f64)
    }
}

/// Size of an ensemble, and the seed of its draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Number of members.
    pub members: usize,
    /// Seed.
    pub seed: u64,
}

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

impl Run {
    /// What is drawn about the force at an answer, N: the ends of the members' band, or else the force less and plus its model's error.
    #[must_use]
    pub fn shown_band(&self, answer: usize) -> Option<[f64; 2]> {
        if self.ensemble.is_some() {
            return self.band(answer).map(|band| [band.low_n, band.high_n]);
        }
        let super::Answer { predicted_n, model_error_n, .. } = *self.answers.get(answer)?;
        Some([predicted_n - model_error_n, predicted_n + model_error_n])
            .filter(|ends| ends.iter().all(|f| f.is_finite()))
    }

    /// What that band is, in words.
    #[must_use]
    pub const fn band_name(&self) -> &'static str {
        if self.ensemble.is_some() { "95 % of members" } else { "error of the model" }
    }

    /// Band of the force at an answer, if there is an ensemble.
    #[must_use]
    pub fn band(&self, answer: usize) -> Option<Band> {
        self.ensemble.as_ref()?.bands.get(answer).copied().flatten()
    }
}
