//! What an ensemble adds to a run.

use super::assimilate::Assimilated;
use super::band::{Band, Spread};
use needle_core::scene::Uncertain;

/// Result of an ensemble for a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ensemble {
    /// Number of members that were requested.
    pub members: usize,
    /// Number of members that completed their run. The others are left out of all results.
    pub used: usize,
    /// Number of runs of a twin.
    pub runs: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Keys that were drawn.
    pub keys: Vec<Uncertain>,
    /// Band of the force at each answer of the run; `None` if no member has an answer.
    pub bands: Vec<Option<Band>>,
    /// Depth to which [`Ensemble::targets`] refer, the largest of the run, m.
    pub target_depth_m: f64,
    /// Each target of the scene at that depth; empty if no member reached it.
    pub targets: Vec<Spread>,
    /// Data assimilation, if there were measurements: the answers that the load cell's readings belong to, and the
    /// result.
    pub assimilated: Option<(Vec<usize>, Assimilated)>,
    /// Wall time of all members, building included, s.
    pub wall_s: f64,
}

impl Ensemble {
    /// Mean width of the band, N; `None` without a band.
    #[must_use]
    pub fn mean_width_n(&self) -> Option<f64> {
        let widths: Vec<f64> = self.bands.iter().flatten().map(|band| band.high_n - band.low_n).collect();
        (!widths.is_empty()).then(|| widths.iter().sum::<f64>() / widths.len() as f64)
    }
}
