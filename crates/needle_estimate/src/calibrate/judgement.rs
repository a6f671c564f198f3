//! The result of a search, its uncertainty, and what of it is not reliable.

use nalgebra::DMatrix;

use super::calibration::cure;
use super::problem::Recorded;
use super::unknown::Sought;
use super::{CalibrateError, Calibration, Estimate, Forces, Task};
use crate::compare::rows::Rows;
use crate::compare::uncertainty::{Uncertainty, correlation};
use crate::compare::verdict::judge;
use crate::compare::{Explains, Verdict, least_squares};
use needle_core::scene::Scene;

/// Drift that the data sheet of a subminiature load cell allows, N/s: five times that of `bags/README.md`.
const DRIFT_N_PER_S: f64 = 1e-4;
/// The same for larger cells: drift over the recording as a share of the peak force.
const DRIFT_SHARE: f64 = 0.05;
/// A drift counts only if it exceeds this multiple of its standard error.
const KNOWN: f64 = 3.0;

/// Estimates, errors and verdict.
pub(super) fn judged(
    task: &Task,
    scene: Scene,
    solution: &least_squares::Solution,
    unknowns: &[least_squares::Unknown],
    forces: Forces,
    problem: &mut Recorded,
) -> Result<Calibration, CalibrateError> {
    let about = Uncertainty::new(&solution.jacobian);
    let noise = about.noise(&solution.jacobian, solution.residuals.as_slice());
    let (force, depth) = problem.all_fitted(&solution.x)?;
    let systematic = about.systematic(&solution.jacobian, &force, &depth, task.force_error, &problem.weights());
    let names = problem.names();
    let error = |covariance: &DMatrix<f64>, k: usize| {
        Some(covariance[(k, k)].max(0.0).sqrt()).filter(|e| about.is_determined(k) && e.is_finite())
    };
    let estimate = |k: usize| Estimate {
        name: names[k].clone(),
        value: solution.x[k],
        start: unknowns[k].start,
        bounds: unknowns[k].bounds,
        noise_error: error(&noise, k),
        systematic_error: error(&systematic, k),
        has_effect: about.has_effect(k),
        withheld: None,
    };
    let both = &noise + &systematic;
    let determined = |a, b| about.is_determined(a) && about.is_determined(b);
    let correlated = |a, b| correlation(&both, a, b).filter(|_| determined(a, b));
    let group = |g: Vec<usize>| g.into_iter().map(|k| names[k].clone()).collect();
    let rows = problem.rows(&forces, &forces.model_n, &solution.x);
    let predicted = problem.all_predicted(&solution.x)?.unwrap_or_default();
    let across = problem.rows_across(&rows, predicted.get(1..).unwrap_or_default());
    let mut calibration = Calibration {
        scene,
        estimates: (0..names.len()).map(estimate).collect(),
        keys: task.wanted.len(),
        tied: problem.tied(),
        correlation: (0..names.len()).map(|a| (0..names.len()).map(|b| correlated(a, b)).collect()).collect(),
        indistinguishable: about.indistinguishable().into_iter().map(group).collect(),
        verdict: verdict(&rows, &across, names.len(), task.force_error, &calibration_notes(problem)),
        regions: problem.regions().to_vec(),
        forces,
        parts: problem.parts().clone(),
        left_out: 0,
        iterations: solution.iterations,
        runs: problem.runs(),
        converged: solution.converged,
        alignment: None,
        realigned: [false; 2],
        refused: problem.refused(),
        drift_left_out_for: Vec::new(),
        alternatives: Vec::new(),
    };
    let drift = problem.sought.iter().position(|s| *s == Sought::Drift);
    calibration.verdict.over_holes(task.measured.holes());
    withhold(&mut calibration, drift, problem.of_many_clouds(), &rows);
    Ok(calibration)
}

fn calibration_notes(problem: &Recorded) -> Vec<String> {
    match problem.refused() {
        0 => Vec::new(),
        n => vec![format!(
            "{n} poses were refused: the scene is not deep enough for the motion (motion.depth_m, sample.height_m)"
        )],
    }
}

/// The verdict on the force along the axis, or on a component across it if that explains less.
fn verdict(rows: &Rows, across: &[(String, Rows)], fitted: usize, force_error: f64, notes: &[String]) -> Verdict {
    let along = judge(rows, fitted, force_error);
    let worse =
        |so_far: Verdict, (name, rows): &(String, Rows)| so_far.or_worse(judge(rows, fitted, force_error), name);
    let mut verdict = across.iter().fold(along, worse);
    verdict.reasons.extend(notes.iter().cloned());
    verdict
}

/// Withholds the standard error of estimates that are not reliable, and states why.
fn withhold(calibration: &mut Calibration, drift: Option<usize>, many: Option<&str>, rows: &Rows) {
    let mixed = |k: &usize| calibration.indistinguishable.iter().any(|g| g.contains(&calibration.estimates[*k].name));
    // a drift that is correlated with another unknown gives no information about the load cell
    let beyond = drift.filter(|k| !mixed(k)).and_then(|k| excessive(&calibration.estimates[k], rows));
    let all = match calibration.verdict.explains {
        Explains::No | Explains::InPart => Some("the model does not explain the readings".to_owned()),
        _ if calibration.refused > 0 => Some(format!("{} poses were refused", calibration.refused)),
        _ if !calibration.converged => {
            Some(format!("the search ran out of steps after {}: start nearer with --set", calibration.iterations))
        }
        _ => beyond.clone().or_else(|| many.map(of_many_clouds)),
    };
    if beyond.is_some() && calibration.verdict.explains == Explains::Yes {
        calibration.verdict.explains = Explains::No;
    }
    calibration.verdict.reasons.extend(beyond);
    let together = calibration.indistinguishable.clone();
    for e in &mut calibration.estimates {
        let group = together.iter().find(|group| group.contains(&e.name));
        e.withheld = all.clone().or_else(|| {
            if let Some(group) = group {
                return Some(format!("the data can't tell apart: {}", group.join(", ")) + cure(group));
            }
            e.at_bound().then(|| format!("it ended at its bound {}", e.value))
        });
    }
}

/// Why no estimate has an interval if the size of a region that is no layer is sought.
fn of_many_clouds(key: &str) -> String {
    format!(
        "each value of {key} has a cloud of its own, and forces on two clouds differ by up to 1 %, which no derivative tells from the \
         key's effect. Start from several values with --set and compare what is left of the fit"
    )
}

/// Reports a drift larger than any load cell has: another effect changes the force in the course of the recording.
fn excessive(drift: &Estimate, rows: &Rows) -> Option<String> {
    let whole = rows.time_s.last()? - rows.time_s.first()?;
    let most = DRIFT_N_PER_S.max(DRIFT_SHARE * rows.peak_n() / whole);
    let known = drift.noise_error.is_some_and(|e| drift.value.abs() > KNOWN * e);
    (known && drift.value.abs() > most).then(|| {
        format!(
            "the load cell would have to drift by {:.2e} N/s, and its data sheet allows {most:.1e} N/s: the tissue relaxes (see \
             material.prony_shares), or the model is wrong",
            drift.value
        )
    })
}
