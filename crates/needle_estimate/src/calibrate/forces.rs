//! Measured and predicted force over a recording.

/// One row per pose that has a measured force.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forces {
    /// Since the first pose, s.
    pub time_s: Vec<f64>,
    /// Depth of the tip, m.
    pub depth_m: Vec<f64>,
    /// Reading of the load cell, N, positive against the insertion.
    pub measured_n: Vec<f64>,
    /// Force of the twin with the values at the start of the search, N.
    pub start_n: Vec<f64>,
    /// Force of the twin with the identified values, N.
    pub model_n: Vec<f64>,
    /// `model_n` plus the load cell's offset and drift, N: the expected reading of the load cell.
    pub fitted_n: Vec<f64>,
}

/// Root mean square of the difference, N; 0 for empty slices.
#[must_use]
pub(crate) fn rmse(a: &[f64], b: &[f64]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    if a.is_empty() { 0.0 } else { (sum / a.len() as f64).sqrt() }
}
