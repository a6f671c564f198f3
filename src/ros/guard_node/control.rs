//! The control thread: takes the received messages, runs the guard, and commands the driver.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use super::declared::{Goal, Line};
use needle_guard::{Boundary, Guard, Heard, Orders, Outlook, Phase, Sight, Trouble};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{PoseArray, WrenchStamped};
use ros2_messages::needle_twin::{self, Safety, TwinStatus};
use ros2_messages::rosgraph_msgs::Clock;
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use ros2_node::clock::NodeClock;
use ros2_node::origin::{Followed, Guid, Origin};
use ros2_node::participant::{Input, Output, Participant, ParticipantError};
use ros2_node::qos;

/// Largest number of ticks that are repeated after a delay.
const MADE_UP: u32 = 5;

/// Endpoints of the thread.
pub(super) struct Endpoints {
    measured: Input<JointState>,
    force: Input<WrenchStamped>,
    safety: Input<Safety>,
    status: Input<TwinStatus>,
    targets: Input<PoseArray>,
    /// Only if a probability is configured.
    outlook: Option<Input<needle_twin::Outlook>>,
    /// Only with simulated time.
    clock: Option<Input<Clock>>,
    servo: Output<JointState>,
}

impl Endpoints {
    /// The middleware drops setpoints older than the configured timeout, since a driver must not use them.
    pub(crate) fn new(
        participant: &mut Participant,
        orders: &Orders,
        use_sim_time: bool,
    ) -> Result<Self, ParticipantError> {
        let mut commands = qos::reliable(10);
        commands.lifespan = Duration::try_from_secs_f64(orders.timeout_s).ok();
        Ok(Self {
            measured: participant.subscription("measured_js", qos::sensor(10))?,
            force: participant.subscription("predicted_cf", qos::sensor(10))?,
            safety: participant.subscription("safety", qos::sensor(10))?,
            status: participant.subscription("status", qos::sensor(10))?,
            targets: participant.subscription("targets", qos::sensor(10))?,
            outlook: orders.ask_members().then(|| participant.subscription("outlook", qos::sensor(1))).transpose()?,
            clock: use_sim_time.then(|| participant.subscription("/clock", qos::sensor(1))).transpose()?,
            servo: participant.publisher("servo_jp", commands)?,
        })
    }
}

/// State shared by the threads of the node.
#[derive(Debug, Default)]
pub(super) struct Shared {
    report: Mutex<Option<Report>>,
    pub resume: AtomicBool,
}

/// State of the guard, for logs and diagnostics.
#[derive(Clone, Debug)]
pub(super) struct Report {
    pub phase: Phase,
    /// Problems that the twin reported in its last status.
    pub twin_says: Arc<str>,
    pub sight: Sight,
    pub speed_m_per_s: f64,
    pub setpoint_m: Option<f64>,
}

impl Shared {
    pub(crate) fn report(&self) -> Option<Report> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Report {
    /// Its state, and the reason if it does nothing.
    pub(crate) fn words(&self) -> String {
        match self.phase {
            Phase::Waiting(None) => "waiting".to_owned(),
            Phase::Waiting(Some(trouble)) => format!("waiting: {}", because(trouble, &self.twin_says)),
            Phase::Moving => "moving".to_owned(),
            Phase::Arrived => "arrived".to_owned(),
            Phase::Stopped(trouble) => format!("stopped: {}", because(trouble, &self.twin_says)),
        }
    }
}

/// A trouble, with the twin's own report if the trouble comes from the twin.
fn because(trouble: Trouble, twin_says: &str) -> String {
    match trouble {
        Trouble::NotVouched if !twin_says.is_empty() => format!("{trouble}: {twin_says}"),
        _ => trouble.to_string(),
    }
}

/// Configuration of the thread.
pub(super) struct Task {
    pub guard: Guard,
    pub goal: Goal,
    pub line: Line,
    /// The region that must not be entered.
    pub region: Option<String>,
    pub joint: String,
    pub period: Duration,
    pub exit_when_done: bool,
}

/// Runs until the goal is reached (if it is to end there) or `stop` is closed; the setpoint is brought to rest first.
///
/// # Errors
/// Why the task can't be carried out.
pub(super) fn run(mut task: Task, endpoints: &Endpoints, shared: &Shared, stop: &Receiver<()>) -> Result<(), String> {
    let mut ears = Ears::new(endpoints.clock.is_some());
    let mut looked = Instant::now();
    let mut due = looked + task.period;
    let mut without_force = false;
    while stop.recv_deadline(due) == Err(RecvTimeoutError::Timeout) {
        let now = Instant::now();
        due = if now > due + MADE_UP * task.period { now + task.period } else { due + task.period };
        ears.listen(endpoints, &task);
        if shared.resume.swap(false, Ordering::Relaxed) {
            task.guard.resume();
        }
        if matches!(task.guard.phase(), Phase::Waiting(_)) {
            ears.contradiction(&task)?;
        }
        let sight = ears.sight(&task, (now - looked).as_secs_f64());
        looked = now;
        let before = task.guard.phase();
        let setpoint_m = task.guard.tick(&sight);
        endpoints.say(&task.joint, setpoint_m, &ears.clock);
        tell(before, task.guard.phase(), sight.depth_m, &ears.twin_says);
        let moves_off = matches!((before, task.guard.phase()), (Phase::Waiting(_), Phase::Moving));
        // a twin that has just started says how its force changes some tenths of a second later
        if moves_off || (without_force && ears.steepest_n_per_m > 0.0) {
            tell_delay(task.guard.orders(), ears.steepest_n_per_m);
            without_force = ears.steepest_n_per_m <= 0.0;
        }
        let report = Report {
            phase: task.guard.phase(),
            twin_says: Arc::clone(&ears.twin_says),
            sight,
            speed_m_per_s: task.guard.speed_m_per_s(),
            setpoint_m,
        };
        *shared.report.lock().unwrap_or_else(PoisonError::into_inner) = Some(report);
        if task.guard.phase() == Phase::Arrived && task.exit_when_done {
            break;
        }
    }
    while let Some(setpoint_m) = task.guard.leave() {
        endpoints.say(&task.joint, Some(setpoint_m), &ears.clock);
        std::thread::sleep(task.period);
    }
    Ok(())
}

impl Endpoints {
    fn say(&self, joint: &str, setpoint_m: Option<f64>, clock: &NodeClock) {
        let Some(setpoint_m) = setpoint_m else { return };
        self.servo.send(JointState {
            header: Header { stamp: clock.stamp(), ..Header::default() },
            name: vec![joint.to_owned()],
            position: vec![setpoint_m],
            ..JointState::default()
        });
    }
}

/// Logs changes of the state, once each.
fn tell(before: Phase, after: Phase, depth_m: Option<Heard<f64>>, twin_says: &str) {
    let depth_m = depth_m.map_or(f64::NAN, |depth| depth.value);
    match (before, after) {
        (Phase::Waiting(_), Phase::Moving) => tracing::info!("moving, from depth {depth_m:.6} m"),
        (Phase::Moving, Phase::Arrived) => tracing::info!("arrived, depth {depth_m:.6} m"),
        (Phase::Moving | Phase::Arrived, Phase::Stopped(trouble)) => {
            let why = because(trouble, twin_says);
            tracing::error!("stopped at depth {depth_m:.6} m: {why}. Call ~/resume when it is put right");
        }
        (Phase::Stopped(_), Phase::Waiting(_)) => tracing::info!("going on"),
        (Phase::Waiting(a), Phase::Waiting(Some(trouble))) if a.map(name) != Some(name(trouble)) => {
            tracing::info!("waiting: {}", because(trouble, twin_says));
        }
        _ => {}
    }
}

/// Logs the effects of the largest age of messages and of the braking distance on the force.
fn tell_delay(orders: &Orders, steepest_n_per_m: f64) {
    let delay_s = orders.timeout_s + orders.motion.braking_time_s();
    let distance_m = delay_s * orders.motion.speed_m_per_s;
    let force = if steepest_n_per_m > 0.0 {
        format!("at most {:.2} mN, where the twin's force changes most", 1e3 * distance_m * steepest_n_per_m)
    } else {
        "a force that the twin has not said yet".to_owned()
    };
    tracing::info!(
        "what it acts on may be {:.0} ms old before it has come to rest: {:.3} mm at {:.1} mm/s, and {force}",
        1e3 * delay_s,
        1e3 * distance_m,
        1e3 * orders.motion.speed_m_per_s
    );
}

fn name(trouble: Trouble) -> std::mem::Discriminant<Trouble> {
    std::mem::discriminant(&trouble)
}

/// A received message.
#[derive(Clone, Copy, Debug)]
struct Word<T> {
    value: T,
    /// Zero if it has no stamp.
    stamp: Time,
    received: Instant,
}

impl<T: Copy> Word<T> {
    /// The value with its age, and with the age of its stamp relative to a time in ns.
    fn heard(&self, now: Instant, then_nanos: Option<i64>) -> Heard<T> {
        Heard {
            value: self.value,
            age_s: now.saturating_duration_since(self.received).as_secs_f64(),
            since_stamp_s: since_s(self.stamp, then_nanos),
        }
    }
}

/// Time from a stamp to a time in ns, s; infinite if one of them is missing.
#[allow(clippy::cast_precision_loss)] // a duration
fn since_s(stamp: Time, then_nanos: Option<i64>) -> f64 {
    let known = then_nanos.filter(|_| !stamp.is_zero());
    known.map_or(f64::INFINITY, |nanos| nanos.saturating_sub(stamp.nanos()) as f64 * 1e-9)
}

/// Publishers of the guard's input.
#[derive(Debug, Default)]
struct Publishers {
    position: Followed<Guid>,
    force: Followed<Guid>,
    safety: Followed<Guid>,
}

/// A publisher that has been silent for this time is gone.
const GONE: Duration = Duration::from_millis(500);

/// Number of stored positions for the comparison with the twin's answers: a second of a fast driver.
const REMEMBERED: usize = 1000;

/// Cosine of the angle below which directions count as equal: about a degree.
const SAME_DIRECTION: f64 = 0.99985;

/// The received messages with their times.
#[derive(Debug, Default)]
struct Ears {
    clock: NodeClock,
    publishers: Publishers,
    depth_m: Option<Word<f64>>,
    /// Depths of the last second, m, by stamp.
    depths_m: VecDeque<(Time, f64)>,
    /// Depth that the twin answered minus the measured depth with the same stamp, m.
    twin_offset_m: Option<f64>,
    force: Option<Word<[f64; 3]>>,
    safe: Option<Word<bool>>,
    /// Direction of the twin's needle.
    axis: Option<[f64; 3]>,
    steepest_n_per_m: f64,
    warned: bool,
    twin_says: Arc<str>,
    goal_m: Option<(f64, Instant)>,
    boundary: Option<(Boundary, Instant)>,
    outlook: Option<(Outlook, Instant)>,
}

impl Ears {
    fn new(use_sim_time: bool) -> Self {
        Self { clock: NodeClock::new(use_sim_time), ..Self::default() }
    }

    fn listen(&mut self, endpoints: &Endpoints, task: &Task) {
        while let Some(message) = endpoints.clock.as_ref().and_then(Input::take) {
            self.clock.tick(message.clock);
        }
        let now = Instant::now();
        while let Some((message, Origin { publisher, received })) = endpoints.measured.take_from() {
            if let Some(value) = position(&message, &task.joint)
                && self.publishers.position.takes(publisher, now, GONE)
            {
                let stamp = message.header.stamp;
                self.depth_m = Some(Word { value, stamp, received });
                if self.depths_m.len() == REMEMBERED {
                    self.depths_m.pop_front();
                }
                self.depths_m.push_back((stamp, value));
            }
        }
        while let Some((message, Origin { publisher, received })) = endpoints.force.take_from() {
            if self.publishers.force.takes(publisher, now, GONE) {
                self.force = Some(Word { value: message.wrench.force.into(), stamp: message.header.stamp, received });
            }
        }
        while let Some((message, Origin { publisher, received })) = endpoints.safety.take_from() {
            if self.publishers.safety.takes(publisher, now, GONE) {
                self.hear_safety(&message, received);
            }
        }
        while let Some(message) = endpoints.status.take() {
            self.warned = message.health != TwinStatus::HEALTH_OK;
            self.boundary = boundary(&message, task).map(|boundary| (boundary, now));
            let stamp = message.header.stamp;
            let measured = self.depths_m.iter().rev().find(|(then, _)| *then == stamp && !stamp.is_zero());
            self.twin_offset_m = measured.map(|(_, depth_m)| message.depth_m - depth_m);
        }
        while let Some(message) = endpoints.outlook.as_ref().and_then(Input::take) {
            self.outlook = outlook(&message, task).map(|outlook| (outlook, now));
        }
        while let Some(message) = endpoints.targets.take() {
            self.goal_m = depth_of_target(&message, task).map(|depth| (depth, now));
        }
    }

    fn hear_safety(&mut self, message: &Safety, received: Instant) {
        self.steepest_n_per_m = message.steepest_n_per_m;
        self.safe = Some(Word { value: message.safe, stamp: message.header.stamp, received });
        let axis: [f64; 3] = message.axis.into();
        self.axis = Some(axis).filter(|axis| axis.iter().all(|x| x.is_finite()) && *axis != [0.0; 3]).or(self.axis);
        let says = message.reasons.join("; ");
        if *says != *self.twin_says {
            self.twin_says = says.into();
        }
    }

    /// Checks that the guard's line is that of the twin's needle. The depth of a target is measured along the line,
    /// and a force against the opposite direction would be ignored.
    ///
    /// # Errors
    /// The contradiction between the two.
    fn contradiction(&self, task: &Task) -> Result<(), String> {
        let Some(axis) = self.axis else { return Ok(()) };
        let least = if matches!(task.goal, Goal::Target(_)) { SAME_DIRECTION } else { 0.0 };
        if task.line.along(axis) > least {
            return Ok(());
        }
        Err(format!(
            "the parameter axis is {:?}, and the twin's needle goes along {axis:?} (topic safety): give the guard that axis, and with \
             target_index the entry_m of the scene",
            task.line.axis()
        ))
    }

    fn sight(&self, task: &Task, held_up_s: f64) -> Sight {
        let now = Instant::now();
        let node_nanos = self.clock.now_nanos();
        let since = |then: Instant| now.saturating_duration_since(then).as_secs_f64();
        let (mut goal_m, goal_moves) = match task.goal {
            Goal::Depth(depth) => (Some(Heard::unstamped(depth, 0.0)), false),
            Goal::Target(_) => (self.goal_m.map(|(depth, then)| Heard::unstamped(depth, since(then))), true),
        };
        let mut odds = None;
        if let (Some((outlook, then)), Some(Word { value: depth_m, .. })) = (&self.outlook, self.depth_m) {
            // the target's position according to the members, which are updated by the load cell
            let target_m = outlook.target_depth_m(depth_m).filter(|_| goal_moves);
            goal_m = target_m.and_then(|value| Some(Heard { value, ..goal_m? })).or(goal_m);
            let goal = goal_m.map_or(f64::INFINITY, |goal| goal.value);
            let question = task.guard.orders().question(depth_m, goal);
            odds = outlook.odds(&question).map(|value| Heard::unstamped(value, since(*then)));
        }
        let newest = self.depth_m.map(|depth| depth.stamp).filter(|stamp| !stamp.is_zero());
        let force_n = self.force.map(|force| {
            let Heard { value, age_s, since_stamp_s } = force.heard(now, newest.map(Time::nanos));
            Heard { value: self.force_n(task, value), age_s, since_stamp_s }
        });
        let Publishers { position, force, safety } = &self.publishers;
        let speak = [(position, "measured_js"), (force, "predicted_cf"), (safety, "safety")];
        Sight {
            depth_m: self.depth_m.map(|depth| depth.heard(now, node_nanos)),
            force_n,
            safe: self.safe.map(|safe| safe.heard(now, node_nanos)),
            held_up_s,
            two_publish: speak.into_iter().find(|(who, _)| who.other(now, GONE).is_some()).map(|(_, topic)| topic),
            warned: self.warned,
            goal_m,
            boundary: self.boundary.map(|(value, then)| Heard::unstamped(value, since(then))),
            odds,
            goal_moves,
            twin_offset_m: self.twin_offset_m,
        }
    }

    /// The force that is compared with the limit: the component against the insertion, if the direction is known to
    /// be the twin's; otherwise the length of the vector.
    fn force_n(&self, task: &Task, force: [f64; 3]) -> f64 {
        if self.axis.is_some_and(|axis| task.line.along(axis) > SAME_DIRECTION) {
            task.line.against_n(force)
        } else {
            force.iter().map(|f| f * f).sum::<f64>().sqrt()
        }
    }
}

/// The position of the joint. A single position without a name is taken as the joint's.
fn position(message: &JointState, joint: &str) -> Option<f64> {
    let index = match message.name.iter().position(|name| name == joint) {
        None if message.name.is_empty() && message.position.len() == 1 => 0,
        found => found?,
    };
    message.position.get(index).copied()
}

/// The boundary of the region that must not be entered.
fn boundary(status: &TwinStatus, task: &Task) -> Option<Boundary> {
    let place = status.region_names.iter().position(|name| Some(name) == task.region.as_ref())?;
    let depth_m = status.region_depths_m.get(place).copied()?;
    Some(Boundary { depth_m, predicted: status.region_depths_predicted })
}

fn depth_of_target(message: &PoseArray, task: &Task) -> Option<f64> {
    let Goal::Target(index) = task.goal else { return None };
    message.poses.get(index).map(|pose| task.line.depth_m(pose.position.into()))
}

/// The members' look-ahead, with the target of the goal if there is one; `None` if the lengths of its lists don't
/// match.
fn outlook(message: &needle_twin::Outlook, task: &Task) -> Option<Outlook> {
    let places = message.depths_m.len();
    let (members, targets) = (message.members as usize, message.targets as usize);
    let points = [&message.targets_now, &message.targets_ahead];
    if places == 0 || message.forces_n.len() != members * places || points.iter().any(|p| p.len() != members * targets)
    {
        return None;
    }
    let of_target = |index: usize| {
        let place = |m: usize| points.map(|p| task.line.place(p[m * targets + index].into()));
        (index < targets).then(|| (0..members).map(place).collect::<Vec<_>>())
    };
    let targets = match task.goal {
        Goal::Depth(_) => Vec::new(),
        Goal::Target(index) => of_target(index)?,
    };
    let forces_n = message.forces_n.chunks(places).map(<[f64]>::to_vec).collect();
    Some(Outlook { depths_m: message.depths_m.clone(), forces_n, error_n: message.error_n, targets })
}
