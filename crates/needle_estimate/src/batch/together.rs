//! Fits all recordings of one sample jointly, with every candidate.

use serde::{Deserialize, Serialize};

use super::{Job, Key};
use crate::calibrate::{Joint, calibrate_together};
use crate::compare::Cancel;
use needle_recording::Recording;
use xxhash_rust::xxh3::Xxh3;

/// The joint fit of a sample with one candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointFit {
    /// Name of the candidate.
    pub candidate: String,
    /// Reason of the failure, if it failed; the other fields are then empty.
    pub failed: Option<String>,
    /// Shared keys. `noise_error` is the standard error from noise and from the differences between the recordings.
    pub keys: Vec<Key>,
    /// For each recording: name, contact depth (m), zero of the load cell (N), root mean square residual (N).
    pub own: Vec<(String, f64, f64, f64)>,
    /// Number of runs of the twin.
    pub runs: u32,
}

/// The joint fits of a sample with every candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SampleRow {
    /// The sample.
    pub name: String,
    /// Hash of everything that it depends on.
    pub fingerprint: String,
    /// One per candidate.
    pub fits: Vec<JointFit>,
}

/// The recordings of a sample.
#[derive(Clone, Debug)]
pub struct SampleJob<'a> {
    /// The sample.
    pub name: &'a str,
    /// Its recordings.
    pub jobs: Vec<Job<'a>>,
}

impl<'a> SampleJob<'a> {
    /// The samples of a manifest that request a joint fit, in its order.
    #[must_use]
    pub fn all(jobs: &[Job<'a>]) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for job in jobs.iter().filter(|job| job.manifest.recordings[job.number].together == Some(true)) {
            let name = job.manifest.recordings[job.number].sample.as_deref().unwrap_or_default();
            match all.iter_mut().find(|sample| sample.name == name) {
                Some(sample) => sample.jobs.push(*job),
                None => all.push(Self { name, jobs: vec![*job] }),
            }
        }
        all
    }

    /// Fingerprint over all its recordings.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let mut hash = Xxh3::new();
        self.jobs.iter().for_each(|job| hash.update(job.fingerprint().as_bytes()));
        format!("{:032x}", hash.digest128())
    }

    /// Computes the row. A recording that can't be read is left out; its own row states the reason.
    #[must_use]
    pub fn run(&self, cancel: &Cancel) -> SampleRow {
        let open = |job: &Job<'a>| Some((*job, Recording::open(&job.files(), &job.entry().selection()).ok()?));
        let opened: Vec<(Job, Recording)> = self.jobs.iter().filter_map(open).collect();
        let candidates = self.jobs.first().map_or(&[][..], |job| &job.manifest.candidates);
        let fit = |candidate: &super::Candidate| {
            let prepared = |(job, recording): &(Job<'a>, Recording)| {
                Some((job.name().to_owned(), job.prepared(candidate, recording).ok()?))
            };
            let all: Vec<_> = opened.iter().filter_map(prepared).collect();
            let tasks: Vec<_> = all.iter().map(|(_, prepared)| prepared.task()).collect();
            let names = all.iter().map(|(name, _)| name.clone());
            let found = calibrate_together(&tasks, cancel).map_err(|e| e.to_string());
            fit_of(&candidate.name, names, found)
        };
        SampleRow {
            name: self.name.to_owned(),
            fingerprint: self.fingerprint(),
            fits: candidates.iter().map(fit).collect(),
        }
    }
}

fn fit_of(candidate: &str, names: impl Iterator<Item = String>, found: Result<Joint, String>) -> JointFit {
    let candidate = candidate.to_owned();
    match found {
        Err(reason) => JointFit { candidate, failed: Some(reason), keys: Vec::new(), own: Vec::new(), runs: 0 },
        Ok(found) => {
            let key = |k: &crate::calibrate::JointKey| Key {
                key: k.key.clone(),
                value: k.value,
                standard_error: k.standard_error,
                noise_error: k.standard_error,
            };
            let own = names.zip(&found.own).map(|(name, o)| (name, o.contact_depth_m, o.force_zero_n, o.rmse_n));
            JointFit {
                candidate,
                failed: (!found.converged).then(|| "the search ran out of steps".to_owned()),
                keys: found.keys.iter().map(key).collect(),
                own: own.collect(),
                runs: found.runs,
            }
        }
    }
}
