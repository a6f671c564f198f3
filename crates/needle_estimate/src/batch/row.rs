//! What is known of one recording: a file of its own, which depends on no other.

use serde::{Deserialize, Serialize};

use super::Curve;

/// A key that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// Dotted path.
    pub key: String,
    /// In its unit.
    pub value: f64,
    /// Standard error by noise and systematic errors; `None` where it is withheld.
    pub standard_error: Option<f64>,
    /// Standard error by noise alone, as the search left it.
    pub noise_error: Option<f64>,
}

/// What of the recording was predicted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Root mean square of predicted - measured over the readings, N.
    pub rmse_n: f64,
    /// Recorded depth of the deepest reading, m.
    pub end_depth_m: f64,
    /// Measured force there, less the load cell's zero, N.
    pub end_measured_n: f64,
    /// Predicted there, N.
    pub end_predicted_n: f64,
}

impl HeldOut {
    /// Relative error of the force at the end.
    #[must_use]
    pub fn end_error(&self) -> f64 {
        self.end_predicted_n / self.end_measured_n - 1.0
    }
}

/// A recording with one candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Name of the candidate.
    pub candidate: String,
    /// Name of the scene.
    pub scene: String,
    /// Why there is nothing else, if so.
    pub failed: Option<String>,
    /// The verdict: `yes`, `in part`, `no`, `no measurement`.
    pub explains: String,
    /// Reduced chi-square.
    pub reduced_chi_square: Option<f64>,
    /// The verdict's reasons.
    pub reasons: Vec<String>,
    /// Keys.
    pub keys: Vec<Key>,
    /// Recorded depth of the contact, m.
    pub contact_depth_m: f64,
    /// The load cell's zero, N.
    pub force_zero_n: f64,
    /// Largest measured force over the fitted part less the zero, N.
    pub peak_n: f64,
    /// Root mean square over the fitted part, N.
    pub rmse_n: Option<f64>,
    /// Fitted to the first part of the fitted part, the root mean square over the rest of it over `peak_n`, where that was asked for.
    pub forward_error: Option<f64>,
    /// Runs of the twin.
    pub runs: u32,
    /// What was predicted.
    pub held_out: Option<HeldOut>,
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

/// A recording with every candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Place in the manifest, from 0, and how many recordings that has.
    pub number: usize,
    /// See `number`.
    pub of: usize,
    /// Name of the row.
    pub name: String,
    /// Its sample.
    pub sample: String,
    /// Its kind of samples.
    pub group: String,
    /// Kinds that share the candidate that is chosen.
    pub chosen_for: String,
    /// Hash of all that the row depends on.
    pub fingerprint: String,
    /// Why there is nothing else, if so.
    pub failed: Option<String>,
    /// What was lost of the recording.
    pub losses: Vec<String>,
    /// One per candidate.
    pub fits: Vec<Fit>,
}
