//! Sensitivity of a prediction to the uncertain keys: Sobol's indices of peak force and of each target's
//! displacement.
//!
//! The runs are those of an ensemble at the points of a design (`sobol`); members with the same mechanics share a
//! run. If a folder is given, the results are stored there. So parts of a study can run on different machines, and an
//! interrupted study continues.

pub(crate) mod sobol;

use std::io;
use std::path::Path;

use serde::Serialize;

use needle_core::scene::Scene;
use needle_estimate::cache::Cache;
use needle_estimate::compare::ensemble::{Crew, EnsembleError, Member, MemberPath, distinct, paths};
use needle_recording::Reading;
use sobol::{Indices, design, indices};

/// Result of a study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensitivity {
    /// Name of the scene.
    pub scene: String,
    /// Number of base points of the design. Each takes as many members as there are keys, plus two.
    pub points: usize,
    /// Number of base points that were left out because a member's run did not complete.
    pub left_out: usize,
    /// Number of runs of a twin.
    pub runs: usize,
    /// Seed of the points.
    pub seed: u64,
    /// Peak force, then each target's displacement.
    pub outputs: Vec<Output>,
}

/// Sensitivity of one predicted number.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Output {
    /// `peak_force_n`, or `displacement_m.TARGET`.
    pub name: String,
    /// Mean over the priors.
    pub mean: f64,
    /// Standard deviation over the priors.
    pub standard_deviation: f64,
    /// One entry for each key of `[uncertainty]`.
    pub keys: Vec<KeyIndices>,
}

/// Indices of one key.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KeyIndices {
    /// Dotted path.
    pub key: String,
    /// First-order index: share of the variance that knowledge of the key alone would remove.
    pub first: f64,
    /// Its standard error, from resampling the points.
    pub first_standard_error: f64,
    /// Total index: share of the variance that remains if all other keys are known.
    pub total: f64,
    /// Its standard error.
    pub total_standard_error: f64,
}

/// Members at the points of a design.
///
/// # Errors
/// [`EnsembleError`] if no key is uncertain, keys are correlated, or a draw is not a valid value of its key.
pub fn members(scene: &Scene, points: usize, seed: u64) -> Result<Vec<Member>, EnsembleError> {
    let keys = scene.uncertainty.len();
    needle_estimate::compare::ensemble::check(scene, points, 2 * keys)?;
    if let Some(one) = scene.uncertainty.iter().find(|one| !one.correlation.is_empty()) {
        return Err(EnsembleError::Dependent(one.key.clone()));
    }
    let row = |(k, shares): (usize, Vec<f64>)| Member::new(scene, shares, &format!("member {k} of [uncertainty]"));
    design(keys, points, seed).into_iter().enumerate().map(row).collect()
}

/// Results of a member: peak force, N, then each target's displacement, m; empty if its run did not complete.
pub(crate) type Figures = Vec<f64>;

/// Folder of the stored results.
const FOLDER: &str = "members";
/// Runs per thread between two times of storing.
const AT_ONCE: usize = 2;

/// The runs of a study.
#[derive(Debug)]
pub struct Runs<'a> {
    scene: &'a Scene,
    members: &'a [Member],
    readings: &'a [Reading],
    /// Index of each member's run.
    run_of: Vec<usize>,
    /// Results of each member, if they are known.
    figures: Vec<Option<Figures>>,
    /// Store of the results, and the text that identifies each member's.
    kept: Option<(Cache, Vec<String>)>,
}

impl<'a> Runs<'a> {
    /// The runs of [`members`] of a scene over readings. Results that are stored below `folder` are read.
    #[must_use]
    pub fn new(scene: &'a Scene, members: &'a [Member], readings: &'a [Reading], folder: Option<&Path>) -> Self {
        let run_of = distinct(members).1;
        let kept = folder.map(|folder| (Cache::below(folder, FOLDER), names(scene, members, readings)));
        let known = |k: usize| kept.as_ref().and_then(|(kept, names)| kept.get(&names[k])?.pop());
        let figures = (0..members.len()).map(known).collect();
        Self { scene, members, readings, run_of, figures, kept }
    }

    /// Number of runs.
    #[must_use]
    pub fn count(&self) -> usize {
        self.run_of.iter().max().map_or(0, |last| last + 1)
    }

    /// The runs without a result among those for which `has` is true; its argument is the index of the run.
    #[must_use]
    pub fn left(&self, has: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut left: Vec<usize> =
            (0..self.members.len()).filter(|k| self.figures[*k].is_none()).map(|k| self.run_of[k]).collect();
        left.sort_unstable();
        left.dedup();
        left.retain(|run| has(*run));
        left
    }

    /// Makes runs, and stores their results in batches. After an interruption the completed batches remain.
    ///
    /// # Errors
    /// [`RunsError`] if no thread can be started, or results can't be stored.
    pub fn make(&mut self, runs: &[usize], crew: &Crew) -> Result<(), RunsError> {
        for runs in runs.chunks(AT_ONCE * crew.threads.max(1)) {
            let mine: Vec<usize> = (0..self.members.len()).filter(|k| runs.contains(&self.run_of[*k])).collect();
            let members: Vec<Member> = mine.iter().map(|k| self.members[*k].clone()).collect();
            let found = paths(&members, self.readings, crew)?;
            for (k, path) in mine.into_iter().zip(found.of_member) {
                if path.is_err() && crew.cancel.is_cancelled() {
                    continue;
                }
                let figures = path.as_ref().map_or_else(|_| Vec::new(), |path| figures(self.scene, path));
                if let Some((kept, names)) = &self.kept {
                    kept.put(&names[k], std::slice::from_ref(&figures)).map_err(RunsError::Cache)?;
                }
                self.figures[k] = Some(figures);
            }
            if crew.cancel.is_cancelled() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// The indices for the number of points and the seed of the members. A point with an incomplete member is left
    /// out.
    #[must_use]
    pub fn sensitivity(&self, [points, seed]: [u64; 2]) -> Sensitivity {
        let (keys, points) = (self.scene.uncertainty.len(), points as usize);
        let value = |k: usize, of: usize| self.figures[k].as_ref().and_then(|f| f.get(of).copied()).unwrap_or(f64::NAN);
        let displacements = self.scene.targets.iter().map(|target| format!("displacement_m.{}", target.name));
        let names: Vec<String> = std::iter::once("peak_force_n".to_owned()).chain(displacements).collect();
        let is_there = |k: usize| (0..names.len()).all(|of| value(k, of).is_finite());
        let kept: Vec<usize> =
            (0..points).filter(|j| (0..keys + 2).all(|block| is_there(block * points + j))).collect();
        let output = |(of, name): (usize, &String)| {
            let column = |block: usize| kept.iter().map(|j| value(block * points + j, of)).collect();
            let found = indices(&(0..keys + 2).map(column).collect::<Vec<Vec<f64>>>())?;
            Some(Output::new(name, self.scene, found))
        };
        Sensitivity {
            scene: self.scene.name.clone(),
            points,
            left_out: points - kept.len(),
            runs: self.count(),
            seed,
            outputs: names.iter().enumerate().filter_map(output).collect(),
        }
    }
}

/// Why runs can't be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunsError {
    /// An error of the members.
    #[error(transparent)]
    Ensemble(#[from] EnsembleError),
    /// Results can't be stored.
    #[error("what a run has said can't be kept in the folder: {0}; free its disk, or give another --out")]
    Cache(io::Error),
}

/// Everything that the results of each member depend on: program, member, readings, targets.
fn names(scene: &Scene, members: &[Member], readings: &[Reading]) -> Vec<String> {
    let common = xxhash_rust::xxh3::xxh3_128(format!("{readings:?} {:?}", scene.targets).as_bytes());
    let name = |member: &Member| format!("{} {common:032x} {member:?}", needle_core::WRITER);
    members.iter().map(name).collect()
}

fn figures(scene: &Scene, path: &MemberPath) -> Figures {
    let displacement = |(t, target): (usize, &needle_core::scene::Target)| {
        let at = path.targets.get(t).copied().unwrap_or([f64::NAN; 3]);
        let [x, y, z] = target.position;
        (at[0] - x).hypot(at[1] - y).hypot(at[2] - z)
    };
    std::iter::once(peak_n(path)).chain(scene.targets.iter().enumerate().map(displacement)).collect()
}

/// Force of the largest magnitude, with its sign, N.
fn peak_n(path: &MemberPath) -> f64 {
    let finite = path.force_n.iter().copied().filter(|f| f.is_finite());
    finite.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN)
}

impl Output {
    fn new(name: &str, scene: &Scene, found: Indices) -> Self {
        let key = |(i, one): (usize, &needle_core::scene::Uncertain)| KeyIndices {
            key: one.key.clone(),
            first: found.first[i].value,
            first_standard_error: found.first[i].error,
            total: found.total[i].value,
            total_standard_error: found.total[i].error,
        };
        Self {
            name: name.to_owned(),
            mean: found.mean,
            standard_deviation: found.variance.sqrt(),
            keys: scene.uncertainty.iter().enumerate().map(key).collect(),
        }
    }
}
