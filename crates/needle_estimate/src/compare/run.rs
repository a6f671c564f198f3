//! The result of one run of the twin.

use super::ensemble::{Band, Ensemble};
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
    /// Measured force at the same time with the same sign, N, if there is one.
    pub measured_n: Option<f64>,
    /// Predicted force of the tissue on the instrument in frame `sample`, N.
    pub predicted_vector_n: [f64; 3],
    /// Measured force in the same frame, N, if there is one.
    pub measured_vector_n: Option<[f64; 3]>,
    /// Error of the prediction that discretisation and steps make, N ([`needle_core::twin::Prediction::model_error_n`]).
    pub model_error_n: f64,
    /// Phase of the insertion.
    pub phase: Phase,
    /// Event since the last pose.
    pub event: Option<Event>,
    /// Explicit steps taken for this pose.
    pub steps: u32,
    /// Wall time from the pose's arrival to its prediction, s.
    pub latency_s: f64,
}

impl Answer {
    /// Predicted - measured force, N, if both are known and finite.
    #[must_use]
    pub fn residual_n(&self) -> Option<f64> {
        self.measured_n.map(|measured| self.predicted_n - measured).filter(|e| e.is_finite())
    }

    /// Length of the vector predicted - measured, N, if both are known and finite.
    #[must_use]
    pub(crate) fn vector_error_n(&self) -> Option<f64> {
        let measured = self.measured_vector_n?;
        let square: f64 = self.predicted_vector_n.iter().zip(measured).map(|(p, m)| (p - m) * (p - m)).sum();
        Some(square.sqrt()).filter(|e| e.is_finite())
    }
}

/// An event in the tissue, with the predicted force before and after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Occurrence {
    /// Time of the pose that detected it, s since the first pose.
    pub time_s: f64,
    /// `puncture`, `layer` or `slip`.
    pub kind: String,
    /// Region that the tip entered, or is in.
    pub region: String,
    /// Tip depth, m.
    pub depth_m: f64,
    /// Force against the insertion before it, N.
    pub force_before_n: f64,
    /// Force against the insertion after it, N.
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
    /// Region of each of them ([`needle_core::twin::Twin::cell_regions`]); empty if the scene has no regions.
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

/// A needle that bends, at one answer.
#[derive(Clone, Debug, PartialEq)]
pub struct NeedleRow {
    /// Time, s since the first pose.
    pub time_s: f64,
    /// Depth of the tip of the straight needle, m.
    pub depth_m: f64,
    /// Place of the tip in frame `sample`, m.
    pub tip: [f64; 3],
    /// Distance of the tip from that of the straight needle, m.
    pub aside_m: f64,
    /// Force at the load cell in frame `sample`, N.
    pub force_n: [f64; 3],
    /// Torque about the load cell's origin, N m.
    pub torque_nm: [f64; 3],
}

/// The tissue at one time of a run.
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
    /// Places along a needle that bends, from the clamp to the tip, m; empty for another instrument.
    pub needle: Vec<[f64; 3]>,
}

/// The complete result of a finished run; `report` writes it to files.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Run {
    /// Name of the scene.
    pub scene: String,
    /// Description of the scene.
    pub description: String,
    /// Name of the method (`mmls`, ...).
    pub method: String,
    /// Name of the model's dimension (`full`, `axisymmetric`).
    pub dimension: String,
    /// Reason for that dimension, in one clause.
    pub dimension_because: String,
    /// Number of nodes of the model.
    pub nodes: usize,
    /// Number of integration points.
    pub integration_points: usize,
    /// One row per answered pose.
    pub answers: Vec<Answer>,
    /// Events in the tissue, in order of time.
    pub events: Vec<Occurrence>,
    /// Deformation coefficient of a needle with friction: time, s since the first pose; depth, m; displacement of the
    /// tissue over that of the needle.
    pub coefficients: Vec<[f64; 3]>,
    /// Where a needle that bends was at each answer.
    pub needle: Vec<NeedleRow>,
    /// Names of the targets.
    pub target_names: Vec<String>,
    /// Their positions over time.
    pub targets: Vec<TargetRow>,
    /// Total number of explicit steps.
    pub steps: u64,
    /// Wall time of building the twin, s.
    pub build_s: f64,
    /// Wall time of stepping alone, s.
    pub wall_s: f64,
    /// Simulated (or recorded) time, s.
    pub simulated_s: f64,
    /// Whether it is a live run, for which latency matters. Otherwise the delay of a pose only reflects the speed of
    /// the machine.
    pub live: bool,
    /// Number of poses that were answered after the next pose had arrived.
    pub missed_deadlines: u64,
    /// Number of poses that were skipped because a newer one had arrived.
    pub coalesced_poses: u64,
    /// Reason, if the model diverged.
    pub diverged: Option<String>,
    /// Smallest volume ratio.
    pub min_jacobian: f64,
    /// Largest kinetic over strain energy after the force exceeded 10% of its peak.
    pub max_kinetic_to_strain_energy: f64,
    /// Largest |instrument force + base reaction| over the peak force.
    pub force_imbalance: f64,
    /// The same as a root mean square over the answers.
    pub force_imbalance_rms: f64,
    /// The same of the imbalance or of [`needle_core::twin::Health::approximations_apart_n`], whichever is less at a pose; `None` of a run that is
    /// known by its messages alone.
    pub step_error_rms: Option<f64>,
    /// Error that the scene allows force and targets (`accuracy`).
    pub accuracy: f64,
    /// Largest constraint error, m.
    pub constraint_error_m: f64,
    /// Largest share of the strain energy in inverted cells.
    pub folded_energy: f64,
    /// Depth at which that share first exceeded the limit up to which the force is reliable, m.
    pub folded_from_m: Option<f64>,
    /// Number of recoveries: the twin returned to the last good state and repeated the pose with smaller steps.
    pub recoveries: u64,
    /// Number of nodes whose support was enlarged, because it did not determine the fit, or only just.
    pub repaired_supports: usize,
    /// Effective radius of a needle in the cloud, m.
    pub effective_radius_m: Option<f64>,
    /// Hex of the hash over every predicted force and the final displacement field.
    pub checksum: String,
    /// Source of the measured force (`synthetic bag needle_insertion`, ...); empty without one.
    pub measured_source: String,
    /// Losses of data (truncated bag, ...): they make the exit code 3.
    pub losses: Vec<String>,
    /// The tissue at the end.
    pub final_state: FinalState,
    /// The tissue at several times of the run, in order of time.
    pub snapshots: Vec<Snapshot>,
    /// Regions along the path of the tip.
    pub along: Along,
    /// Instrument of the scene.
    pub instrument: Option<Instrument>,
    /// The scene as it was run (presets and `--set` merged), TOML as `scene show` prints it.
    pub scene_toml: String,
    /// Number of readings of the load cell during the motion, if it is known.
    pub force_readings: Option<usize>,
    /// Whether force and position were stamped by one clock.
    pub one_clock: bool,
    /// Intervals without recorded data during which the instrument may have moved, from and to, s of the recording.
    pub holes: Vec<[f64; 2]>,
    /// Name of the command: `replay`, `solve`, `demo`.
    pub command: String,
    /// Results of an ensemble, if there is one.
    pub ensemble: Option<Ensemble>,
}

impl Run {
    /// What is drawn about the force at an answer, N: the ends of the members' band, or else the force less and plus its model's error.
    #[must_use]
    pub fn shown_band(&self, answer: usize) -> Option<[f64; 2]> {
        if self.ensemble.is_some() {
            return self.band(answer).map(|band| [band.low_n, band.high_n]);
        }
        let Answer { predicted_n, model_error_n, .. } = *self.answers.get(answer)?;
        Some([predicted_n - model_error_n, predicted_n + model_error_n])
            .filter(|ends| ends.iter().all(|f| f.is_finite()))
    }

    /// What that band is, in words.
    #[must_use]
    pub const fn band_name(&self) -> &'static str {
        if self.ensemble.is_some() { "95 % of members" } else { "error of the model" }
    }

    /// Band of the force at an answer, if there is an ensemble.
    #[must_use]
    pub fn band(&self, answer: usize) -> Option<Band> {
        self.ensemble.as_ref()?.bands.get(answer).copied().flatten()
    }

    /// Share of the measured forces inside the ensemble's band; `None` without an ensemble or measured forces.
    #[must_use]
    pub fn share_inside(&self) -> Option<f64> {
        let bands = &self.ensemble.as_ref()?.bands;
        let both = |(a, band): (&Answer, &Option<Band>)| Some((a.measured_n.filter(|m| m.is_finite())?, (*band)?));
        let pairs = self.answers.iter().zip(bands).filter_map(both);
        let inside: Vec<bool> = pairs.map(|(measured, band)| band.holds(measured)).collect();
        (!inside.is_empty()).then(|| inside.iter().filter(|i| **i).count() as f64 / inside.len() as f64)
    }
}
