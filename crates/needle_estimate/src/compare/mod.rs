//! Predicted against measured: what one run of the twin produced, and its figures of merit.

pub mod alignment;
mod collector;
pub mod components;
pub mod crossing;
pub mod ensemble;
pub mod frozen;
pub mod identifier;
pub mod learning;
pub mod least_squares;
mod legs;
mod metrics;
pub mod path;
pub mod placement;
mod regions;
pub mod rows;
pub mod scale;
mod session;
mod stability;
pub mod uncertainty;
pub mod verdict;
mod watch;

pub use collector::{Collector, Keep};
pub use legs::{Legs, Pass};
pub use metrics::{ForceMetrics, Latency};
pub use regions::Depths;
pub use session::{Finished, Session};
use session::{not_finite, stamped};
pub use stability::StabilityRow;
pub use verdict::{Explains, Verdict};
pub use watch::{Cancel, Watch};

use needle_core::scene::Instrument;
use needle_core::twin::{Along, Event, Phase};

/// One answered pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Time of the pose, s since the first pose of the run.
    pub time_s: f64,
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Predicted force of the tissue on the instrument against its axis, N (positive resists insertion).
    pub predicted_n: f64,
    /// Measured force with the same sign, N, at the same time, where there is one.
    pub measured_n: Option<f64>,
    /// Predicted force of the tissue on the instrument in frame `sample`, N.
    pub predicted_vector_n: [f64; 3],
    /// Measured force in the same frame, N, where there is one.
    pub measured_vector_n: Option<[f64; 3]>,
    /// Phase.
    pub phase: Phase,
    /// Event since the last pose.
    pub event: Option<Event>,
    /// Explicit steps taken for this pose.
    pub steps: u32,
    /// Wall time from the pose's arrival to its prediction, s.
    pub latency_s: f64,
}

impl Answer {
    /// Predicted - measured force, N, where both are there and finite.
    #[must_use]
    pub fn residual_n(&self) -> Option<f64> {
        self.measured_n.map(|measured| self.predicted_n - measured).filter(|e| e.is_finite())
    }

    /// Length of predicted - measured force, N, where both are there and finite.
    #[must_use]
    pub fn vector_error_n(&self) -> Option<f64> {
        let measured = self.measured_vector_n?;
        let square: f64 = self.predicted_vector_n.iter().zip(measured).map(|(p, m)| (p - m) * (p - m)).sum();
        Some(square.sqrt()).filter(|e| e.is_finite())
    }
}

/// Something that happened to the tissue, with the predicted force on either side of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Occurrence {
    /// Of the pose that saw it, s since the first pose.
    pub time_s: f64,
    /// `puncture`, `layer` or `slip`.
    pub kind: String,
    /// Region that the tip came into, or is in.
    pub region: String,
    /// Tip depth, m.
    pub depth_m: f64,
    /// Force against the insertion, N.
    pub force_before_n: f64,
    /// Force against the insertion, N.
    pub force_after_n: f64,
}

/// Positions of all targets at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetRow {
    /// Time, s since the first pose.
    pub time_s: f64,
    /// Depth, m.
    pub depth_m: f64,
    /// Present position of each target, m, in the scene's order.
    pub positions: Vec<[f64; 3]>,
}

/// The tissue at the end of a run.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct FinalState {
    /// Reference points, m.
    pub points: Vec<[f64; 3]>,
    /// Background tetrahedra.
    pub cells: Vec<[u32; 4]>,
    /// Region of each of them ([`needle_core::twin::Twin::cell_regions`]); empty where the scene has none.
    pub region: Vec<u8>,
    /// Surface triangles, outward.
    pub surface: Vec<[u32; 3]>,
    /// Displacement at the points, m.
    pub displacement: Vec<[f64; 3]>,
    /// Volume ratio at the points.
    pub jacobian: Vec<f64>,
    /// Von Mises stress at the points, Pa.
    pub von_mises_pa: Vec<f64>,
}

/// The tissue at one moment of a run.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Snapshot {
    /// Time, s since the first pose.
    pub time_s: f64,
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Displacement at the points of [`FinalState::points`], m.
    pub displacement: Vec<[f64; 3]>,
    /// Volume ratio at the same points; empty if it was not computed.
    pub jacobian: Vec<f64>,
}

/// Everything that a finished run leaves; `report` turns it into files.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Run {
    /// Name of the scene.
    pub scene: String,
    /// Description of the scene.
    pub description: String,
    /// Word for the method (`mmls`, ...).
    pub method: String,
    /// Word for the dimension of the model (`full`, `axisymmetric`).
    pub dimension: String,
    /// Why, in one clause.
    pub dimension_because: String,
    /// Nodes of the model.
    pub nodes: usize,
    /// Integration points.
    pub integration_points: usize,
    /// One row per answered pose.
    pub answers: Vec<Answer>,
    /// What happened to the tissue, in its order.
    pub events: Vec<Occurrence>,
    /// Deformation coefficient of a needle with friction: time, s since the first pose; depth, m; tissue travel over needle travel.
    pub coefficients: Vec<[f64; 3]>,
    /// Names of the targets.
    pub target_names: Vec<String>,
    /// Their positions over time.
    pub targets: Vec<TargetRow>,
    /// Explicit steps in all.
    pub steps: u64,
    /// Wall time of building the twin, s.
    pub build_s: f64,
    /// Wall time of stepping alone, s.
    pub wall_s: f64,
    /// Simulated (or recorded) time, s.
    pub simulated_s: f64,
    /// Whether somebody waited for the answers: a live run. Else a pose was as late as the machine was slow, and nobody saw it.
    pub live: bool,
    /// Poses that were answered later than the next pose came.
    pub missed_deadlines: u64,
    /// Poses that were skipped because a newer one had come.
    pub coalesced_poses: u64,
    /// Reason, if the model diverged.
    pub diverged: Option<String>,
    /// Smallest volume ratio seen.
    pub min_jacobian: f64,
    /// Largest kinetic over strain energy seen once the force passed 10% of its peak.
    pub max_kinetic_to_strain_energy: f64,
    /// Largest |instrument force + base reaction| over the peak force.
    pub force_imbalance: f64,
    /// Largest constraint error, m.
    pub constraint_error_m: f64,
    /// Largest share of the strain energy in cells that had turned over.
    pub folded_energy: f64,
    /// Depth at which that was first more than the force can be trusted with, m.
    pub folded_from_m: Option<f64>,
    /// Times that the twin went back to the last good state and tried again with smaller steps.
    pub recoveries: u64,
    /// Nodes whose support was enlarged, since it did not determine the fit, or only just.
    pub repaired_supports: usize,
    /// Radius that the cloud gives a needle, m.
    pub effective_radius_m: Option<f64>,
    /// Hex of the hash over every predicted force and the final displacement field.
    pub checksum: String,
    /// What the measured force is (`synthetic bag needle_insertion`, ...); empty where there is none.
    pub measured_source: String,
    /// What was lost on the way (truncated bag, ...): makes the exit code 3.
    pub losses: Vec<String>,
    /// The tissue at the end.
    pub final_state: FinalState,
    /// The tissue at moments of the run, in order of time.
    pub snapshots: Vec<Snapshot>,
    /// Regions that the tip comes through.
    pub along: Along,
    /// Instrument of the scene.
    pub instrument: Option<Instrument>,
    /// The scene as it was run (presets and `--set` merged), TOML as `scene show` prints it.
    pub scene_toml: String,
    /// Whether force and position were stamped by one clock.
    pub one_clock: bool,
    /// Times of which nothing was recorded though the instrument may have moved, from and to, s of the recording.
    pub holes: Vec<[f64; 2]>,
    /// Word for what ran: `replay`, `solve`, `demo`.
    pub command: String,
    /// What members with other values of uncertain keys say, where there are some.
    pub ensemble: Option<ensemble::Ensemble>,
}
