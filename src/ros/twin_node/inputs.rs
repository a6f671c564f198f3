//! The input thread: takes messages from DDS, rejects invalid poses, and passes the newest pose to the solver.

use std::collections::BTreeMap;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use super::comparison::Reading;
use super::inbox::{Inbox, PoseInput, Where};
use super::shared::{Doubt, Reject, Shared};
use super::solver::Event;
use super::stretch::{Arrival, Stretch};
use super::tracked::Seen;
use needle_estimate::compare::frozen::Frozen;
use needle_recording::{Adapter, Holds, Posed, Refusal, Tools};
use ros2_messages::RosMessage as _;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{
    PointStamped, PoseArray, PoseStamped, PoseWithCovarianceStamped, TransformStamped, Wrench, WrenchStamped,
};
use ros2_messages::rosgraph_msgs::Clock;
use ros2_messages::sensor_msgs::JointState;
use ros2_node::clock::Tick;
use ros2_node::logging::Throttle;
use ros2_node::origin::{Followed, Guid, Origin};
use ros2_node::participant::{Converted, Input, Participant, ParticipantError, Wish};
use ros2_node::qos;

/// Stamps further than this ahead of the node's clock are rejected. `/clock` comes at 1 Hz at the slowest.
const FUTURE_S: f64 = 2.0;

/// Why a measurement without stamps is not evidence.
const UNSTAMPED: &str = "has no stamps: how old it is can't be known";

/// The subscriptions.
pub(super) struct Inputs {
    joint: Input<JointState>,
    pose: Converted<Posed>,
    wrench: Converted<WrenchStamped>,
    targets: Input<PoseArray>,
    clock: Input<Clock>,
}

impl Inputs {
    /// `types`: of the poses and of the load cell.
    pub(crate) fn new(participant: &mut Participant, types: [&str; 2]) -> Result<Self, ParticipantError> {
        Ok(Self {
            joint: participant.subscription("measured_js", qos::sensor(10))?,
            pose: match types[0] {
                TransformStamped::TYPE => converted::<TransformStamped, _>(participant, "measured_cp", 10)?,
                PoseWithCovarianceStamped::TYPE => {
                    converted::<PoseWithCovarianceStamped, _>(participant, "measured_cp", 10)?
                }
                PointStamped::TYPE => converted::<PointStamped, _>(participant, "measured_cp", 10)?,
                _ => converted::<PoseStamped, _>(participant, "measured_cp", 10)?,
            },
            wrench: match types[1] {
                Wrench::TYPE => converted::<Wrench, _>(participant, "measured_cf", 50)?,
                _ => converted::<WrenchStamped, _>(participant, "measured_cf", 50)?,
            },
            targets: participant.subscription("measured_targets", qos::sensor(10))?,
            clock: participant.subscription("/clock", qos::sensor(1))?,
        })
    }

    /// The inputs that the node waits for: poses, load cell, clock.
    pub(crate) fn wishes(&self) -> [Wish; 4] {
        [self.joint.wish(), self.pose.wish(), self.wrench.wish(), self.clock.wish()]
    }
}

fn converted<M: Holds<T>, T: 'static>(
    participant: &mut Participant,
    name: &str,
    depth: usize,
) -> Result<Converted<T>, ParticipantError> {
    Ok(participant.subscription::<M>(name, qos::sensor(depth))?.converted(M::held))
}

/// Runs until `stop` is closed.
pub(super) fn run(
    inputs: &Inputs,
    frame_id: &str,
    shared: &Shared,
    inbox: &Inbox,
    events: &SyncSender<Event>,
    stop: &smol::channel::Receiver<()>,
) {
    let intake = std::cell::RefCell::new(Intake::new(frame_id, shared, inbox));
    let executor = smol::LocalExecutor::new();
    let joint = executor.spawn(async {
        loop {
            let (message, origin) = inputs.joint.next_from().await;
            intake.borrow_mut().joint_state(&message, origin);
        }
    });
    let pose = executor.spawn(async {
        loop {
            let (message, origin) = inputs.pose.next_from().await;
            intake.borrow_mut().pose_stamped(&message, origin);
        }
    });
    let wrench = executor.spawn(async {
        loop {
            let (message, origin) = inputs.wrench.next_from().await;
            if let Some(reading) = intake.borrow_mut().wrench(&message, origin) {
                // A full channel means that the force thread is thousands of messages behind: a lost reading shows as
                // missing.
                let _ = events.try_send(Event::Measured(reading));
            }
        }
    });
    let targets = executor.spawn(async {
        let mut refused = Throttle::new(Duration::from_secs(60));
        loop {
            let message = inputs.targets.next().await;
            let stamp_nanos = stamp_or_now(shared, message.header.stamp);
            match Seen::of(&message, stamp_nanos, frame_id) {
                Ok(seen) => drop(events.try_send(Event::Tracked(seen))),
                Err(why) if refused.pass().is_some() => tracing::warn!("measured_targets is not used: {why}"),
                Err(_) => {}
            }
        }
    });
    let clock = executor.spawn(async {
        loop {
            let (message, origin) = inputs.clock.next_from().await;
            intake.borrow_mut().clock(message.clock, origin.received);
        }
    });
    // The channel is only closed, never written to.
    let _ = smol::block_on(executor.run(stop.recv()));
    drop((joint, pose, wrench, targets, clock));
}

/// Whether a stamp is a time: nanoseconds are less than a second.
fn is_time(stamp: Time) -> bool {
    !stamp.is_zero() && stamp.nanosec < 1_000_000_000
}

fn stamp_or_now(shared: &Shared, stamp: Time) -> i64 {
    if is_time(stamp) { stamp.nanos() } else { shared.clock.now_nanos().unwrap_or(0) }
}

/// Source of poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Source {
    topic: &'static str,
    publisher: Guid,
}

/// Validates poses.
struct Intake<'a> {
    frame_id: String,
    shared: &'a Shared,
    inbox: &'a Inbox,
    last_stamp: Option<i64>,
    /// Stamp of the first pose of the present run, and the state of the frozen-sensor detector.
    first_stamp: Option<i64>,
    frozen: Frozen,
    /// That came with the newest pose, m/s.
    velocity_m_per_s: f64,
    /// Poses with stamps long before the last one: late ones, or the first of a restarted time.
    stretch: Stretch,
    /// The source of poses; other topics or publishers are ignored until it is silent.
    poses: Followed<Source>,
    /// The same for readings of the load cell.
    cells: Followed<Guid>,
    tools: Tools,
    warnings: BTreeMap<Reject, Throttle>,
    unstamped: Throttle,
    cell_frame: Throttle,
}

impl<'a> Intake<'a> {
    fn new(frame_id: &str, shared: &'a Shared, inbox: &'a Inbox) -> Self {
        Self {
            frame_id: frame_id.to_owned(),
            shared,
            inbox,
            last_stamp: None,
            first_stamp: None,
            frozen: Frozen::default(),
            velocity_m_per_s: 0.0,
            stretch: Stretch::default(),
            poses: Followed::default(),
            cells: Followed::default(),
            tools: Tools::default(),
            warnings: BTreeMap::new(),
            unstamped: Throttle::new(Duration::from_secs(60)),
            cell_frame: Throttle::new(Duration::from_secs(60)),
        }
    }

    /// Counts a rejected pose and logs the reason, at most twice a minute per reason.
    fn reject(&mut self, why: Reject, remedy: impl FnOnce() -> String) {
        self.shared.lock().reject(why);
        let throttle = self.warnings.entry(why).or_insert_with(|| Throttle::new(Duration::from_secs(30)));
        if let Some(held) = throttle.pass() {
            let more = if held > 0 { format!(" ({held} more since the last such message)") } else { String::new() };
            tracing::warn!("pose refused, {}: {}{more}", why.word(), remedy());
        }
    }

    fn joint_state(&mut self, message: &JointState, origin: Origin) {
        let settings = self.shared.settings();
        let adapter = Adapter { joint: &settings.joint_name, frame_id: &self.frame_id };
        let (taken, velocity) = (adapter.depth(message).map(Where::Depth), adapter.velocity(message));
        self.offer("measured_js", origin, message.header.stamp, taken, velocity);
    }

    /// A load cell in another frame: the user must ensure that its axes are parallel to those of the sample.
    fn check_cell(&mut self, frame_id: &str) {
        if !frame_id.is_empty() && frame_id != self.frame_id && self.cell_frame.pass().is_some() {
            tracing::warn!(
                "measured_cf is in frame `{frame_id}`, taken as if its axes were those of `{}`: rotate it if they are \
                 not",
                self.frame_id
            );
        }
    }

    fn pose_stamped(&mut self, Posed { pose, tool }: &Posed, origin: Origin) {
        let settings = self.shared.settings();
        let adapter = Adapter { joint: &settings.joint_name, frame_id: &self.frame_id };
        let taken = self.tools.check(tool, adapter.joint).and_then(|()| adapter.pose(pose)).map(Where::Pose);
        self.offer("measured_cp", origin, pose.header.stamp, taken, 0.0);
    }

    /// `velocity`: that came with it, m/s; 0 if none did.
    fn offer(
        &mut self,
        topic: &'static str,
        origin: Origin,
        stamp: Time,
        taken: Result<Where, Refusal>,
        velocity: f64,
    ) {
        let source = Source { topic, publisher: origin.publisher };
        let others = |followed| followed != source || matches!(taken, Err(Refusal::OtherTool { .. }));
        match taken {
            Ok(place) => self.accept(source, origin.received, stamp, place, velocity),
            // Joints and tools of other machines on the same topic are no loss while the needle's own is received.
            Err(Refusal::NoSuchJoint { .. } | Refusal::OtherTool { .. }) if self.poses.source().is_some_and(others) => {
            }
            Err(refusal) => self.reject(Reject::from(&refusal), || format!("{topic}: {refusal}")),
        }
    }

    /// A reading of the load cell, if it comes from the followed publisher.
    fn wrench(&mut self, message: &WrenchStamped, Origin { publisher, received }: Origin) -> Option<Reading> {
        self.check_cell(&message.header.frame_id);
        let timeout = self.timeout();
        if !self.cells.takes(publisher, Instant::now(), timeout) {
            self.doubt_two("measured_cf", self.cells.source(), publisher);
            return None;
        }
        if !is_time(message.header.stamp) {
            self.doubt(Doubt::Unstamped("measured_cf"), || UNSTAMPED.to_owned());
        }
        let late_nanos = if is_time(message.header.stamp) { self.shared.settings().time_offset_s * 1e9 } else { 0.0 };
        let stamp_nanos = stamp_or_now(self.shared, message.header.stamp).saturating_sub(late_nanos as i64);
        #[allow(clippy::cast_precision_loss)] // a duration for a log line
        let ahead_s = self.shared.clock.now_nanos().map(|now| (stamp_nanos - now) as f64 * 1e-9);
        self.shared.lock().ahead_s[1] = ahead_s;
        Some(Reading {
            stamp_nanos,
            received,
            force_n: message.wrench.force.into(),
            torque_nm: message.wrench.torque.into(),
        })
    }

    fn timeout(&self) -> Duration {
        Duration::try_from_secs_f64(self.shared.settings().input_timeout_s).unwrap_or(Duration::MAX)
    }

    /// Two publishers of one measurement.
    fn doubt_two(&self, topic: &'static str, followed: Option<Guid>, other: Guid) {
        self.doubt(Doubt::Two(topic), || {
            format!(
                "has two publishers ({} is followed, {other} speaks too; `ros2 topic info --verbose` has their nodes): stop one of \
                 them, or remap it",
                followed.unwrap_or_default()
            )
        });
    }

    fn doubt(&self, doubt: Doubt, words: impl FnOnce() -> String) {
        self.shared.lock().doubt(doubt, words);
    }

    #[allow(clippy::cast_precision_loss)] // an age for a log line
    fn accept(&mut self, source: Source, received: Instant, stamp: Time, place: Where, velocity: f64) {
        if !self.shared.is_active() {
            return;
        }
        let settings = self.shared.settings();
        if !self.owns(source) {
            return;
        }
        self.velocity_m_per_s = velocity;
        let nanos = self.stamp(source.topic, stamp);
        let now = self.shared.clock.now_nanos();
        let age_s = now.map_or(0.0, |now| (now - nanos) as f64 * 1e-9);
        if age_s < -FUTURE_S {
            return self.reject(Reject::Future, || {
                format!(
                    "its stamp is {:.1} s ahead of this node's clock: synchronise the clocks, or use_sim_time",
                    -age_s
                )
            });
        }
        if settings.max_pose_age_s > 0.0 && age_s > settings.max_pose_age_s {
            return self.reject(Reject::TooOld, || {
                format!("its stamp is {age_s:.3} s old, max_pose_age_s is {}", settings.max_pose_age_s)
            });
        }
        let arrival = Arrival { pose: PoseInput { stamp: Time::from_nanos(nanos), received, place }, age_s, now };
        match self.last_stamp {
            Some(last) if nanos <= last => {
                let back_s = (last - nanos) as f64 * 1e-9;
                if back_s <= settings.input_timeout_s {
                    return self.out_of_order(back_s, source.topic);
                }
                // Late messages must not reset the tissue. They wait until a long stretch of them, or /clock, shows
                // that time has gone back.
                for _ in 0..self.stretch.add(source.publisher, arrival) {
                    self.out_of_order(back_s, source.topic);
                }
                if self.stretch.is_long() {
                    let held = self.stretch.end();
                    self.jump_back(back_s);
                    held.into_iter().for_each(|arrival| self.take(arrival));
                }
                return;
            }
            Some(last) => {
                for late in self.stretch.end() {
                    self.out_of_order((last - late.pose.stamp.nanos()) as f64 * 1e-9, source.topic);
                }
            }
            None => {}
        }
        self.take(arrival);
    }

    fn out_of_order(&mut self, back_s: f64, source: &str) {
        self.reject(Reject::OutOfOrder, || {
            format!("its stamp is {back_s:.6} s before that of the pose before it; is {source} published twice?")
        });
    }

    fn take(&mut self, arrival: Arrival) {
        let nanos = arrival.pose.stamp.nanos();
        let (place_m, topic) = match arrival.pose.place {
            Where::Depth(depth_m) => ([depth_m, 0.0, 0.0], "measured_js"),
            Where::Pose(pose) => (pose.tip, "measured_cp"),
        };
        let begun = *self.first_stamp.get_or_insert(nanos);
        self.frozen.place(Duration::from_nanos(nanos.abs_diff(begun)), place_m, self.velocity_m_per_s);
        if self.frozen.is_suspected() {
            self.doubt(Doubt::Frozen(topic), || {
                "does not change, though its sensor scatters or its velocity is not zero: is the cable connected?"
                    .to_owned()
            });
        }
        self.last_stamp = Some(nanos);
        let handoff = self.inbox.put_pose(arrival.pose);
        let mut live = self.shared.lock();
        live.ahead_s[0] = Some(-arrival.age_s);
        live.pose(handoff, arrival.age_s, arrival.now);
    }

    /// Accepts one publisher on one topic at a time: alternating between two sensors of the same needle would make it
    /// jump.
    fn owns(&mut self, source: Source) -> bool {
        let before = self.poses.source();
        if self.poses.takes(source, Instant::now(), self.timeout()) {
            return true;
        }
        let Some(followed) = before else { return true };
        self.doubt_two(source.topic, Some(followed.publisher), source.publisher);
        self.reject(Reject::SecondSource, || {
            let (topic, other) = (source.topic, followed.topic);
            if topic == other {
                return format!("another publisher's come on {topic} already; stop one of the two, or remap it");
            }
            format!("poses come on {other} already; remap {topic} away if it is not meant for this twin")
        });
        false
    }

    fn stamp(&mut self, source: &'static str, stamp: Time) -> i64 {
        if !is_time(stamp) && self.unstamped.pass().is_some() {
            tracing::warn!(
                "{source} has no stamps that are times: that of arrival is taken, and predicted_cf carries it"
            );
        }
        if !is_time(stamp) {
            self.doubt(Doubt::Unstamped(source), || UNSTAMPED.to_owned());
        }
        stamp_or_now(self.shared, stamp)
    }

    /// Handles a looped bag or a reset simulator.
    fn jump_back(&mut self, seconds: f64) {
        tracing::info!("time went back by {seconds:.3} s: the twin starts anew from the undeformed state");
        (self.last_stamp, self.first_stamp, self.frozen) = (None, None, Frozen::default());
        self.shared.lock().expect_reset();
        self.inbox.reset("time went back");
    }

    #[allow(clippy::cast_precision_loss)] // a time for a log line
    fn clock(&mut self, time: Time, received: Instant) {
        let clock = &self.shared.clock;
        let before = clock.now_nanos();
        let tick = clock.tick(time);
        // a clock that stands still counts as missing
        if clock.now_nanos() != before {
            self.shared.lock().last_clock = Some(received);
        }
        match tick {
            Tick::Back(nanos) if clock.is_simulated() => {
                // It was received before the present node time.
                self.shared.lock().last_pose = None;
                let held = self.stretch.end();
                self.jump_back(nanos as f64 * 1e-9);
                held.into_iter().for_each(|arrival| self.take(arrival));
            }
            Tick::Started if clock.is_simulated() => tracing::info!("simulated time has started"),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests;
