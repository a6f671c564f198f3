//! Forecast: twin and baselines are fitted to the first part of a recording, and predict the rest blindly.
//!
//! Blind by construction. [`Blind`] takes the force after the cut out of the recording before anything is fitted; the
//! motion stays, since it is the input. [`Prediction`] is made from that alone. Only [`Prediction::judged`] needs the
//! measured rest.
//!
//! The band of a force F is twice 1.96 standard deviations wide, of the sum of these variances:
//!
//! ```text
//! sum_kl dF_k dF_l r_kl                dF_k: change of F by one standard error of the unknown k, r: correlation
//! (e F)^2                              e: relative standard uncertainty of the force
//! (m F)^2,  m = rmse / peak            misfit of the fitted part: what the model lacks grows with the force
//! rmse^2                               noise of a reading, and misfit
//! ```
//!
//! With two other recordings of the scene or more, force and band are corrected by what they teach ([`crate::shortfall`]).

use std::borrow::Cow;

use crate::baseline::{self, Forecast, Standing};
use crate::calibrate::{CalibrateError, Calibration, HoldOut, INTERVAL_95, LoadCell, Task, Wanted, calibrate};
use crate::compare::uncertainty::FORCE_ERROR;
use crate::compare::{Answer, Curve, Keep, Run, Session, Watch, passes};
use crate::shortfall::{self, Corrected};
use needle_core::scene::{Align, Override, Scene};
use needle_recording::{Reading, Recording};

/// Number of equal parts of the predicted depth whose errors are reported.
const PARTS: usize = 5;

/// What the fitted share is a share of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// The deepest depth: everything after the first reading beyond it is predicted.
    Depth,
    /// The time from the first reading to the last.
    Time,
    /// The number of insertions: at least the last one is predicted.
    Insertion,
}

/// Why there is no forecast.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ForecastError {
    /// Nothing is left to predict, or to fit.
    #[error("{0}")]
    Cut(String),
    /// The fit has no result.
    #[error(transparent)]
    Fit(#[from] CalibrateError),
}

/// A recording without the force after a cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Blind {
    recording: Recording,
    /// Time of the last reading that may be fitted, s.
    pub cut_s: f64,
    /// Where that is, in words.
    pub words: String,
}

impl Blind {
    /// Takes the force after the cut out of a recording. `readings` are the positions of the instrument, and `depth_m`
    /// their depths.
    ///
    /// # Errors
    /// [`ForecastError::Cut`] if nothing is left to predict.
    pub fn new(
        mut recording: Recording,
        readings: &[Reading],
        depth_m: &[f64],
        share: f64,
        of: Of,
    ) -> Result<Self, ForecastError> {
        let none = |text: String| Err(ForecastError::Cut(text));
        let Some((first, last)) = readings.first().zip(readings.last()) else {
            return none("there is no motion".to_owned());
        };
        let deepest = depth_m.iter().copied().fold(0.0, f64::max);
        let (next, words) = match of {
            Of::Depth => {
                let beyond = share * deepest;
                (depth_m.iter().position(|d| *d > beyond), format!("{:.3} mm of {:.3}", 1e3 * beyond, 1e3 * deepest))
            }
            Of::Time => {
                let whole = last.time_s - first.time_s;
                let until = share * whole;
                (readings.iter().position(|r| r.time_s - first.time_s > until), format!("{until:.3} s of {whole:.3}"))
            }
            Of::Insertion => {
                let passes = passes(depth_m);
                let insertions: Vec<usize> = passes.iter().filter(|p| !p.back).map(|p| p.range.start).collect();
                let fitted = ((share * insertions.len() as f64).round() as usize).max(1);
                if insertions.len() < 2 {
                    return none("it has one insertion: --of depth or --of time".to_owned());
                }
                (insertions.get(fitted).copied(), format!("insertion {fitted} of {}", insertions.len()))
            }
        };
        let Some(next) = next.filter(|next| *next > 0) else {
            return none(format!("nothing is left to predict after {words}: give a smaller --fit-to"));
        };
        let cut_s = readings[next - 1].time_s;
        recording.forces.retain(|force| force.time_s <= cut_s);
        recording.markers.clear();
        Ok(Self { recording, cut_s, words })
    }

    /// What may be looked at.
    #[must_use]
    pub const fn recording(&self) -> &Recording {
        &self.recording
    }
}

/// Keys that are fitted where the user names none: the modulus, and what resists a needle with friction.
#[must_use]
pub fn default_keys(scene: &Scene) -> Vec<Wanted> {
    let mut keys = vec!["material.shear_modulus_pa"];
    if scene.instrument.is_some_and(|instrument| instrument.is_frictional()) {
        keys.extend(["instrument.friction_n_per_m", "instrument.cutting_force_n"]);
    }
    let there = |key: &&str| scene.get(key).is_some();
    keys.into_iter().filter(there).map(|key| Wanted { key: key.to_owned(), bounds: None }).collect()
}

/// The forces that are expected, made before the rest was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// The fit to the first part.
    pub calibration: Calibration,
    /// Where the fitted part ends.
    pub words: String,
    /// Time of the last fitted reading, s.
    pub cut_s: f64,
    /// Time of each pose, s.
    pub time_s: Vec<f64>,
    /// Its depth, m.
    pub depth_m: Vec<f64>,
    /// Expected reading of the load cell, N, with its zero and drift.
    pub force_n: Vec<f64>,
    /// The same of the twin alone, where other recordings have corrected it.
    pub alone_n: Option<Vec<f64>>,
    /// How they have, in words.
    pub correction: Option<String>,
    /// Standard deviation of a reading about it, N.
    pub deviation_n: Vec<f64>,
    /// Forces of the baselines, N.
    pub baselines: Vec<Forecast>,
    /// Measured force at the fitted poses, N: index of the pose and force.
    pub fitted: Vec<(usize, f64)>,
    /// What of the motion could not be predicted.
    pub losses: Vec<String>,
    /// Contact and clock that were found; zero and drift are part of `force_n`.
    placement: Align,
}

/// Fits and predicts. `scene` has the start of the search, and the poses are taken as poses if `by_pose`. `others` are curves of other
/// recordings of the scene ([`Curve::averaged`]): what the twin lacked there is added.
///
/// # Errors
/// [`ForecastError`] if the fit has no result.
pub fn predict(
    blind: &Blind,
    scene: &Scene,
    wanted: &[Wanted],
    load_cell: LoadCell,
    by_pose: bool,
    others: &[&Curve],
    watch: &mut dyn Watch,
    tell: &mut dyn FnMut(&str),
) -> Result<Prediction, ForecastError> {
    let begun = blind.recording.aligned(scene);
    let mut readings = begun.readings(by_pose);
    // with clocks of their own, a force may belong to a motion after the cut
    if blind.recording.one_clock {
        readings.retain(|r| r.time_s <= blind.cut_s);
    }
    let task = Task {
        scene,
        readings: &readings,
        measured: &begun.measured(),
        wanted,
        load_cell,
        force_error: FORCE_ERROR,
        part: HoldOut::Nothing,
        table: None,
    };
    let calibration = calibrate(&task, watch, tell)?;
    let align = calibration.scene.align.unwrap_or(Align::NONE);
    let placement = Align { zero_n: 0.0, drift_n_per_s: 0.0, ..align };
    let placed = placed(&blind.recording, &calibration.scene, placement);
    let all = placed.readings(by_pose);
    tell("predicting the rest");
    let run = run(&calibration.scene, &all, watch)?;
    let at = |i: usize| run.answers[i].time_s + first_s(&all);
    let added = |i: usize| align.zero_n + align.drift_n_per_s * run.answers[i].time_s;
    let mut force_n: Vec<f64> = (0..run.answers.len()).map(|i| run.answers[i].predicted_n + added(i)).collect();
    let (depth_m, time_s): (Vec<f64>, Vec<f64>) =
        (0..run.answers.len()).map(|i| (run.answers[i].depth_m, at(i))).unzip();
    let fitted = measured(&placed, &calibration.scene, &time_s);
    let alone: Vec<f64> = run.answers.iter().map(|a| a.predicted_n).collect();
    let corrected = shortfall::corrected(&depth_m, &alone, &fitted, others);
    let correction = corrected.as_ref().map(Corrected::words);
    let (alone_n, deviation_n) = match corrected {
        Some(Corrected { force_n: with, deviation_n, .. }) => {
            // the noise of a single reading
            let apart = fitted.iter().map(|&(i, n)| (with[i] - n).powi(2)).sum::<f64>() / fitted.len() as f64;
            let deviation_n = deviation_n.iter().map(|d| d.hypot(apart.sqrt())).collect();
            (Some(std::mem::replace(&mut force_n, with)), deviation_n)
        }
        None => (None, deviation(&calibration, &run, &all, watch, tell)?),
    };
    let baselines = baseline::forecasts(Some(&calibration.scene), &depth_m, &fitted, &[]);
    let mut losses = run.losses.clone();
    losses.extend(run.diverged.clone());
    Ok(Prediction {
        words: blind.words.clone(),
        cut_s: blind.cut_s,
        time_s,
        depth_m,
        force_n,
        alone_n,
        correction,
        deviation_n,
        baselines,
        fitted,
        losses,
        placement,
        calibration,
    })
}

/// The recording where the contact and the clock are as found, and the force as recorded.
fn placed<'a>(recording: &'a Recording, scene: &Scene, placement: Align) -> Cow<'a, Recording> {
    recording.aligned(&Scene { align: Some(placement), ..scene.clone() })
}

fn first_s(readings: &[Reading]) -> f64 {
    readings.first().map_or(0.0, |r| r.time_s)
}

fn run(scene: &Scene, readings: &[Reading], watch: &mut dyn Watch) -> Result<Run, ForecastError> {
    let session = Session::new(scene, "forecast", Keep::ANSWERS);
    let session = session.map_err(|source| CalibrateError::Build { scene: scene.name.clone(), source })?;
    let run = session.run(readings.iter().copied(), watch).run;
    if watch.cancel().is_cancelled() { Err(CalibrateError::Interrupted.into()) } else { Ok(run) }
}

/// Measured force at some times, N, positive against the insertion: index of the time and force.
pub(crate) fn measured(recording: &Recording, scene: &Scene, time_s: &[f64]) -> Vec<(usize, f64)> {
    let series = recording.measured();
    let straight = scene.instrument.map_or([0.0, 0.0, -1.0], |instrument| instrument.axis());
    let axis = |i: usize| {
        let pose = recording.depths.is_empty().then(|| recording.poses.get(i)).flatten();
        pose.map_or(straight, |pose| pose.axis)
    };
    let along = |i: usize, force: [f64; 3]| -(0..3).map(|k| force[k] * axis(i)[k]).sum::<f64>();
    let at = |(i, t): (usize, &f64)| Some((i, along(i, series.at(*t)?)));
    time_s.iter().enumerate().filter_map(at).filter(|(_, f)| f.is_finite()).collect()
}

/// Standard deviation of a reading about the expected one at every pose, N; see the module.
fn deviation(
    calibration: &Calibration,
    run: &Run,
    readings: &[Reading],
    watch: &mut dyn Watch,
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<f64>, ForecastError> {
    let force = |run: &Run| -> Vec<f64> { run.answers.iter().map(|a: &Answer| a.predicted_n).collect() };
    let nominal = force(run);
    // noise and systematic error even of estimates that are withheld: their model is doubtful, not their error
    let error = |k: usize| {
        let e = &calibration.estimates[k];
        Some(e.noise_error?.hypot(e.systematic_error?)).filter(|e| e.is_finite() && *e > 0.0)
    };
    let mut changes: Vec<(usize, Vec<f64>)> = Vec::new();
    for k in 0..calibration.keys {
        let estimate = &calibration.estimates[k];
        let Some(error) = error(k) else { continue };
        // towards the inside of the bounds
        let step = if estimate.value + error > estimate.bounds[1] { -error } else { error };
        let change = Override::typed(&estimate.name, estimate.value + step, "forecast");
        let Ok(scene) = calibration.scene.with(&[change]) else { continue };
        tell(&format!("how sure {} makes the forecast", estimate.name));
        let moved = force(&self::run(&scene, readings, watch)?);
        if moved.len() == nominal.len() {
            let sign = step.signum();
            changes.push((k, moved.iter().zip(&nominal).map(|(m, n)| sign * (m - n)).collect()));
        }
    }
    let time = |i: usize| run.answers[i].time_s;
    for (k, estimate) in calibration.estimates.iter().enumerate().skip(calibration.keys) {
        let Some(error) = error(k) else { continue };
        let drifts = estimate.name.contains("drift");
        let of = |i: usize| if drifts { error * time(i) } else { error };
        if drifts || estimate.name.contains("offset_n") || estimate.name.contains("zero") {
            changes.push((k, (0..nominal.len()).map(of).collect()));
        }
    }
    let rmse = calibration.rmse_n();
    let fitted = &calibration.forces.measured_n[calibration.parts.fitted.clone()];
    let peak = fitted.iter().map(|f| f.abs()).fold(0.0, f64::max);
    let misfit = if peak > 0.0 { rmse / peak } else { 0.0 };
    let variance = |i: usize| {
        let mut sum = rmse * rmse + (FORCE_ERROR * nominal[i]).powi(2) + (misfit * nominal[i]).powi(2);
        for (k, a) in &changes {
            for (l, b) in &changes {
                let alike = if k == l { 1.0 } else { calibration.correlation[*k][*l].unwrap_or(0.0) };
                sum += a[i] * b[i] * alike;
            }
        }
        sum.max(0.0).sqrt()
    };
    Ok((0..nominal.len()).map(variance).collect())
}

/// The error over one part of the predicted depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Depths of the part, m.
    pub depth_m: [f64; 2],
    /// Root mean square of the twin's force - measured, N.
    pub rmse_n: f64,
    /// The same of the best baseline, N.
    pub baseline_rmse_n: f64,
}

/// A prediction compared with what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Twin and baselines over the rest; `None` if nothing was measured there.
    pub standing: Option<Standing>,
    /// Root mean square error of the twin alone, N, where other recordings have corrected it.
    pub alone_rmse_n: Option<f64>,
    /// Largest measured force less the zero that was found, N.
    pub peak_n: f64,
    /// Share of the measured forces within the band.
    pub coverage: Option<f64>,
    /// Errors over the predicted depths.
    pub parts: Vec<Part>,
    /// Measured force at the poses, N: index of the pose and force.
    pub measured: Vec<(usize, f64)>,
    /// Measured and predicted force over the depth, less the zero.
    pub curve: Curve,
}

impl Prediction {
    /// Index of the first predicted pose.
    #[must_use]
    pub(crate) fn first_predicted(&self) -> usize {
        self.time_s.partition_point(|t| *t <= self.cut_s)
    }

    /// The limits between which 95 % of the readings are expected at a pose, N.
    #[must_use]
    pub fn band_n(&self, i: usize) -> [f64; 2] {
        let half = INTERVAL_95 * self.deviation_n[i];
        [self.force_n[i] - half, self.force_n[i] + half]
    }

    /// Compares with the complete recording. `others` are curves of other recordings ([`Judged::curve`]).
    #[must_use]
    pub fn judged(&self, recording: &Recording, others: &[&Curve]) -> Judged {
        let placed = placed(recording, &self.calibration.scene, self.placement);
        let measured = measured(&placed, &self.calibration.scene, &self.time_s);
        let first = self.first_predicted();
        let rest: Vec<usize> = measured.iter().map(|(i, _)| *i).filter(|i| *i >= first).collect();
        let mut of = vec![f64::NAN; self.time_s.len()];
        measured.iter().for_each(|(i, n)| of[*i] = *n);
        let mut baselines = self.baselines.clone();
        if !others.is_empty() {
            let all = baseline::forecasts(None, &self.depth_m, &self.fitted, others);
            baselines.extend(all.into_iter().filter(|f| f.name == baseline::OTHERS));
        }
        let standing = Standing::over(&rest, &self.force_n, &of, &baselines)
            .map(|standing| Standing { fitted_to: self.words.clone(), ..standing });
        let align = self.calibration.scene.align.unwrap_or(Align::NONE);
        let zero = |i: usize| align.zero_n + align.drift_n_per_s * (self.time_s[i] - self.time_s[0]);
        let within = |i: &&usize| {
            let [low, high] = self.band_n(**i);
            (low..=high).contains(&of[**i])
        };
        let inside = rest.iter().filter(within).count() as f64 / rest.len() as f64;
        let error = |force: &Vec<f64>| {
            (rest.iter().map(|&i| (force[i] - of[i]).powi(2)).sum::<f64>() / rest.len() as f64).sqrt()
        };
        let column = |f: &dyn Fn(usize) -> f64| measured.iter().map(|(i, _)| f(*i)).collect::<Vec<f64>>();
        Judged {
            peak_n: measured.iter().map(|(i, n)| (n - zero(*i)).abs()).fold(0.0, f64::max),
            alone_rmse_n: self.alone_n.as_ref().map(error).filter(|_| !rest.is_empty()),
            coverage: Some(inside).filter(|_| !rest.is_empty()),
            parts: self.parts(&rest, &of, standing.as_ref(), &baselines),
            curve: Curve::of(
                &column(&|i| self.depth_m[i]),
                &column(&|i| of[i] - zero(i)),
                &column(&|i| self.force_n[i] - zero(i)),
            ),
            standing,
            measured,
        }
    }

    fn parts(&self, rest: &[usize], of: &[f64], standing: Option<&Standing>, baselines: &[Forecast]) -> Vec<Part> {
        let best = standing.and_then(Standing::best).and_then(|b| baselines.iter().find(|f| f.name == b.name));
        let Some(best) = best else { return Vec::new() };
        let depths = || rest.iter().map(|&i| self.depth_m[i]);
        let (low, high) = (depths().fold(f64::INFINITY, f64::min), depths().fold(f64::NEG_INFINITY, f64::max));
        let place = |k: usize| low + (high - low) * k as f64 / PARTS as f64;
        let rms = |of: Vec<f64>| (of.iter().map(|e| e * e).sum::<f64>() / of.len() as f64).sqrt();
        let part = |k: usize| {
            let depth_m = [place(k), place(k + 1)];
            let last = k + 1 == PARTS;
            let inside = |i: &&usize| {
                let d = self.depth_m[**i];
                d >= depth_m[0] && (d < depth_m[1] || last)
            };
            let inside: Vec<usize> = rest.iter().filter(inside).copied().collect();
            let error = |force: &[f64]| rms(inside.iter().map(|&i| force[i] - of[i]).collect());
            (!inside.is_empty()).then(|| Part {
                depth_m,
                rmse_n: error(&self.force_n),
                baseline_rmse_n: error(&best.force_n),
            })
        };
        (0..PARTS).filter_map(part).collect()
    }
}
