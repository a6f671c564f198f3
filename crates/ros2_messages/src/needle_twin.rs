//! Package `needle_twin`: our own messages. The .msg files in `msg/` are the contract; units and signs stand there.

use super::builtin_interfaces::Time;
use super::geometry_msgs::{Point, Vector3};
use super::ros_messages;
use super::std_msgs::Header;
use serde::{Deserialize, Serialize};

/// The tissue model at rest (`msg/TissueModel.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TissueModel {
    /// When the model was built, and its frame.
    pub header: Header,
    /// The same number in every [`TissueState`] of this model; never 0.
    pub model_id: u64,
    /// Name of the scene.
    pub scene: String,
    /// `mmls`, `mls` or `tet4`.
    pub method: String,
    /// Integration points of the solver.
    pub integration_points: u32,
    /// Undeformed positions, m.
    pub reference_points: Vec<Point>,
    /// Three indices per triangle, seen from outside anticlockwise.
    pub surface_triangles: Vec<u32>,
    /// Four indices per background tetrahedron.
    pub cells: Vec<u32>,
    /// Names of the targets, in the order of the topic `targets`.
    pub target_names: Vec<String>,
    /// Undeformed positions of the targets, m.
    pub target_references: Vec<Point>,
}

/// Deformation at one time (`msg/TissueState.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TissueState {
    /// Stamp of the pose that led here, and the frame.
    pub header: Header,
    /// That of the [`TissueModel`].
    pub model_id: u64,
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Displacement of the field at the reference points, m.
    pub displacements: Vec<Vector3>,
}

/// The force as an ensemble predicts it (`msg/ForceBand.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceBand {
    /// Stamp of the pose that the members answered, and the frame.
    pub header: Header,
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Mean of the members, N.
    pub mean_n: f64,
    /// Their standard deviation, N.
    pub standard_deviation_n: f64,
    /// 2.5 % of their distribution lie below, N.
    pub low_n: f64,
    /// 97.5 % lie below, N.
    pub high_n: f64,
    /// Members that have an answer.
    pub members: u32,
}

/// What members that look ahead say of the next piece of the way (`msg/Outlook.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outlook {
    /// Stamp of the pose from which they look ahead, and the frame.
    pub header: Header,
    /// Depth of the tip at that pose, m.
    pub depth_m: f64,
    /// Depths of the tip on the way, from `depth_m` on, m.
    pub depths_m: Vec<f64>,
    /// Members that have an answer at all of them.
    pub members: u32,
    /// Force against the insertion of each member at each depth, N.
    pub forces_n: Vec<f64>,
    /// Standard deviation of what a reading is off by beyond the members' spread, N.
    pub error_n: f64,
    /// Targets of the scene.
    pub targets: u32,
    /// Of each member each target with the tip at the first depth, m.
    pub targets_now: Vec<Point>,
    /// The same at the last depth, m.
    pub targets_ahead: Vec<Point>,
    /// Blocks of readings since the last reset.
    pub blocks: u64,
    /// Of them rejected.
    pub rejected_blocks: u64,
}

/// Something that happened to the tissue at a needle (`msg/TissueEvent.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TissueEvent {
    /// Stamp of the pose that saw it, and the frame.
    pub header: Header,
    /// Of the events since the last reset, from 1.
    pub number: u64,
    /// One of the constants.
    pub kind: String,
    /// Region that the tip came into, or is in.
    pub region: String,
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Force against the direction of insertion before it, N.
    pub force_before_n: f64,
    /// And after it, N.
    pub force_after_n: f64,
    /// It happened within this time before the stamp, s.
    pub interval_s: f64,
    /// One of the constants.
    pub source: String,
}

impl TissueEvent {
    /// The surface, or the membrane of a region, was broken.
    pub const PUNCTURE: &str = "puncture";
    /// The tip came into a region that no membrane closes.
    pub const LAYER: &str = "layer";
    /// The whole shaft began to slip.
    pub const SLIP: &str = "slip";
    /// Seen in the twin's tissue.
    pub const MODEL: &str = "model";
    /// Seen in the measured force alone.
    pub const MEASURED: &str = "measured";
}

/// Measured against predicted force (`msg/ForceComparison.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceComparison {
    /// Stamp of the pose, and the frame of the vectors.
    pub header: Header,
    /// False: measured and residual are 0 and were left out of the statistics.
    pub valid: bool,
    /// One of the `LOAD_CELL_` constants.
    pub load_cell: u8,
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Load cell at the pose's stamp less the tare, against the direction of insertion, N.
    pub measured_n: f64,
    /// Prediction with the same sign, N.
    pub predicted_n: f64,
    /// Error of it that cloud and steps make, estimated, N.
    pub model_error_n: f64,
    /// `predicted_n - measured_n`.
    pub residual_n: f64,
    /// Root mean square of the residual since the last reset, N.
    pub rmse_n: f64,
    /// Largest |residual| since the last reset, N.
    pub max_abs_error_n: f64,
    /// Comparisons behind these two.
    pub samples: u64,
    /// Load cell without tare, N.
    pub measured_force_n: Vector3,
    /// Prediction, N.
    pub predicted_force_n: Vector3,
    /// What was taken as zero, N.
    pub tare_n: Vector3,
    /// Length of prediction - (load cell - tare), N; 0 while the load cell has read one component alone.
    pub vector_error_n: f64,
    /// Root mean square of it since the last reset, N.
    pub rmse_vector_n: f64,
    /// From the nearest load-cell reading to the pose, s.
    pub measured_delay_s: f64,
    /// One of the `IDENTIFICATION_` constants.
    pub identification: u8,
    /// Why the identification is frozen, else empty.
    pub identification_reason: String,
    /// Scene keys, and `load_cell.offset_n`.
    pub identified_names: Vec<String>,
    /// Their values, each in the unit of its name.
    pub identified_values: Vec<f64>,
    /// Their standard errors, the model's own error included.
    pub identified_standard_errors: Vec<f64>,
    /// What `measured_n` should be with these values, N; 0 where nothing is identified.
    pub identified_n: f64,
}

impl ForceComparison {
    /// The comparison is valid.
    pub const LOAD_CELL_OK: u8 = 0;
    /// No reading near the pose's stamp.
    pub const LOAD_CELL_MISSING: u8 = 1;
    /// The reading is not a number.
    pub const LOAD_CELL_NOT_FINITE: u8 = 2;
    /// The reading has not changed while it should have.
    pub const LOAD_CELL_STUCK: u8 = 3;
    /// The reading is at the end of the cell's range.
    pub const LOAD_CELL_SATURATED: u8 = 4;
    /// Nothing is identified.
    pub const IDENTIFICATION_OFF: u8 = 0;
    /// Not enough is known yet.
    pub const IDENTIFICATION_LEARNING: u8 = 1;
    /// Every parameter is known well enough.
    pub const IDENTIFICATION_CONVERGED: u8 = 2;
    /// Nothing is learnt: the model is wrong, or the load cell is at fault.
    pub const IDENTIFICATION_FROZEN: u8 = 3;
}

/// State of the twin (`msg/TwinStatus.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TwinStatus {
    /// Stamp of the last answered pose.
    pub header: Header,
    /// Name of the scene.
    pub scene: String,
    /// That of the [`TissueModel`].
    pub model_id: u64,
    /// The twin answers every pose and vouches for it.
    pub prediction_valid: bool,
    /// One of the `HEALTH_` constants.
    pub health: u8,
    /// Why health is not OK, with the remedy.
    pub reasons: Vec<String>,
    /// One of the `PHASE_` constants.
    pub phase: u8,
    /// The surface has been punctured since the last reset.
    pub punctured: bool,
    /// At this depth, m.
    pub puncture_depth_m: f64,
    /// Depth of the last answered pose, m.
    pub depth_m: f64,
    /// Its force, N.
    pub predicted_n: f64,
    /// Poses since the last reset.
    pub poses_received: u64,
    /// Of them answered.
    pub poses_answered: u64,
    /// Of them refused.
    pub poses_rejected: u64,
    /// Of them skipped because a newer one had come.
    pub poses_coalesced: u64,
    /// Answered after the next pose had come.
    pub missed_deadlines: u64,
    /// Explicit steps since the last reset.
    pub steps: u64,
    /// Mean over the last second.
    pub steps_per_pose: f64,
    /// Mean wall time of one step over the last second, s.
    pub step_s: f64,
    /// Poses received in the last second.
    pub pose_rate_hz: f64,
    /// Input seconds per wall second of stepping.
    pub real_time_factor: f64,
    /// Median latency since the last reset, s.
    pub latency_p50_s: f64,
    /// 99th percentile, s.
    pub latency_p99_s: f64,
    /// Largest, s.
    pub latency_max_s: f64,
    /// Smallest volume ratio.
    pub min_jacobian: f64,
    /// Kinetic over strain energy.
    pub kinetic_to_strain_energy: f64,
    /// |instrument force + base reaction| / peak force.
    pub force_imbalance: f64,
    /// Largest distance between the field and what is prescribed, m.
    pub constraint_error_m: f64,
    /// Host and process that speaks, `host:4711`.
    pub instance: String,
    /// Region of the tissue that the tip is in; empty outside of the sample.
    pub region: String,
    /// Regions on the instrument's path, in the order in which it comes into them.
    pub region_names: Vec<String>,
    /// Depth of the tip at which it comes into each, m.
    pub region_depths_m: Vec<f64>,
    /// Whether these are where the deformed tissue has them now; otherwise as in the scene.
    pub region_depths_predicted: bool,
    /// Share of the strain energy in cells that have turned over; from 0.05 on the health is WARN.
    pub folded_energy: f64,
    /// Which model answers, what it leaves out and why, and what its answers are corrected by; empty while it is built.
    pub model: String,
    /// What a correction left of force and targets in a run that it was not learnt from; 0: not known.
    pub model_error: f64,
}

impl TwinStatus {
    /// Above the sample.
    pub const PHASE_APPROACH: u8 = 0;
    /// In contact, surface not punctured.
    pub const PHASE_INDENTATION: u8 = 1;
    /// Inside, advancing or at rest.
    pub const PHASE_PENETRATION: u8 = 2;
    /// Being withdrawn.
    pub const PHASE_RETRACTION: u8 = 3;

    /// All is well.
    pub const HEALTH_OK: u8 = 0;
    /// Predictions go on, see the reasons.
    pub const HEALTH_WARN: u8 = 1;
    /// Predictions have stopped, see the reasons.
    pub const HEALTH_ERROR: u8 = 2;
    /// No pose for too long.
    pub const HEALTH_STALE: u8 = 3;
}

/// Request of the service `LookAhead` (`srv/LookAhead.srv`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LookAheadRequest {
    /// How far along the needle's axis, positive into the sample, m.
    pub distance_m: f64,
    /// How fast, m/s; 0: 0.001.
    pub speed_m_per_s: f64,
}

/// Response of the service `LookAhead` (`srv/LookAhead.srv`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LookAheadResponse {
    /// Whether the motion could be followed.
    pub success: bool,
    /// Why not, and what to do.
    pub message: String,
    /// Stamp of the pose from which it looks ahead, and the frame of the targets.
    pub header: Header,
    /// Depth of that pose, m.
    pub depth_m: f64,
    /// Explicit steps that it took.
    pub steps: u32,
    /// Depths on the way, m.
    pub depths_m: Vec<f64>,
    /// Force at each of them against the direction of insertion, N.
    pub forces_n: Vec<f64>,
    /// The largest of them, N.
    pub peak_force_n: f64,
    /// Where each target will be at the end, m.
    pub targets: Vec<Point>,
    /// Wall time that it took, s.
    pub computed_s: f64,
}

/// Whether it is safe to go on, and why not (`msg/Safety.msg`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Safety {
    /// When this was judged, on the node's clock, and the frame.
    pub header: Header,
    /// Stamp of the newest pose that was answered.
    pub pose_stamp: Time,
    /// The older of the time since it came and the time since its stamp, s; [`Safety::NEVER`] before the first.
    pub pose_age_s: f64,
    /// The same of the newest usable reading of the load cell, s.
    pub reading_age_s: f64,
    /// Whether it is.
    pub safe: bool,
    /// What is left to `force_limit_n`, N; [`Safety::NEVER`] without a limit.
    pub force_margin_n: f64,
    /// Length of predicted less measured force over the components that are measured, N.
    pub residual_n: f64,
    /// Why it is not safe; empty if it is.
    pub reasons: Vec<String>,
    /// Parameter of this name, N; 0: the load cell is not asked.
    pub residual_band_n: f64,
    /// What is left to it, N; [`Safety::NEVER`] without a band.
    pub residual_margin_n: f64,
    /// What is left of the band of the torque, N m; [`Safety::NEVER`] where none is measured.
    pub torque_margin_nm: f64,
    /// Direction of insertion at that pose; zeros before the first.
    pub axis: Vector3,
    /// Largest change of the predicted force over depth along the scene's own motion, N/m; 0 until it is known.
    pub steepest_n_per_m: f64,
}

impl Safety {
    /// An age or a margin of what is not there: the largest double, so that every comparison with a limit comes out on the safe side for
    /// an age, and does not count for a margin.
    pub const NEVER: f64 = f64::MAX;
}

ros_messages!("needle_twin": TissueModel, TissueState, TissueEvent, ForceBand, Outlook, ForceComparison, TwinStatus, Safety);
