//! The driver thread. `servo_jp` commands a motion with limits. The sensors' readings of it are published as
//! `measured_js` and, if the rig has a load cell, `measured_cf`.

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use super::declared::{Load, Rig, TISSUE_STIFFNESS};
use needle_rig::{Delay, Driver};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use ros2_node::clock::NodeClock;
use ros2_node::logging::Throttle;
use ros2_node::origin::{Followed, Guid};
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Input, Output, Participant, ParticipantError};
use ros2_node::qos;

/// Largest number of steps that are repeated after a delay. A larger burst would age a command that has just arrived.
const MADE_UP: u32 = 5;

/// Endpoints of the driver.
pub(super) struct Endpoints {
    servo: Input<JointState>,
    measured: Output<JointState>,
    force: Option<Output<WrenchStamped>>,
}

impl Endpoints {
    pub(crate) fn new(participant: &mut Participant, load_cell: bool) -> Result<Self, ParticipantError> {
        Ok(Self {
            servo: participant.subscription("servo_jp", qos::sensor(10))?,
            measured: participant.publisher("measured_js", qos::reliable(10))?,
            force: if load_cell { Some(participant.publisher("measured_cf", qos::reliable(10))?) } else { None },
        })
    }
}

/// Readings at one time.
struct Readings {
    joint: JointState,
    force: Option<WrenchStamped>,
}

/// Runs until `stop` is closed; returns the number of published positions.
pub(super) fn run(
    mut rig: Rig,
    endpoints: &Endpoints,
    parameters: &Parameters,
    clock: &NodeClock,
    stop: &Receiver<()>,
) -> u64 {
    let period = rig.period;
    let mut line = Delay::new(rig.latency_s, period.as_secs_f64());
    let mut commands = Commands::default();
    let begun = Instant::now();
    let mut due = begun + period;
    let mut published = 0;
    loop {
        match stop.recv_deadline(due) {
            Err(RecvTimeoutError::Timeout) => {}
            _ => return published,
        }
        // Absolute deadlines. After a long delay the motion continues from its present state, without a burst of
        // positions.
        let now = Instant::now();
        let timeout_s = rig.driver.limits().command_timeout_s;
        if timeout_s > 0.0 && (now - due).as_secs_f64() > timeout_s {
            rig.driver.halt();
        }
        due = if now > due + MADE_UP * period { now + period } else { due + period };
        commands.take(&endpoints.servo, &mut rig, clock);
        if rig.driver.step() {
            tracing::warn!("servo_jp has ceased: the driver brakes (command_timeout_s)");
        }
        let Some(stamp) = clock.now_nanos() else { continue };
        let stiffness = parameters.get(TISSUE_STIFFNESS);
        let readings = rig.read(Time::from_nanos(stamp), (now - begun).as_secs_f64(), stiffness);
        if let Some(Readings { joint, force }) = line.pass(readings) {
            endpoints.measured.send(joint);
            if let Some((output, force)) = endpoints.force.as_ref().zip(force) {
                output.send(force);
            }
            published += 1;
        }
    }
}

impl Rig {
    /// The sensors' readings at this time.
    fn read(&mut self, stamp: Time, time_s: f64, stiffness: f64) -> Readings {
        let depth_m = self.driver.position_m();
        let joint = JointState {
            header: Header { stamp, ..Header::default() },
            name: vec![self.joint.clone()],
            position: vec![self.displacement.read(depth_m)],
            velocity: vec![self.driver.velocity_m_per_s()],
            effort: Vec::new(),
        };
        let force = self.load.as_mut().map(|Load { cell, tissue, frame_id }| WrenchStamped {
            header: Header { stamp, frame_id: frame_id.clone() },
            wrench: Wrench {
                force: [0.0, 0.0, cell.read(stiffness * tissue.force_n(depth_m), time_s)].into(),
                ..Wrench::default()
            },
        });
        Readings { joint, force }
    }
}

/// Shortest interval between two log lines of one kind about commands.
const SAID_AGAIN: Duration = Duration::from_secs(30);
/// For commands without a stamp, or a driver without `command_timeout_s`: a commander that is silent for this time is
/// gone.
const GONE: Duration = Duration::from_millis(500);

/// The commands to the driver, and their publisher.
struct Commands {
    commander: Followed<Guid>,
    wrong_joint: Throttle,
    stale: Throttle,
    two: Throttle,
}

impl Default for Commands {
    fn default() -> Self {
        let [wrong_joint, stale, two] = [(); 3].map(|()| Throttle::new(SAID_AGAIN));
        Self { commander: Followed::default(), wrong_joint, stale, two }
    }
}

impl Commands {
    fn take(&mut self, servo: &Input<JointState>, rig: &mut Rig, clock: &NodeClock) {
        let timeout_s = rig.driver.limits().command_timeout_s;
        let now = Instant::now();
        while let Some((message, origin)) = servo.take_from() {
            self.commander.takes(origin.publisher, now, GONE);
            if self.commander.other(now, GONE).is_none() && self.is_of_now(&message, timeout_s, clock) {
                self.obey(&mut rig.driver, &message, &rig.joint);
            }
        }
        // Two controllers of one needle: the driver can't know whose goal is right.
        if let Some(other) = self.commander.other(now, GONE) {
            rig.driver.brake();
            if self.two.pass().is_some() {
                let followed = self.commander.source().unwrap_or_default();
                tracing::warn!(
                    "servo_jp has two publishers ({followed} and {other}): the driver stands until one is silent. Stop one of them"
                );
            }
        }
    }

    /// Rejects a command that was queued while its sender or this node was suspended. A command without a stamp, as
    /// sent by hand, is accepted.
    #[allow(clippy::cast_precision_loss)] // a duration
    fn is_of_now(&mut self, message: &JointState, timeout_s: f64, clock: &NodeClock) -> bool {
        let stamp = message.header.stamp;
        let (Some(now), false) = (clock.now_nanos(), stamp.is_zero() || timeout_s <= 0.0) else { return true };
        let age_s = now.saturating_sub(stamp.nanos()) as f64 * 1e-9;
        let is_of_now = age_s.abs() <= timeout_s;
        if !is_of_now && self.stale.pass().is_some() {
            tracing::warn!(
                "servo_jp is not obeyed: its stamp is {age_s:.3} s from this node's clock, command_timeout_s is {timeout_s}: it is late, or the \
                 clocks differ"
            );
        }
        is_of_now
    }

    fn obey(&mut self, driver: &mut Driver, message: &JointState, joint: &str) {
        match goal(message, joint) {
            Some(goal) if driver.go_to(goal) => {}
            Some(goal) => tracing::warn!("servo_jp: {goal} is not a position: send a depth in m, a finite number"),
            None if self.wrong_joint.pass().is_some() => {
                tracing::warn!(
                    "servo_jp has the joints {:?}, this driver moves `{joint}`: name that one, or set joint_name",
                    message.name
                );
            }
            None => {}
        }
    }
}

/// The position for the joint. A single position without a name is taken as the joint's.
fn goal(message: &JointState, joint: &str) -> Option<f64> {
    let index = match message.name.iter().position(|name| name == joint) {
        None if message.name.is_empty() && message.position.len() == 1 => 0,
        found => found?,
    };
    message.position.get(index).copied()
}
