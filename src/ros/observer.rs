//! Subscribes to rig and twin like any third program: stores their messages, and records them into a bag.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use ros2_messages::RosMessage;
use ros2_messages::diagnostic_msgs::DiagnosticArray;
use ros2_messages::geometry_msgs::{PoseArray, WrenchStamped};
use ros2_messages::needle_twin::{ForceComparison, TissueEvent, TissueModel, TissueState, TwinStatus};
use ros2_messages::rosbag2_interfaces::Empty;
use ros2_messages::sensor_msgs::{JointState, PointCloud2};
use ros2_node::arguments::RosArguments;
use ros2_node::environment::Environment;
use ros2_node::names::Names;
use ros2_node::participant::{Input, Participant};
use ros2_node::qos;
use ros2_node::service::Client;
use ros2_node::start::NodeError;
use rosbag2_mcap::{BagWriter, Qos, TopicId};

/// Queue length between two polls: seconds at any sensible rate.
const DEPTH: usize = 4000;

/// A value with the stamp of its header and the wall time of its reception, both in ns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Heard<T> {
    /// Stamp of the header.
    pub stamp_ns: i64,
    /// Time of reception.
    pub received_ns: i64,
    /// The value.
    pub value: T,
}

/// Jacobian and von Mises stress (Pa) at the reference points.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PointFields {
    /// Volume ratio.
    pub jacobian: Vec<f64>,
    /// Stress, Pa.
    pub von_mises_pa: Vec<f64>,
}

/// All received messages, in the order of reception.
#[derive(Debug, Default)]
pub(crate) struct Observations {
    /// The model, once the twin has built it.
    pub model: Option<TissueModel>,
    /// Depth of the first joint, m.
    pub depths: Vec<Heard<f64>>,
    /// Load cell, N.
    pub measured: Vec<Heard<[f64; 3]>>,
    /// Prediction, N.
    pub predicted: Vec<Heard<[f64; 3]>>,
    /// Status of the twin.
    pub status: Vec<Heard<TwinStatus>>,
    /// Events in the tissue.
    pub events: Vec<Heard<TissueEvent>>,
    /// Displacements.
    pub tissue: Vec<Heard<TissueState>>,
    /// Fields at the points.
    pub fields: Vec<Heard<PointFields>>,
    /// Positions of the targets, m.
    pub targets: Vec<Heard<Vec<[f64; 3]>>>,
    /// Last value of each key of `/diagnostics`.
    pub diagnostics: BTreeMap<String, String>,
    /// Number of comparisons that the twin published.
    pub comparisons: u64,
}

/// Writes the received messages. A failure is reported once, and the observation continues.
struct Recorder {
    writer: BagWriter,
    topics: BTreeMap<String, TopicId>,
    failed: Option<String>,
}

impl Recorder {
    fn write<M: RosMessage>(&mut self, topic: &str, qos: &Qos, [received, sent]: [i64; 2], message: &M) {
        if self.failed.is_some() {
            return;
        }
        let ns = |t: i64| u64::try_from(t).unwrap_or(0);
        let id = match self.topics.get(topic) {
            Some(id) => Ok(*id),
            None => self.writer.add_topic::<M>(topic, qos),
        };
        let written = id.and_then(|id| {
            self.topics.insert(topic.to_owned(), id);
            self.writer.write(id, ns(received), ns(sent), message)
        });
        self.failed = written.err().map(|e| e.to_string());
    }
}

/// See the module.
pub(crate) struct Observer {
    joint: Input<JointState>,
    wrench: Input<WrenchStamped>,
    force: Input<WrenchStamped>,
    comparison: Input<ForceComparison>,
    status: Input<TwinStatus>,
    events: Input<TissueEvent>,
    model: Input<TissueModel>,
    tissue: Input<TissueState>,
    points: Input<PointCloud2>,
    targets: Input<PoseArray>,
    diagnostics: Input<DiagnosticArray>,
    resume: Client<Empty, Empty>,
    asked: Option<Instant>,
    resumed: bool,
    recorder: Option<Recorder>,
    /// The messages received so far.
    pub heard: Observations,
    participant: Option<Participant>,
}

impl Observer {
    /// Joins the domain as node `/demo` and subscribes to everything that rig and twin publish in the root namespace.
    /// The messages are recorded into `bag`, if there is one.
    ///
    /// # Errors
    /// [`NodeError`] if the network can't be joined.
    pub(crate) fn join(environment: &Environment, bag: Option<BagWriter>) -> Result<Self, NodeError> {
        let names = Names::new("demo", &[])?;
        let mut participant = Participant::new(names, environment, &RosArguments::default())?;
        let mut observer = Self {
            joint: participant.subscription("measured_js", qos::reliable(DEPTH))?,
            wrench: participant.subscription("measured_cf", qos::sensor(DEPTH))?,
            force: participant.subscription("predicted_cf", qos::reliable(DEPTH))?,
            comparison: participant.subscription("comparison", qos::reliable(DEPTH))?,
            status: participant.subscription("status", qos::reliable(DEPTH))?,
            events: participant.subscription("events", qos::latest(100))?,
            model: participant.subscription("tissue_model", qos::latched())?,
            tissue: participant.subscription("tissue_state", qos::sensor(100))?,
            points: participant.subscription("tissue_points", qos::sensor(100))?,
            targets: participant.subscription("targets", qos::reliable(100))?,
            diagnostics: participant.subscription("/diagnostics", qos::reliable(100))?,
            resume: participant.client("/rig/resume", "rosbag2_interfaces", "Resume")?,
            asked: None,
            resumed: false,
            recorder: bag.map(|writer| Recorder { writer, topics: BTreeMap::new(), failed: None }),
            heard: Observations::default(),
            participant: None,
        };
        participant.start(None)?;
        observer.participant = Some(participant);
        Ok(observer)
    }

    /// Whether there are publishers of both rig and twin.
    #[must_use]
    pub(crate) fn is_connected(&self) -> bool {
        self.joint.publishers() > 0 && self.wrench.publishers() > 0 && self.force.publishers() > 0
    }

    /// Calls the rig's `~/resume` until it answers; returns true after the answer.
    pub(crate) fn resume_rig(&mut self) -> bool {
        if !self.resumed && self.asked.is_none_or(|at| at.elapsed() > Duration::from_millis(500)) {
            self.asked = Some(Instant::now());
            if !self.resume.ask(&Empty::default()) {
                tracing::warn!("~/resume could not be asked for: call it again, or `ros2 service call`");
            }
        }
        self.resumed |= self.resume.answer().is_some();
        self.resumed
    }

    /// Takes all messages that have arrived.
    pub(crate) fn poll(&mut self) {
        let Self { heard, recorder, .. } = self;
        let (reliable, best_effort) = (Qos::reliable(10), Qos::best_effort(5));
        drain(&self.joint, recorder, &reliable, |m, [received, _]| {
            if let Some(depth) = m.position.first() {
                heard.depths.push(Heard { stamp_ns: m.header.stamp.nanos(), received_ns: received, value: *depth });
            }
        });
        drain(&self.wrench, recorder, &reliable, |m, [received, _]| {
            heard.measured.push(heard_force(&m, received));
        });
        drain(&self.force, recorder, &reliable, |m, [received, _]| {
            heard.predicted.push(heard_force(&m, received));
        });
        drain(&self.comparison, recorder, &reliable, |_, _| heard.comparisons += 1);
        drain(&self.status, recorder, &reliable, |m, [received, _]| {
            heard.status.push(Heard { stamp_ns: m.header.stamp.nanos(), received_ns: received, value: m });
        });
        drain(&self.events, recorder, &Qos::transient_local(100), |m, [received, _]| {
            heard.events.push(Heard { stamp_ns: m.header.stamp.nanos(), received_ns: received, value: m });
        });
        drain(&self.model, recorder, &Qos::transient_local(1), |m, _| heard.model = Some(m));
        drain(&self.tissue, recorder, &best_effort, |m, [received, _]| {
            heard.tissue.push(Heard { stamp_ns: m.header.stamp.nanos(), received_ns: received, value: m });
        });
        drain(&self.points, recorder, &best_effort, |m, [received, _]| {
            let stamp_ns = m.header.stamp.nanos();
            heard.fields.push(Heard { stamp_ns, received_ns: received, value: point_fields(&m) });
        });
        drain(&self.targets, recorder, &reliable, |m, [received, _]| {
            let positions = m.poses.iter().map(|p| p.position.into()).collect();
            heard.targets.push(Heard { stamp_ns: m.header.stamp.nanos(), received_ns: received, value: positions });
        });
        drain(&self.diagnostics, recorder, &reliable, |m, _| {
            let values = m.status.into_iter().flat_map(|s| s.values);
            heard.diagnostics.extend(values.map(|v| (v.key, v.value)));
        });
    }

    /// Leaves the network and closes the bag. Returns the received messages, and the error of the recording, if any.
    #[must_use]
    pub(crate) fn leave(mut self) -> (Observations, Option<String>) {
        drop(self.participant.take());
        let failed = self.recorder.and_then(|recorder| match (recorder.failed, recorder.writer.finish()) {
            (Some(error), _) => Some(error),
            (None, finished) => finished.err().map(|e| e.to_string()),
        });
        (self.heard, failed)
    }
}

fn drain<M: RosMessage + 'static>(
    input: &Input<M>,
    recorder: &mut Option<Recorder>,
    qos: &Qos,
    mut keep: impl FnMut(M, [i64; 2]),
) {
    while let Some((message, times)) = input.take_timed() {
        if let Some(recorder) = recorder {
            recorder.write(input.topic(), qos, times, &message);
        }
        keep(message, times);
    }
}

fn heard_force(message: &WrenchStamped, received_ns: i64) -> Heard<[f64; 3]> {
    Heard { stamp_ns: message.header.stamp.nanos(), received_ns, value: message.wrench.force.into() }
}

/// The scalar fields of a cloud; a field that it does not have is empty.
fn point_fields(cloud: &PointCloud2) -> PointFields {
    let step = usize::try_from(cloud.point_step).unwrap_or(0);
    let column = |name: &str| -> Vec<f64> {
        let Some(offset) = cloud.fields.iter().find(|f| f.name == name).and_then(|f| usize::try_from(f.offset).ok())
        else {
            return Vec::new();
        };
        let value = |point: &[u8]| {
            let bytes = point.get(offset..offset + 4)?.try_into().ok()?;
            Some(f64::from(f32::from_le_bytes(bytes)))
        };
        if step == 0 { Vec::new() } else { cloud.data.chunks_exact(step).filter_map(value).collect() }
    };
    PointFields { jacobian: column("jacobian"), von_mises_pa: column("von_mises_pa") }
}
