//! The result of a calibration.

use std::ops::Range;

use super::forces::{Forces, rmse};
use super::split::Parts;
use super::unknown::{self, Sought};
use crate::compare::alignment::{Alignment, Found};
use crate::compare::{Depths, Explains, Verdict};
use needle_core::scene::Scene;

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
    /// Standard error from [`Task::force_error`](super::Task::force_error).
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
    /// ([`LoadCell::Auto`](super::LoadCell::Auto)). Empty if it was not.
    pub drift_left_out_for: Vec<String>,
    /// The fit under other assumptions, if it was made ([`alternatives()`](super::alternatives())).
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
        self.verdict.explains != Explains::Yes && !self.verdict.too_little
    }

    /// Whether the fitted readings end where the instrument is deepest, without a rest there.
    pub(super) fn only_goes_in(&self) -> bool {
        let depths = self.forces.depth_m.get(self.parts.fitted.clone()).unwrap_or_default();
        let (low, deep) = depths.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), d| (a.min(*d), b.max(*d)));
        let nearly = |d: &f64| *d >= deep - NEARLY * (deep - low);
        let first = depths.iter().position(nearly).unwrap_or(0);
        depths.last().is_some_and(nearly) && (depths.len() - first) as f64 <= 3.0 * NEARLY * depths.len() as f64
    }

    /// Merges the alignment. Values that were sought come from the search; the others were estimated on the last run.
    pub(super) fn with_alignment(mut self, seen: Option<Alignment>) -> Self {
        let of = |names: [&str; 2]| {
            let found = self.estimates.iter().find(|e| names.contains(&e.name.as_str()))?;
            Some(Found { value: found.value, error: found.standard_error() })
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
    pub(super) fn of_recording(mut self, sought: &[Sought], scene: &Scene) -> Self {
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
        match (cure(group), several) {
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

/// The fit under another assumption.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    /// What was assumed instead.
    pub what: String,
    /// The requested keys, in their order, under their own names.
    pub estimates: Vec<Estimate>,
    /// Whether it explains the readings.
    pub verdict: Verdict,
    /// Root mean square residual, N.
    pub rmse_n: f64,
    /// Number of runs of the twin.
    pub runs: u32,
}

impl Alternative {
    /// Whether the readings do not exclude it.
    #[must_use]
    pub fn explains(&self) -> bool {
        self.verdict.explains == Explains::Yes
    }
}

impl Calibration {
    /// The 95% interval of a requested key: its own, and those of all alternatives that explain the readings.
    #[must_use]
    pub fn interval_95(&self, k: usize) -> Option<[f64; 2]> {
        let own = self.estimates.get(k)?.interval_95()?;
        let others = self.alternatives.iter().filter(|a| a.explains()).filter_map(|a| a.estimates.get(k));
        Some(others.fold(own, |[low, high], e| {
            let [l, h] = e.interval_95().unwrap_or([e.value; 2]);
            [low.min(l), high.max(h)]
        }))
    }
}

/// The option that removes one of several indistinguishable unknowns; empty if there is none.
pub(super) fn cure(group: &[String]) -> &'static str {
    let has = |key: &str| group.iter().any(|name| name == key);
    if has(unknown::DRIFT_KEY) {
        "; --load-cell offset leaves the load cell's drift out"
    } else if has(unknown::OFFSET_KEY) {
        "; --load-cell exact takes the load cell at its word"
    } else {
        ""
    }
}
