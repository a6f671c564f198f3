//! The deformation outputs: each at its rate, and only while it has a subscriber.

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use super::answer::{Model, Snapshot, Wants};
use super::inbox::Inbox;
use super::pictured::{cloud, marker};
use super::shared::Shared;
use super::tf;
use super::viewers::Viewers;
use needle_core::scene::Scene;
use ros2_messages::geometry_msgs::{self, PoseArray};
use ros2_messages::needle_twin::TissueState;
use ros2_messages::sensor_msgs::PointCloud2;
use ros2_messages::std_msgs::Header;
use ros2_messages::visualization_msgs::Marker;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;

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
