//! Fits several recordings of one sample as one problem. The sample's keys are shared. Alignment and load cell
//! parameters belong to each recording.
//!
//! ```text
//! smallest sum_r 1 / s_r^2 sum_i (F(d_ri - c_r; keys) + zero_r + drift_r t_ri - F_measured,ri)^2
//! ```
//!
//! s_r is the root mean square residual of recording r fitted alone. The standard error is the larger of two: that of
//! [`Uncertainty::noise`], and that of the recordings taken as independent clusters. The latter holds whatever the
//! recordings differ in (Liang and Zeger, Biometrika 73, 1986):
//!
//! ```text
//! C = n / (n - 1) N^-1 (sum_r g_r g_r^T) N^-1,   N = J^T J,   g_r = J_r^T r_r
//! ```

use nalgebra::{DMatrix, DVector};

use super::problem::Recorded;
use super::search::{Searched, search};
use super::unknown::Sought;
use super::{CalibrateError, Task};
use crate::compare::Cancel;
use crate::compare::least_squares::{self, Problem, Unknown};
use crate::compare::uncertainty::Uncertainty;

/// A shared key.
#[derive(Clone, Debug, PartialEq)]
pub struct JointKey {
    /// Dotted path.
    pub key: String,
    /// The identified value.
    pub value: f64,
    /// Standard error from noise and from the differences between the recordings; `None` where they don't determine
    /// it.
    pub standard_error: Option<f64>,
}

/// The parameters of one recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Own {
    /// Recorded depth of the contact, m; 0 if it was not sought.
    pub contact_depth_m: f64,
    /// The load cell's zero, N.
    pub force_zero_n: f64,
    /// Root mean square residual with the shared keys, N.
    pub rmse_n: f64,
}

/// The result of a joint fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The shared keys, in the requested order.
    pub keys: Vec<JointKey>,
    /// One per recording.
    pub own: Vec<Own>,
    /// Number of runs of the twin, including those of the separate fits.
    pub runs: u32,
    /// Whether the search converged.
    pub converged: bool,
}

struct Together<'a> {
    parts: Vec<Recorded<'a>>,
    /// 1 / s_r
    weights: Vec<f64>,
    /// Number of shared keys; they come first in every part.
    shared: usize,
    /// Index of the first unknown that belongs to each part alone.
    offsets: Vec<usize>,
}

impl Together<'_> {
    /// The unknowns of one part.
    fn of(&self, x: &[f64], part: usize) -> Vec<f64> {
        let own = self.parts[part].sought.len() - self.shared;
        x[..self.shared].iter().chain(&x[self.offsets[part]..self.offsets[part] + own]).copied().collect()
    }

    fn each<T>(
        &mut self,
        x: &[f64],
        mut of: impl FnMut(&mut Recorded, &[f64]) -> Result<Option<T>, CalibrateError>,
    ) -> Result<Option<Vec<T>>, CalibrateError> {
        let mut all = Vec::new();
        for part in 0..self.parts.len() {
            let own = self.of(x, part);
            let Some(one) = of(&mut self.parts[part], &own)? else { return Ok(None) };
            all.push(one);
        }
        Ok(Some(all))
    }
}

impl Problem for Together<'_> {
    type Error = CalibrateError;

    fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, CalibrateError> {
        let all = self.each(x, |part, own| part.residuals(own))?;
        let weighted = |all: Vec<DVector<f64>>| -> Vec<f64> {
            all.iter().zip(&self.weights).flat_map(|(r, w)| r.iter().map(move |r| w * r)).collect()
        };
        Ok(all.map(|all| DVector::from_vec(weighted(all))))
    }

    fn jacobian(&mut self, x: &[f64], _: &DVector<f64>) -> Result<Option<DMatrix<f64>>, CalibrateError> {
        let all = self.each(x, |part, own| match part.residuals(own)? {
            Some(r) => part.jacobian(own, &r),
            None => Ok(None),
        })?;
        let Some(all) = all else { return Ok(None) };
        let mut jacobian = DMatrix::zeros(all.iter().map(DMatrix::nrows).sum(), x.len());
        let mut row = 0;
        for (part, one) in all.iter().enumerate() {
            for k in 0..one.ncols() {
                let column = if k < self.shared { k } else { self.offsets[part] + k - self.shared };
                jacobian.view_mut((row, column), (one.nrows(), 1)).copy_from(&(one.column(k) * self.weights[part]));
            }
            row += one.nrows();
        }
        Ok(Some(jacobian))
    }
}

/// Fits recordings of one sample jointly. All tasks request the same keys.
///
/// # Errors
/// [`CalibrateError`] as of [`super::calibrate`] for any of them.
pub(crate) fn calibrate_together(tasks: &[Task], cancel: &Cancel) -> Result<Joint, CalibrateError> {
    let mut watches: Vec<Cancel> = tasks.iter().map(|_| cancel.clone()).collect();
    let mut silent: Vec<fn(&str)> = tasks.iter().map(|_| (|_: &str| ()) as fn(&str)).collect();
    let (mut parts, mut alone) = (Vec::new(), Vec::new());
    for ((task, watch), tell) in tasks.iter().zip(&mut watches).zip(&mut silent) {
        let mut problem = Recorded::new(task, keys_first(task), watch, tell);
        alone.push(search(&mut problem, task)?);
        parts.push(problem);
    }
    let shared = parts.first().map_or(0, |p| p.sought.iter().take_while(|s| matches!(s, Sought::Key(_))).count());
    let (unknowns, offsets) = unknowns(&alone, shared);
    let weights: Vec<f64> = alone.iter().map(|found| 1.0 / left(found)).collect();
    let mut together = Together { parts, weights, shared, offsets };
    let solution = least_squares::solve(&mut together, &unknowns)?;
    let solution =
        solution.ok_or_else(|| CalibrateError::Diverged("with the mean of the recordings' keys".to_owned()))?;
    Ok(judged(&together, &solution))
}

/// Root mean square residual of a recording fitted alone, bounded below by rounding.
fn left(found: &Searched) -> f64 {
    let r = &found.solution.residuals;
    (r.norm_squared() / r.len().max(1) as f64).sqrt().max(1e-9)
}

/// The unknowns, with the keys of the scene first: these are shared.
fn keys_first(task: &Task) -> Vec<Sought> {
    let all = Sought::all(task.wanted, task.load_cell);
    let (keys, own): (Vec<_>, Vec<_>) = all.into_iter().partition(|s| matches!(s, Sought::Key(_)));
    keys.into_iter().chain(own).collect()
}

/// Start of the joint search. Shared keys start at the mean over the recordings; all others where the separate fit
/// ended. The second value holds the index of each recording's first own unknown.
fn unknowns(alone: &[Searched], shared: usize) -> (Vec<Unknown>, Vec<usize>) {
    let mean = |k: usize| alone.iter().map(|one| one.solution.x[k]).sum::<f64>() / alone.len() as f64;
    let mut all: Vec<Unknown> = alone
        .first()
        .map_or_else(Vec::new, |first| (0..shared).map(|k| Unknown { start: mean(k), ..first.unknowns[k] }).collect());
    let mut offsets = Vec::new();
    for one in alone {
        offsets.push(all.len());
        let own = one.unknowns.iter().zip(&one.solution.x).skip(shared);
        all.extend(own.map(|(unknown, x)| Unknown { start: *x, ..*unknown }));
    }
    (all, offsets)
}

fn judged(together: &Together, solution: &least_squares::Solution) -> Joint {
    let about = Uncertainty::new(&solution.jacobian);
    let noise = about.noise(&solution.jacobian, solution.residuals.as_slice());
    let apart = differences(together, solution);
    let names = together.parts.first().map_or_else(Vec::new, Recorded::names);
    let key = |k: usize| {
        let variance = apart.as_ref().map_or(0.0, |c| c[(k, k)]).max(noise[(k, k)]);
        let error = Some(variance.sqrt()).filter(|e| about.is_determined(k) && e.is_finite());
        JointKey { key: names[k].clone(), value: solution.x[k], standard_error: error }
    };
    let mut row = 0;
    let own = together.parts.iter().enumerate().map(|(i, part)| {
        let x = together.of(&solution.x, i);
        let of = |wanted: fn(&Sought) -> bool| part.sought.iter().position(wanted).map_or(0.0, |k| x[k]);
        let n = part.residual_count();
        let r = solution.residuals.rows(row, n);
        row += n;
        Own {
            contact_depth_m: of(|s| matches!(s, Sought::Contact)),
            force_zero_n: of(|s| matches!(s, Sought::Zero { .. })),
            rmse_n: (r.norm_squared() / n.max(1) as f64).sqrt() / together.weights[i],
        }
    });
    Joint {
        own: own.collect(),
        keys: (0..together.shared).map(key).collect(),
        runs: together.parts.iter().map(Recorded::runs).sum(),
        converged: solution.converged,
    }
}

/// Covariance from the recordings as independent clusters; `None` for a single one, or if the equations can't be
/// solved.
fn differences(together: &Together, solution: &least_squares::Solution) -> Option<DMatrix<f64>> {
    let n = together.parts.len();
    let (j, r) = (&solution.jacobian, &solution.residuals);
    let lengths: Vec<f64> = j.column_iter().map(|c| c.norm()).collect();
    let scale = DMatrix::from_diagonal(&DVector::from_vec(lengths.iter().map(|l| 1.0 / l).collect()));
    let scaled = j * &scale;
    let inverse = (scaled.transpose() * &scaled).cholesky()?.inverse();
    let mut sum = DMatrix::zeros(j.ncols(), j.ncols());
    let mut row = 0;
    for part in &together.parts {
        let count = part.residual_count();
        let gradient = scaled.rows(row, count).transpose() * r.rows(row, count);
        sum += &gradient * gradient.transpose();
        row += count;
    }
    let covariance = &scale * &inverse * sum * inverse * &scale * (n as f64 / (n as f64 - 1.0));
    (n > 1).then_some(covariance)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::{CurveTable, HoldOut, LoadCell, Wanted};
    use super::*;
    use needle_core::scene::{Override, Scene};
    use needle_recording::{At, ForceSeries, Reading};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng as _;
    use rand_distr::{Distribution, StandardNormal};

    const BLOCK: &str = "name = \"block\"\n[sample]\nshape = \"cylinder\"\ndiameter_m = 0.05\nheight_m = 0.03\n\
        [material]\nshear_modulus_pa = 8e3\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 1000\n\
        [instrument]\nkind = \"plate\"\n[discretisation]\nmethod = \"mmls\"\nspacing_m = 0.0075\n";
    const MODULUS: &str = "material.shear_modulus_pa";

    #[test]
    fn a_shared_modulus_comes_back_without_bias_and_with_the_error_that_it_says() {
        let (truth, spread, repeats, seeds) = (1e4, 0.01, 5, 30);
        let scene = Scene::from_toml(BLOCK, "block").unwrap();
        let wanted = [MODULUS, "align.contact_depth_m=-0.001..0.001"].map(|text| Wanted::parse(text).unwrap());
        let table = CurveTable::new(&scene, &wanted, 6e-3, &Cancel::default()).unwrap();
        let readings: Vec<Reading> = (0..220)
            .map(|i| Reading { time_s: 0.05 * f64::from(i), at: At::Depth(2.5e-5 * f64::from(i) - 1e-3) })
            .collect();
        let (mut values, mut variances) = (Vec::new(), Vec::new());
        for seed in 0..seeds {
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            let mut normal = || -> f64 { Distribution::<f64>::sample(&StandardNormal, &mut generator) };
            let measured: Vec<ForceSeries> = (0..repeats)
                .map(|_| {
                    let modulus = truth * (1.0 + spread * normal());
                    let (contact_m, zero_n) = (2e-4 * normal(), 0.1 * normal());
                    let moved = |r: &Reading| match r.at {
                        At::Depth(d) => Reading { at: At::Depth(d - contact_m), ..*r },
                        At::Pose(_) => *r,
                    };
                    let shifted: Vec<Reading> = readings.iter().map(moved).collect();
                    let own = scene.with(&[Override::typed(MODULUS, modulus, "test")]).unwrap();
                    let run = table.run(&own, &shifted, &ForceSeries::default()).unwrap();
                    let forces = run.answers.iter().map(|a| [0.0, 0.0, a.predicted_n + zero_n + 0.02 * normal()]);
                    ForceSeries::new(readings.iter().map(|r| r.time_s).zip(forces).collect()).on_one_clock(true)
                })
                .collect();
            let tasks: Vec<Task> = measured
                .iter()
                .map(|measured| Task {
                    scene: &scene,
                    readings: &readings,
                    measured,
                    wanted: &wanted,
                    load_cell: LoadCell::Offset,
                    force_error: 0.0,
                    part: HoldOut::Nothing,
                    table: Some(&table),
                })
                .collect();
            let found = calibrate_together(&tasks, &Cancel::default()).unwrap();
            assert!(found.converged && found.own.len() == repeats && found.runs == 0);
            values.push(found.keys[0].value);
            variances.push(found.keys[0].standard_error.unwrap().powi(2));
        }
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let said = variances.iter().sum::<f64>() / n;
        println!(
            "bias {:.1} ± {:.1} Pa; spread over seeds {:.1}, said {:.1} Pa",
            mean - truth,
            (variance / n).sqrt(),
            variance.sqrt(),
            said.sqrt()
        );
        assert!((mean - truth).abs() < 3.0 * (variance / n).sqrt(), "{mean} {variance}");
        // from five repeats the variance is known to about a factor of two
        assert!((0.4..2.5).contains(&(said / variance)), "{said} {variance}");
    }
}
