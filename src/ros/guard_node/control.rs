//! The control thread: takes what has come, asks the guard, tells the driver.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use super::declared::{Goal, Line};
use crate::guard::{Boundary, Guard, Heard, Outlook, Phase, Sight, Trouble};
use crate::ros::clock::wall_nanos;
use crate::ros::messages::builtin_interfaces::Time;
use crate::ros::messages::geometry_msgs::{PoseArray, WrenchStamped};
use crate::ros::messages::needle_twin::{self, TwinStatus};
use crate::ros::messages::sensor_msgs::JointState;
use crate::ros::messages::std_msgs::{Bool, Header};
use crate::ros::participant::{Input, Output, Participant, ParticipantError};
use crate::ros::qos;

/// Ticks that are made up for after a hold-up.
const MADE_UP: u32 = 5;

/// Endpoints of the thread.
pub(super) struct Endpoints {
    measured: Input<JointState>,
    force: Input<WrenchStamped>,
    safe: Input<Bool>,
    status: Input<TwinStatus>,
    targets: Input<PoseArray>,
    /// Where a probability is asked.
    outlook: Option<Input<needle_twin::Outlook>>,
    servo: Output<JointState>,
}

impl Endpoints {
    pub fn new(participant: &mut Participant, ask_members: bool) -> Result<Self, ParticipantError> {
        Ok(Self {
            measured: participant.subscription("measured_js", qos::sensor(10))?,
            force: participant.subscription("predicted_cf", qos::sensor(10))?,
            safe: participant.subscription("safe_to_go_on", qos::sensor(10))?,
            status: participant.subscription("status", qos::sensor(10))?,
            targets: participant.subscription("targets", qos::sensor(10))?,
            outlook: ask_members.then(|| participant.subscription("outlook", qos::sensor(1))).transpose()?,
            servo: participant.publisher("servo_jp", qos::reliable(10))?,
        })
    }
}

/// What the threads of the node share.
#[derive(Debug, Default)]
pub(super) struct Shared {
    report: Mutex<Option<Report>>,
    pub resume: AtomicBool,
}

/// What the guard is doing, for people.
#[derive(Clone, Debug)]
pub(super) struct Report {
    pub phase: Phase,
    /// What the twin itself says is wrong, as of its last status.
    pub twin_says: Arc<str>,
    pub sight: Sight,
    pub speed_m_per_s: f64,
    pub setpoint_m: Option<f64>,
}

impl Shared {
    pub fn report(&self) -> Option<Report> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Report {
    /// What it is doing, and why it does nothing.
    pub fn words(&self) -> String {
        match self.phase {
            Phase::Waiting(None) => "waiting".to_owned(),
            Phase::Waiting(Some(trouble)) => format!("waiting: {}", because(trouble, &self.twin_says)),
            Phase::Moving => "moving".to_owned(),
            Phase::Arrived => "arrived".to_owned(),
            Phase::Stopped(trouble) => format!("stopped: {}", because(trouble, &self.twin_says)),
        }
    }
}

/// A trouble, and what the twin says of it where it is the twin's.
fn because(trouble: Trouble, twin_says: &str) -> String {
    match trouble {
        Trouble::NotVouched if !twin_says.is_empty() => format!("{trouble}: {twin_says}"),
        _ => trouble.to_string(),
    }
}

/// What the thread needs to know.
pub(super) struct Task {
    pub guard: Guard,
    pub goal: Goal,
    pub line: Line,
    /// Must not be entered.
    pub region: Option<String>,
    pub joint: String,
    pub period: Duration,
    pub exit_when_done: bool,
}

/// Runs until the goal is reached (if it is to end there) or `stop` is closed; the setpoint is brought to rest
/// first.
pub(super) fn run(mut task: Task, endpoints: &Endpoints, shared: &Shared, stop: &Receiver<()>) {
    let mut ears = Ears::default();
    let mut due = Instant::now() + task.period;
    while stop.recv_deadline(due) == Err(RecvTimeoutError::Timeout) {
        let now = Instant::now();
        due = if now > due + MADE_UP * task.period { now + task.period } else { due + task.period };
        ears.listen(endpoints, &task);
        if shared.resume.swap(false, Ordering::Relaxed) {
            task.guard.resume();
        }
        let sight = ears.sight(&task);
        let before = task.guard.phase();
        let setpoint_m = task.guard.tick(&sight);
        endpoints.say(&task.joint, setpoint_m);
        tell(before, task.guard.phase(), sight.depth_m, &ears.twin_says);
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
        endpoints.say(&task.joint, Some(setpoint_m));
        std::thread::sleep(task.period);
    }
}

impl Endpoints {
    fn say(&self, joint: &str, setpoint_m: Option<f64>) {
        let Some(setpoint_m) = setpoint_m else { return };
        self.servo.send(JointState {
            header: Header { stamp: Time::from_nanos(wall_nanos()), ..Header::default() },
            name: vec![joint.to_owned()],
            position: vec![setpoint_m],
            ..JointState::default()
        });
    }
}

/// Says what changes, once.
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

fn name(trouble: Trouble) -> std::mem::Discriminant<Trouble> {
    std::mem::discriminant(&trouble)
}

/// What has come, and when.
#[derive(Debug, Default)]
struct Ears {
    depth_m: Option<(f64, Instant)>,
    force: Option<([f64; 3], Instant)>,
    safe: Option<(bool, Instant)>,
    warned: bool,
    twin_says: Arc<str>,
    goal_m: Option<(f64, Instant)>,
    boundary: Option<(Boundary, Instant)>,
    outlook: Option<(Outlook, Instant)>,
}

impl Ears {
    fn listen(&mut self, endpoints: &Endpoints, task: &Task) {
        let now = Instant::now();
        while let Some(message) = endpoints.measured.take() {
            self.depth_m = position(&message, &task.joint).map(|depth| (depth, now)).or(self.depth_m);
        }
        while let Some(message) = endpoints.force.take() {
            self.force = Some((message.wrench.force.into(), now));
        }
        while let Some(message) = endpoints.safe.take() {
            self.safe = Some((message.data, now));
        }
        while let Some(message) = endpoints.status.take() {
            self.warned = message.health != TwinStatus::HEALTH_OK;
            self.boundary = boundary(&message, task).map(|boundary| (boundary, now));
            let says = message.reasons.join("; ");
            if *says != *self.twin_says {
                self.twin_says = says.into();
            }
        }
        while let Some(message) = endpoints.outlook.as_ref().and_then(Input::take) {
            self.outlook = outlook(&message, task).map(|outlook| (outlook, now));
        }
        while let Some(message) = endpoints.targets.take() {
            self.goal_m = depth_of_target(&message, task).map(|depth| (depth, now));
        }
    }

    fn sight(&self, task: &Task) -> Sight {
        let now = Instant::now();
        let aged = |(value, then): (f64, Instant)| Heard { value, age_s: (now - then).as_secs_f64() };
        let (mut goal_m, goal_moves) = match task.goal {
            Goal::Depth(depth) => (Some(Heard { value: depth, age_s: 0.0 }), false),
            Goal::Target(_) => (self.goal_m.map(aged), true),
        };
        let mut odds = None;
        if let (Some((outlook, then)), Some((depth_m, _))) = (&self.outlook, self.depth_m) {
            let age_s = (now - *then).as_secs_f64();
            // where the members have the target, since they have learnt from the load cell
            let target_m = outlook.target_depth_m(depth_m).filter(|_| goal_moves);
            goal_m = target_m.and_then(|value| Some(Heard { value, ..goal_m? })).or(goal_m);
            let goal = goal_m.map_or(f64::INFINITY, |goal| goal.value);
            odds = outlook.odds(&task.guard.orders().question(depth_m, goal)).map(|value| Heard { value, age_s });
        }
        Sight {
            depth_m: self.depth_m.map(aged),
            force_n: self.force.map(|(force, then)| aged((task.line.against_n(force), then))),
            safe: self.safe.map(|(value, then)| Heard { value, age_s: (now - then).as_secs_f64() }),
            warned: self.warned,
            goal_m,
            boundary: self.boundary.map(|(value, then)| Heard { value, age_s: (now - then).as_secs_f64() }),
            odds,
            goal_moves,
        }
    }
}

/// The position of the joint; one position without a name is taken for it.
fn position(message: &JointState, joint: &str) -> Option<f64> {
    let index = match message.name.iter().position(|name| name == joint) {
        None if message.name.is_empty() && message.position.len() == 1 => 0,
        found => found?,
    };
    message.position.get(index).copied()
}

/// Where the region begins that must not be entered.
fn boundary(status: &TwinStatus, task: &Task) -> Option<Boundary> {
    let place = status.region_names.iter().position(|name| Some(name) == task.region.as_ref())?;
    let depth_m = status.region_depths_m.get(place).copied()?;
    Some(Boundary { depth_m, predicted: status.region_depths_predicted })
}

fn depth_of_target(message: &PoseArray, task: &Task) -> Option<f64> {
    let Goal::Target(index) = task.goal else { return None };
    message.poses.get(index).map(|pose| task.line.depth_m(pose.position.into()))
}

/// The members' outlook, with the target to go to where there is one; `None` of one whose lists don't fit together.
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
