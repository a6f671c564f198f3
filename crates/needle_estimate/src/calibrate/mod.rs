//! Calibration: finds the values of scene keys that minimise the difference of the twin's force and a recorded one.
//!
//! ```text
//! smallest sum_i (F(d_1..i; keys) + offset + drift t_i - F_measured,i)^2
//! ```
//!
//! If the load cell measured the force as a vector and the model is three-dimensional, the components across the axis
//! are fitted as well. Each has its own noise, zero and drift (`compare::components`). Every F is a complete run of
//! the twin over the recorded motion, the same as in `replay`. Offset and drift of the load cell are estimated too.
//! So are the depth of first contact and the offset between the clocks of force and position, if the recording shows
//! that they are wrong (`compare::alignment`). Otherwise they stay as recorded.
//!
//! A model that does not explain the readings is rejected. What the data can't determine has no interval
//! (`judgement`).

mod alternatives;
mod common;
mod components;
mod curve_table;
mod error;
mod forces;
mod hold;
mod joint;
mod judgement;
mod markers;
mod paths;
mod prediction;
mod problem;
mod runs;
mod search;
mod spikes;
mod split;
mod start;
mod task;
mod tie;
mod unknown;
mod wanted;

use std::ops::Range;

use crate::compare::alignment::Alignment;
use crate::compare::{Depths, Verdict, Watch};
use needle_core::scene::{Align, Metres, Override, Scene, Seconds};

pub use alternatives::{Alternative, Assumption, alternatives};
pub use curve_table::CurveTable;
pub use error::CalibrateError;
pub use forces::{Forces, rmse};
pub use joint::JointKey;
pub(crate) use joint::calibrate_together;
pub use joint::{Joint, Own};
pub use markers::MarkerEstimate;
pub use markers::{MarkerFit, MarkerResidual, MarkerTask, calibrate_markers};
pub use prediction::{Prediction, predict};
use problem::Recorded;
use search::{Searched, aligned, search};
pub use split::{HoldOut, Parts};
pub use task::{LoadCell, Task};
pub(crate) use unknown::SCALE_KEY;
use unknown::Sought;
pub use wanted::Wanted;

/// Half-width of a 95% interval, in standard errors.
pub(crate) const INTERVAL_95: f64 = 1.96;
/// Share of the way up to which a depth counts as the deepest.
const NEARLY: f64 = 0.02;
/// One estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The scene's key, or `load_cell.offset_n`, `load_cell.drift_n_per_s`.
    pub name: String,
    /// The identified value.
    pub value: f64,
    /// Start of the search.
    pub start: f64,
    /// Least and largest value.
    pub bounds: [f64; 2],
    /// Standard error from noise; `None` where the data don't determine the value.
    pub noise_error: Option<f64>,
    /// Standard error from [`Task::force_error`].
    pub systematic_error: Option<f64>,
    /// Whether it has any effect on the data.
    pub has_effect: bool,
    /// Reason if the error and the interval are withheld.
    pub withheld: Option<String>,
}

impl Estimate {
    /// Standard error from noise and systematic errors, in the unit of the value. `None` where the data don't
    /// determine it, or it is withheld.
    #[must_use]
    pub fn standard_error(&self) -> Option<f64> {
        self.noise_error.zip(self.systematic_error).map(|(a, b)| a.hypot(b)).filter(|_| self.withheld.is_none())
    }

    /// The 95% interval, clipped to the bounds.
    #[must_use]
    pub fn interval_95(&self) -> Option<[f64; 2]> {
        let half = INTERVAL_95 * self.standard_error()?;
        let [low, high] = self.bounds;
        Some([(self.value - half).max(low), (self.value + half).min(high)])
    }

    /// Whether the search ended at a bound.
    #[must_use]
    pub fn at_bound(&self) -> bool {
        self.value <= self.bounds[0] || self.value >= self.bounds[1]
    }
}

/// Result of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The scene with the identified values.
    pub scene: Scene,
    /// The keys, in the requested order, then the load cell's.
    pub estimates: Vec<Estimate>,
    /// How many of the estimates are keys.
    pub keys: usize,
    /// Keys that were equal to a wanted one in the scene and took its value: the key, and the wanted one.
    pub tied: Vec<(String, String)>,
    /// Correlation of the estimates' errors; `None` where one of the two is not determined.
    pub correlation: Vec<Vec<Option<f64>>>,
    /// Groups of estimates that the data can't distinguish, by name.
    pub indistinguishable: Vec<Vec<String>>,
    /// Measured force and the twin's, before and after the fit.
    pub forces: Forces,
    /// Regions of the tip over the depth, with the identified values; empty if the scene has none.
    pub regions: Vec<Depths>,
    /// Fitted readings and held-out readings, as indices into `forces`.
    pub parts: Parts,
    /// Number of readings of the fitted part that were excluded as spikes.
    pub left_out: usize,
    /// Iterations of the search.
    pub iterations: usize,
    /// Number of runs of the twin.
    pub runs: u32,
    /// Whether the search converged; otherwise it reached the iteration limit.
    pub converged: bool,
    /// Whether the model with the identified values explains the readings.
    pub verdict: Verdict,
    /// Alignment of the recording with the model: contact depth, clock offset and zero.
    pub alignment: Option<Alignment>,
    /// Whether the recording was corrected for the contact depth and for the clock offset.
    pub realigned: [bool; 2],
    /// Number of poses that the twin refused.
    pub refused: usize,
    /// Unknowns from which the load cell's drift could not be distinguished, so that the drift was left out
    /// ([`LoadCell::Auto`]). Empty if it was not.
    pub drift_left_out_for: Vec<String>,
    /// The fit under other assumptions, if it was made ([`alternatives()`]).
    pub alternatives: Vec<Alternative>,
}

impl Calibration {
    /// Root mean square residual over the fitted part, spikes included, N.
    #[must_use]
    pub fn rmse_n(&self) -> f64 {
        self.rmse_of(&self.parts.fitted)
    }

    /// The same over the held-out readings, if any, N.
    #[must_use]
    pub fn held_out_rmse_n(&self) -> Option<f64> {
        self.parts.held_out.as_ref().map(|range| self.rmse_of(range))
    }

    fn rmse_of(&self, range: &Range<usize>) -> f64 {
        rmse(&self.forces.measured_n[range.clone()], &self.forces.fitted_n[range.clone()])
    }

    /// Whether the model is rejected: it explains the readings with no values of the keys. Too few readings for a
    /// verdict reject nothing.
    #[must_use]
    pub fn rejected(&self) -> bool {
        self.verdict.explains != crate::compare::Explains::Yes && !self.verdict.too_little
    }

    /// Whether the fitted readings end where the instrument is deepest, without a rest there.
    fn only_goes_in(&self) -> bool {
        let depths = self.forces.depth_m.get(self.parts.fitted.clone()).unwrap_or_default();
        let (low, deep) = depths.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), d| (a.min(*d), b.max(*d)));
        let nearly = |d: &f64| *d >= deep - NEARLY * (deep - low);
        let first = depths.iter().position(nearly).unwrap_or(0);
        depths.last().is_some_and(nearly) && (depths.len() - first) as f64 <= 3.0 * NEARLY * depths.len() as f64
    }

    /// Merges the alignment. Values that were sought come from the search; the others were estimated on the last run.
    fn with_alignment(mut self, seen: Option<Alignment>) -> Self {
        let of = |names: [&str; 2]| {
            let found = self.estimates.iter().find(|e| names.contains(&e.name.as_str()))?;
            Some(crate::compare::alignment::Found { value: found.value, error: found.standard_error() })
        };
        let contact = of([unknown::CONTACT_KEY; 2]);
        let clock = of([unknown::CLOCK_KEY; 2]);
        let zero = of([unknown::ZERO_KEY, unknown::OFFSET_KEY]);
        self.alignment =
            seen.or_else(|| (contact.is_some() || clock.is_some()).then(Alignment::default)).map(|seen| Alignment {
                contact_depth_m: contact.unwrap_or(seen.contact_depth_m),
                time_offset_s: clock.unwrap_or(seen.time_offset_s),
                force_zero_n: zero.unwrap_or(seen.force_zero_n),
                ..seen
            });
        self
    }

    /// Refers estimates and alignment to the recording as it was recorded: adds the correction of the scene's
    /// `[align]`.
    fn of_recording(mut self, sought: &[Sought], scene: &Scene) -> Self {
        for (e, sought) in self.estimates.iter_mut().zip(sought) {
            let before = sought.aligned(scene);
            e.value += before;
            e.start += before;
            e.bounds = e.bounds.map(|bound| bound + before);
        }
        if let Some(seen) = &mut self.alignment {
            seen.contact_depth_m.value += Sought::Contact.aligned(scene);
            seen.time_offset_s.value += Sought::Clock.aligned(scene);
            seen.force_zero_n.value += Sought::Zero { asked: false }.aligned(scene);
        }
        self
    }

    /// What to do if the data can't distinguish the members of a group.
    #[must_use]
    pub fn remedy(&self, group: &[String]) -> String {
        let keys: Vec<&str> = self.estimates[..self.keys].iter().map(|e| e.name.as_str()).collect();
        let several = group.iter().filter(|name| keys.contains(&name.as_str())).count() > 1;
        match (judgement::cure(group), several) {
            ("", true) => "fit fewer of them, or fix one by --set from another test".to_owned(),
            ("", false) => {
                "fix it by --set from another test, or take a recording that also has the approach and the way out"
                    .to_owned()
            }
            (cure, _) => cure.trim_start_matches("; ").to_owned(),
        }
    }

    /// The estimate with a name.
    #[must_use]
    pub fn estimate(&self, name: &str) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.name == name)
    }
}

/// Runs the search.
///
/// # Errors
/// [`CalibrateError`] if a key can't be searched for, the scene can't be run with its own values, or there are too
/// few readings.
pub fn calibrate(
    task: &Task,
    watch: &mut dyn Watch,
    tell: &mut dyn FnMut(&str),
) -> Result<Calibration, CalibrateError> {
    let begun = start::begun(task);
    let task = &Task { scene: begun.as_ref().unwrap_or(task.scene), ..task.clone() };
    let held = hold::begun(task);
    let task = &Task { scene: held.as_ref().map_or(task.scene, |held| &held.scene), ..task.clone() };
    let mut found = found(task, watch, tell)?;
    held.iter().for_each(|held| held.withhold(&mut found.estimates));
    Ok(found)
}

/// Searches, and again without the load cell's drift where it can't be told from a key ([`LoadCell::Auto`]). On a way in alone the
/// model's error in the curve's bend passes for a drift: one that no load cell has is left out if the model explains the readings so.
fn found(task: &Task, watch: &mut dyn Watch, tell: &mut dyn FnMut(&str)) -> Result<Calibration, CalibrateError> {
    let found = searched(task, watch, tell)?;
    let drifts = |group: &Vec<String>| group.iter().any(|name| name == unknown::DRIFT_KEY);
    let group = found.indistinguishable.iter().find(|g| drifts(g)).cloned();
    let bent = || found.rejected() && found.estimate(unknown::DRIFT_KEY).is_some() && found.only_goes_in();
    if task.load_cell != LoadCell::Auto || (group.is_none() && !bent()) {
        return Ok(found);
    }
    tell("without the load cell's drift");
    let again = searched(&Task { load_cell: LoadCell::Offset, ..task.clone() }, watch, tell)?;
    if group.is_none() && again.rejected() {
        return Ok(Calibration { runs: found.runs + again.runs, ..found });
    }
    let all = || found.estimates[..found.keys].iter().map(|e| e.name.clone()).collect();
    let others: Vec<String> = group.unwrap_or_else(all).into_iter().filter(|name| name != unknown::DRIFT_KEY).collect();
    Ok(Calibration { runs: found.runs + again.runs, drift_left_out_for: others, ..again })
}

/// Runs the search with exactly the load cell parameters that the task requests.
fn searched(task: &Task, watch: &mut dyn Watch, tell: &mut dyn FnMut(&str)) -> Result<Calibration, CalibrateError> {
    let sought = Sought::all(task.wanted, task.load_cell);
    let mut problem = Recorded::new(task, sought, watch, tell);
    let Searched { mut unknowns, begun, solution, realigned, left_out } = search(&mut problem, task)?;
    unknowns.iter_mut().zip(begun).for_each(|(u, start)| u.start = start);
    let changes = problem.changes(&solution.x);
    // keep the step count of these runs, or a replay would give another force
    let mut scene = problem.common.posed(&task.scene.with(&changes)?);
    scene.align = align(&problem, task.scene, &solution.x);
    let forces = problem.forces(&solution.x)?;
    let found = Calibration {
        left_out,
        realigned,
        ..judgement::judged(task, scene, &solution, &unknowns, forces, &mut problem)?
    };
    let seen = aligned(&mut problem, &solution.x)?;
    Ok(found.with_alignment(seen).of_recording(&problem.sought, task.scene))
}

/// Alignment of the recording with the model at the values x: the scene's own correction plus what the search found.
fn align(problem: &Recorded, scene: &Scene, x: &[f64]) -> Option<Align> {
    let of = |wanted: fn(&Sought) -> bool| problem.sought.iter().position(wanted).map_or(0.0, |k| x[k]);
    let found = Align {
        contact_depth: Metres(of(|s| *s == Sought::Contact)),
        time_offset: Seconds(of(|s| *s == Sought::Clock)),
        zero_n: of(|s| matches!(s, Sought::Zero { .. })),
        drift_n_per_s: of(|s| *s == Sought::Drift),
    };
    Some(scene.align.unwrap_or(Align::NONE).then(found)).filter(|align| *align != Align::NONE)
}

/// The identified keys that a scene has, with their values: to transfer them to another scene.
#[must_use]
pub(crate) fn carried(calibration: &Calibration, scene: &Scene) -> Vec<Override> {
    let keys = calibration.estimates[..calibration.keys].iter();
    let tied =
        calibration.tied.iter().filter_map(|(key, other)| Some((key.as_str(), calibration.estimate(other)?.value)));
    let all = keys.map(|e| (e.name.as_str(), e.value)).chain(tied).filter(|(key, _)| scene.get(key).is_some());
    // the alignment belongs to the fitted recording alone
    let all = all.filter(|(key, _)| !key.starts_with("align."));
    all.map(|(key, value)| Override::typed(key, value, "calibrate")).collect()
}
