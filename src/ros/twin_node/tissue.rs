//! The deformation outputs: each at its rate, and only while it has a subscriber.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use super::inbox::Inbox;
use super::page;
use super::pictured::{cloud, marker};
use super::shared::Shared;
use super::tf;
use super::viewers::Viewers;
use needle_core::scene::{Scene, Word as _};
use needle_core::twin::{Along, Pose, Twin};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{self, PoseArray};
use ros2_messages::needle_twin::{TissueModel, TissueState};
use ros2_messages::sensor_msgs::PointCloud2;
use ros2_messages::std_msgs::Header;
use ros2_messages::visualization_msgs::Marker;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;

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
    pub(crate) fn of(twin: &Twin, build: Duration) -> Self {
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
            instrument: page::instrument(scene, twin.reference_points()),
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
    fn any(self) -> bool {
        self.displacements || self.stress || self.targets || self.shape
    }

    fn and(self, other: Self) -> Self {
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

    fn is_finite(&self) -> bool {
        let vectors = self.displacements.iter().chain(&self.targets).flatten();
        let scalars = self.jacobian.iter().chain(&self.von_mises_pa);
        let shape = self.shape.iter().flat_map(|pose| pose.tip.iter().chain(&pose.axis));
        vectors.chain(scalars).chain(shape).all(|v| v.is_finite())
    }
}

/// The publishers.
pub(super) struct TissueOutputs {
    pub state: Output<TissueState>,
    pub points: Output<PointCloud2>,
    pub surface: Output<Marker>,
    pub targets: Output<PoseArray>,
    /// Shape of a needle that bends.
    pub shape: Option<Output<PoseArray>>,
    pub viewers: Viewers,
}

/// Whether a scene's needle bends.
pub(super) fn bends(scene: &Scene) -> bool {
    scene.instrument.as_ref().and_then(|i| i.needle()).is_some_and(|needle| needle.flexible.is_some())
}

impl TissueOutputs {
    pub(crate) fn new(participant: &mut Participant, scene: &Scene) -> Result<Self, ParticipantError> {
        // Best effort for large messages: for a suspended reliable reader RustDDS would keep every sample.
        Ok(Self {
            state: participant.publisher("tissue_state", qos::sensor(5))?,
            points: participant.publisher("tissue_points", qos::sensor(5))?,
            surface: participant.publisher("tissue_surface", qos::sensor(5))?,
            targets: participant.publisher("targets", qos::reliable(10))?,
            shape: bends(scene).then(|| participant.publisher("predicted_shape", qos::reliable(10))).transpose()?,
            viewers: Viewers::default(),
        })
    }

    pub(crate) fn failed(&self) -> u64 {
        let shape = self.shape.as_ref().map_or(0, Output::failed);
        self.state.failed() + self.points.failed() + self.surface.failed() + self.targets.failed() + shape
    }

    /// The parts with a subscriber; a scene without targets publishes none.
    fn wants(&self, model: &Model) -> Wants {
        let cloud = self.points.is_wanted();
        Wants {
            displacements: cloud || self.state.is_wanted() || self.surface.is_wanted(),
            stress: cloud,
            targets: self.targets.is_wanted() && !model.target_names.is_empty(),
            shape: self.shape.as_ref().is_some_and(Output::is_wanted),
        }
    }

    /// The parts that viewers see.
    fn viewers_want(&self, model: &Model) -> Wants {
        let watched = self.viewers.watch();
        let targets = watched && !model.target_names.is_empty();
        Wants { displacements: watched, stress: false, targets, shape: watched && self.shape.is_some() }
    }

    fn show(&self, model: &Model, snapshot: &Snapshot, frame_id: &str) {
        if snapshot.for_viewers {
            self.viewers.tissue(snapshot);
        }
        if snapshot.for_topics {
            self.publish(model, snapshot, frame_id);
        }
    }

    fn publish(&self, model: &Model, snapshot: &Snapshot, frame_id: &str) {
        let header = Header { stamp: snapshot.stamp, frame_id: frame_id.to_owned() };
        // parts requested after the snapshot are in the next one
        let Wants { displacements, stress, targets, shape } = snapshot.wants;
        if let Some(output) = self.shape.as_ref().filter(|output| shape && output.is_wanted()) {
            let poses = snapshot.shape.iter().map(tf::pose).collect();
            output.send(PoseArray { header: header.clone(), poses });
        }
        if displacements && self.state.is_wanted() {
            self.state.send(TissueState {
                header: header.clone(),
                model_id: model.id,
                depth_m: snapshot.depth_m,
                displacements: snapshot.displacements.iter().map(|u| (*u).into()).collect(),
            });
        }
        if stress && self.points.is_wanted() {
            self.points.send(cloud(header.clone(), model, snapshot));
        }
        if displacements && self.surface.is_wanted() {
            self.surface.send(marker(header.clone(), model, snapshot));
        }
        if targets && self.targets.is_wanted() {
            let pose = |p: &[f64; 3]| geometry_msgs::Pose { position: (*p).into(), ..Default::default() };
            self.targets.send(PoseArray { header, poses: snapshot.targets.iter().map(pose).collect() });
        }
    }
}

/// Interval of the checks for a subscriber.
const UNWANTED: Duration = Duration::from_millis(100);
/// Rate for viewers.
const VIEWERS_HZ: f64 = 30.0;

/// A periodic deadline.
struct Beat {
    due: Instant,
}

impl Beat {
    /// Whether the deadline is reached. Deadlines are absolute; missed ones are skipped.
    fn falls(&mut self, now: Instant, period: Duration) -> bool {
        let falls = now >= self.due;
        if falls {
            self.due = if now - self.due > period { now + period } else { self.due + period };
        }
        falls
    }
}

/// The tissue thread: requests snapshots at the rates of the topics and of viewers, and publishes them. Ends with the
/// solver.
pub(super) fn run(
    outputs: &TissueOutputs,
    model: &Model,
    frame_id: &str,
    shared: &Shared,
    inbox: &Inbox,
    snapshots: &Receiver<Box<Snapshot>>,
) {
    let mut spare = Some(Box::<Snapshot>::default());
    let now = Instant::now();
    let (mut topics, mut viewers) = (Beat { due: now }, Beat { due: now });
    outputs.viewers.model(model);
    loop {
        let rate = shared.settings().tissue_rate_hz;
        let wanted = if rate > 0.0 { outputs.wants(model) } else { Wants::default() };
        let viewed = outputs.viewers_want(model);
        let now = Instant::now();
        let period = |any: bool, hz: f64| if any { Duration::from_secs_f64(1.0 / hz) } else { UNWANTED };
        let for_topics = topics.falls(now, period(wanted.any(), rate)) && wanted.any();
        let for_viewers = viewers.falls(now, period(viewed.any(), VIEWERS_HZ)) && viewed.any();
        if (for_topics || for_viewers)
            && shared.is_active()
            && let Some(mut snapshot) = spare.take()
        {
            let none = Wants::default();
            snapshot.wants = if for_topics { wanted } else { none }.and(if for_viewers { viewed } else { none });
            (snapshot.for_topics, snapshot.for_viewers) = (for_topics, for_viewers);
            inbox.put_snapshot(snapshot);
        }
        match snapshots.recv_deadline(topics.due.min(viewers.due)) {
            Ok(snapshot) => {
                if !shared.is_active() || snapshot.under_way {
                    // It was requested in another state, or does not belong to a pose.
                } else if snapshot.is_finite() {
                    outputs.show(model, &snapshot, frame_id);
                } else {
                    shared.lock().not_finite += 1;
                }
                spare = Some(snapshot);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}
