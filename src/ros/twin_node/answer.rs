//! What the solver thread has to say: its model, answers to poses, events, progress, snapshots of the tissue.

use std::sync::Arc;
use std::time::{Duration, Instant};

use needle_core::scene::Word as _;
use needle_core::twin::{Along, FOLLOWED, Happening, Pose, Prediction, StampedPose, Twin, Work as WorkDone};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::needle_twin::TissueModel;
use ros2_messages::std_msgs::Header;

/// An answered pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer {
    pub stamp: Time,
    pub received: Instant,
    pub begun: Instant,
    pub done: Instant,
    /// The pose itself; its time counts from the first pose since the last reset.
    pub pose: StampedPose,
    pub prediction: Prediction,
    /// Further results that the twin has computed so far.
    pub work: WorkDone,
    /// [`Twin::boundaries_m`]
    pub boundaries_m: Option<[f64; FOLLOWED]>,
    /// [`Twin::bent_tip`]
    pub bent_tip: Option<Pose>,
}

/// An event detected by the solver.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub stamp: Time,
    /// Time since the previous pose, s.
    pub interval_s: f64,
    /// Axis of the instrument into the sample.
    pub axis: [f64; 3],
    pub happening: Happening,
}

impl Answer {
    /// Force along the instrument, against its motion into the sample, N.
    pub(crate) fn predicted_n(&self) -> f64 {
        -(0..3).map(|k| self.prediction.force_n[k] * self.pose.pose.axis[k]).sum::<f64>()
    }
}

/// Progress of a motion in parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Progress {
    /// Depth of its goal, m.
    pub to_m: f64,
    /// Completed share of the motion.
    pub share: f64,
    /// Remaining time, s.
    pub left_s: f64,
    /// Time of reception of the pose that started it.
    pub since: Instant,
    /// Number of poses that came since the last part and will not be answered.
    pub skipped: u64,
}

/// Whether all numbers of a prediction are finite; others are not published.
pub(super) fn is_finite(prediction: &Prediction) -> bool {
    let health = &prediction.health;
    let forces = prediction.force_n.iter().chain(&prediction.base_force_n).chain(&prediction.torque_nm);
    let figures = [
        prediction.depth_m,
        health.min_jacobian,
        health.kinetic_to_strain_energy,
        health.force_imbalance,
        health.constraint_error_m,
        health.folded_energy,
    ];
    forces.chain(&figures).all(|v| v.is_finite())
}

/// The constant data of a twin, copied once.
#[derive(Clone, Debug)]
#[cfg_attr(not(feature = "page"), allow(dead_code))] // the page shows them
pub(super) struct Model {
    pub id: u64,
    pub scene: String,
    pub method: String,
    /// Dimension of the model with the reason, and its correction.
    pub dimension: String,
    /// Remaining error of a corrected model.
    pub error: f64,
    pub nodes: usize,
    pub integration_points: usize,
    pub build: Duration,
    /// Effective radius of a needle in the cloud, m.
    pub effective_radius: Option<f64>,
    pub points: Vec<[f64; 3]>,
    pub surface: Vec<[u32; 3]>,
    pub cells: Vec<[u32; 4]>,
    /// Region of each cell; empty: one region.
    pub region: Vec<u8>,
    pub target_names: Vec<String>,
    pub target_references: Vec<[f64; 3]>,
    /// In the format of the live page.
    pub instrument: serde_json::Value,
    /// Regions along the path of the tip.
    pub along: Arc<Along>,
}

impl Model {
    pub(crate) fn of(twin: &Twin, build: Duration, instrument: serde_json::Value) -> Self {
        let scene = twin.scene();
        let points = twin.reference_points().to_vec();
        Self {
            id: model_id(&scene.to_toml(), &points),
            scene: scene.name.clone(),
            dimension: format!("{}: {}", twin.dimension().as_str(), twin.dimension_because()),
            error: twin.correction().map_or(0.0, |correction| correction.left),
            method: scene.get("discretisation.method").and_then(|v| v.as_text().map(str::to_owned)).unwrap_or_default(),
            nodes: twin.nodes(),
            integration_points: twin.integration_points(),
            build,
            effective_radius: twin.effective_radius(),
            points,
            surface: twin.surface().to_vec(),
            cells: twin.cells().to_vec(),
            region: twin.cell_regions().to_vec(),
            instrument,
            target_names: scene.targets.iter().map(|t| t.name.clone()).collect(),
            target_references: scene.targets.iter().map(|t| t.position).collect(),
            along: Arc::new(twin.along().clone()),
        }
    }

    pub(crate) fn message(&self, stamp: Time, frame_id: &str) -> TissueModel {
        TissueModel {
            header: Header { stamp, frame_id: frame_id.to_owned() },
            model_id: self.id,
            scene: self.scene.clone(),
            method: self.method.clone(),
            integration_points: u32::try_from(self.integration_points).unwrap_or(u32::MAX),
            reference_points: self.points.iter().map(|p| (*p).into()).collect(),
            surface_triangles: self.surface.iter().flatten().copied().collect(),
            cells: self.cells.iter().flatten().copied().collect(),
            target_names: self.target_names.clone(),
            target_references: self.target_references.iter().map(|p| (*p).into()).collect(),
        }
    }
}

/// A number that is equal for the same scene and points; never 0.
fn model_id(scene: &str, points: &[[f64; 3]]) -> u64 {
    let mut hash = xxhash_rust::xxh3::Xxh3::new();
    hash.update(scene.as_bytes());
    for coordinate in points.iter().flatten() {
        hash.update(&coordinate.to_le_bytes());
    }
    hash.digest().max(1)
}

/// The deformation at one time. The vectors are reused between the threads, without new allocation.
#[derive(Debug, Default)]
pub(super) struct Snapshot {
    pub stamp: Time,
    pub depth_m: f64,
    pub displacements: Vec<[f64; 3]>,
    pub jacobian: Vec<f64>,
    pub von_mises_pa: Vec<f64>,
    pub targets: Vec<[f64; 3]>,
    /// Poses along a needle that bends, from the clamp to the tip.
    pub shape: Vec<Pose>,
    /// Position of the instrument, and its direction into the sample.
    pub tip: [f64; 3],
    pub axis: [f64; 3],
    /// Whether it is for subscribers, for viewers, or for both.
    pub for_topics: bool,
    pub for_viewers: bool,
    /// Whether the twin is in a motion in parts: the state does not belong to a pose.
    pub under_way: bool,
    /// The requested parts.
    pub wants: Wants,
}

/// The parts of the deformation that have a subscriber.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Wants {
    pub displacements: bool,
    /// Volume ratio and stress: they cost more than the displacement.
    pub stress: bool,
    pub targets: bool,
    /// The shape of a needle that bends.
    pub shape: bool,
}

impl Wants {
    pub(crate) fn any(self) -> bool {
        self.displacements || self.stress || self.targets || self.shape
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            displacements: self.displacements || other.displacements,
            stress: self.stress || other.stress,
            targets: self.targets || other.targets,
            shape: self.shape || other.shape,
        }
    }
}

impl Snapshot {
    /// Copies the present state. Runs in the solver thread.
    pub(crate) fn take(&mut self, twin: &Twin, stamp: Time, depth_m: f64) {
        self.stamp = stamp;
        self.depth_m = depth_m;
        if self.wants.displacements {
            twin.displacements(&mut self.displacements);
        }
        if self.wants.targets {
            twin.target_positions(&mut self.targets);
        }
        if self.wants.shape {
            twin.needle_shape(&mut self.shape);
        }
        if self.wants.stress {
            twin.jacobian_and_stress(&mut self.jacobian, &mut self.von_mises_pa);
        }
    }

    pub(crate) fn is_finite(&self) -> bool {
        let vectors = self.displacements.iter().chain(&self.targets).flatten();
        let scalars = self.jacobian.iter().chain(&self.von_mises_pa);
        let shape = self.shape.iter().flat_map(|pose| pose.tip.iter().chain(&pose.axis));
        vectors.chain(scalars).chain(shape).all(|v| v.is_finite())
    }
}
