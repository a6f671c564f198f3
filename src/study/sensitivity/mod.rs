//! Which uncertain key makes a prediction uncertain: Sobol's indices of peak force and of each target's displacement.
//!
//! The runs are those of an ensemble at the points of a design (`sobol`); members that share their mechanics share a run.

pub mod sobol;

use serde::Serialize;

use crate::compare::Reading;
use crate::compare::ensemble::{Crew, EnsembleError, Member, MemberPath, Paths, paths};
use crate::scene::Scene;
use sobol::{Indices, design, indices};

/// What a study found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensitivity {
    /// Name of the scene.
    pub scene: String,
    /// Base points of the design: each takes as many members as there are keys, and two more.
    pub points: usize,
    /// Base points that had a member without an end: left out.
    pub left_out: usize,
    /// Runs of a twin.
    pub runs: usize,
    /// Seed of the points.
    pub seed: u64,
    /// Peak force, then each target's displacement.
    pub outputs: Vec<Output>,
}

/// Sensitivity of one number that is predicted.
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
    /// Share of the variance that knowing the key alone would take away.
    pub first: f64,
    /// Its standard error by resampling the points.
    pub first_standard_error: f64,
    /// Share of the variance that is left while all other keys are known.
    pub total: f64,
    /// Its standard error.
    pub total_standard_error: f64,
}

/// Members at the points of a design.
///
/// # Errors
/// [`EnsembleError`] if nothing is uncertain, or a draw is no value of its key.
pub fn members(scene: &Scene, points: usize, seed: u64) -> Result<Vec<Member>, EnsembleError> {
    let keys = scene.uncertainty.len();
    crate::compare::ensemble::check(scene, points, 2 * keys)?;
    let row = |(k, shares): (usize, Vec<f64>)| Member::new(scene, shares, &format!("member {k} of [uncertainty]"));
    design(keys, points, seed).into_iter().enumerate().map(row).collect()
}

/// Runs the [`members`] of a scene over readings and takes the indices from what they answer.
///
/// # Errors
/// [`EnsembleError::Threads`] if no thread can be started.
pub fn sensitivity(
    scene: &Scene,
    members: &[Member],
    readings: &[Reading],
    [points, seed]: [u64; 2],
    crew: &Crew,
) -> Result<Sensitivity, EnsembleError> {
    let Paths { of_member, runs } = paths(members, readings, crew)?;
    let (keys, points) = (scene.uncertainty.len(), points as usize);
    let displacement = |t: usize| {
        let [x, y, z] = scene.targets[t].position;
        move |path: &MemberPath| {
            let at = path.targets.get(t).copied().unwrap_or([f64::NAN; 3]);
            (at[0] - x).hypot(at[1] - y).hypot(at[2] - z)
        }
    };
    let mut outputs: Vec<(String, Vec<f64>)> = vec![("peak_force_n".to_owned(), values(&of_member, &peak_n))];
    for (t, target) in scene.targets.iter().enumerate() {
        outputs.push((format!("displacement_m.{}", target.name), values(&of_member, &displacement(t))));
    }
    let kept = |j: &usize| outputs.iter().all(|(_, y)| (0..keys + 2).all(|block| y[block * points + j].is_finite()));
    let kept: Vec<usize> = (0..points).filter(kept).collect();
    let output = |(name, y): &(String, Vec<f64>)| {
        let column = |block: usize| kept.iter().map(|j| y[block * points + j]).collect();
        let found = indices(&(0..keys + 2).map(column).collect::<Vec<Vec<f64>>>())?;
        Some(Output::new(name, scene, found))
    };
    Ok(Sensitivity {
        scene: scene.name.clone(),
        points,
        left_out: points - kept.len(),
        runs,
        seed,
        outputs: outputs.iter().filter_map(output).collect(),
    })
}

fn values(paths: &[Result<MemberPath, String>], of: &dyn Fn(&MemberPath) -> f64) -> Vec<f64> {
    paths.iter().map(|path| path.as_ref().map_or(f64::NAN, of)).collect()
}

/// Force of the largest magnitude, with its sign, N.
fn peak_n(path: &MemberPath) -> f64 {
    let finite = path.force_n.iter().copied().filter(|f| f.is_finite());
    finite.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN)
}

impl Output {
    fn new(name: &str, scene: &Scene, found: Indices) -> Self {
        let key = |(i, one): (usize, &crate::scene::Uncertain)| KeyIndices {
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
