//! The result of one recording: a file of its own that depends on no other row.

use serde::{Deserialize, Serialize};

use crate::baseline::Standing;
use crate::compare::Curve;

/// An identified key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// Dotted path.
    pub key: String,
    /// Value in the key's unit.
    pub value: f64,
    /// Standard error from noise and systematic errors; `None` if it is withheld.
    pub standard_error: Option<f64>,
    /// Standard error from noise alone, as the search returned it.
    pub noise_error: Option<f64>,
}

/// The prediction of the held-out part of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Root mean square of predicted - measured over the readings, N.
    pub rmse_n: f64,
    /// Recorded depth of the deepest reading, m.
    pub end_depth_m: f64,
    /// Measured force at that depth minus the load cell's zero, N.
    pub end_measured_n: f64,
    /// Predicted force at that depth, N.
    pub end_predicted_n: f64,
}

impl HeldOut {
    /// Relative error of the force at the end.
    #[must_use]
    pub fn end_error(&self) -> f64 {
        self.end_predicted_n / self.end_measured_n - 1.0
    }
}

/// The fit of a recording with one candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Name of the candidate.
    pub candidate: String,
    /// Name of the scene.
    pub scene: String,
    /// Reason of the failure, if it failed; the other fields are then empty.
    pub failed: Option<String>,
    /// The verdict: `yes`, `in part`, `no`, `no measurement`.
    pub explains: String,
    /// Reduced chi-square.
    pub reduced_chi_square: Option<f64>,
    /// The verdict's reasons.
    pub reasons: Vec<String>,
    /// Identified keys.
    pub keys: Vec<Key>,
    /// Recorded depth of the contact, m.
    pub contact_depth_m: f64,
    /// The load cell's zero, N.
    pub force_zero_n: f64,
    /// Largest measured force over the fitted part minus the zero, N.
    pub peak_n: f64,
    /// Root mean square error over the fitted part, N.
    pub rmse_n: Option<f64>,
    /// Forward error: the model is fitted to the first part of the fitted part and predicts the rest. Root mean
    /// square of the prediction error divided by `peak_n`; `None` if it was not requested.
    pub forward_error: Option<f64>,
    /// Number of runs of the twin.
    pub runs: u32,
    /// The held-out part, if any.
    pub held_out: Option<HeldOut>,
    /// Errors of the baselines; over the held-out part if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standing: Option<Standing>,
    /// Measured and predicted force over the depth since contact.
    pub curve: Curve,
}

impl Fit {
    /// `rmse_n` over `peak_n`.
    #[must_use]
    pub fn nrmse(&self) -> Option<f64> {
        self.rmse_n.map(|rmse| rmse / self.peak_n).filter(|x| x.is_finite())
    }
}

/// The result of a recording with every candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Position in the manifest, from 0.
    pub number: usize,
    /// Number of recordings in the manifest.
    pub of: usize,
    /// Name of the row.
    pub name: String,
    /// Its sample.
    pub sample: String,
    /// Its kind of samples.
    pub group: String,
    /// Kinds of samples that share the chosen candidate.
    pub chosen_for: String,
    /// Hash of everything that the row depends on.
    pub fingerprint: String,
    /// Reason of the failure, if it failed; there are then no fits.
    pub failed: Option<String>,
    /// Losses of the recording (truncated file, dropped messages).
    pub losses: Vec<String>,
    /// One per candidate.
    pub fits: Vec<Fit>,
}

impl Row {
    /// The fit with a candidate, if it did not fail.
    pub(super) fn fit(&self, candidate: &str) -> Option<&Fit> {
        self.fits.iter().find(|fit| fit.candidate == candidate && fit.failed.is_none())
    }
}
