//! The driver thread: `servo_jp` in, a motion with limits, and what the sensors make of it: `measured_js`, and
//! `measured_cf` where the rig has a load cell.

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use super::declared::TISSUE_STIFFNESS;
use crate::rig::make::Curve;
use crate::rig::sensors::{DisplacementSensor, LoadCell};
use crate::rig::{Delay, Driver};
use crate::ros::clock::NodeClock;
use crate::ros::logging::Throttle;
use crate::ros::messages::builtin_interfaces::Time;
use crate::ros::messages::geometry_msgs::{Wrench, WrenchStamped};
use crate::ros::messages::sensor_msgs::JointState;
use crate::ros::messages::std_msgs::Header;
use crate::ros::parameters::Parameters;
use crate::ros::participant::{Input, Output, Participant, ParticipantError};
use crate::ros::qos;

/// Steps that are made up for after a hold-up: a burst of more would age a command that has just come.
const MADE_UP: u32 = 5;

/// Endpoints of the driver.
pub(super) struct Endpoints {
    servo: Input<JointState>,
    measured: Output<JointState>,
    force: Option<Output<WrenchStamped>>,
}

impl Endpoints {
    pub fn new(participant: &mut Participant, load_cell: bool) -> Result<Self, ParticipantError> {
        Ok(Self {
            servo: participant.subscription("servo_jp", qos::sensor(10))?,
            measured: participant.publisher("measured_js", qos::reliable(10))?,
            force: if load_cell { Some(participant.publisher("measured_cf", qos::reliable(10))?) } else { None },
        })
    }
}

/// A load cell, and the tissue that presses on it.
pub(super) struct Load {
    pub cell: LoadCell,
    /// Force over depth during insertion, from `bags/reference/`.
    pub tissue: Curve,
    pub frame_id: String,
}

/// The needle and its sensors.
pub(super) struct Rig {
    pub driver: Driver,
    pub displacement: DisplacementSensor,
    pub load: Option<Load>,
    pub joint: String,
    pub period: Duration,
    pub latency_s: f64,
}

/// Readings of one moment.
struct Readings {
    joint: JointState,
    force: Option<WrenchStamped>,
}

/// Moves until `stop` is closed; returns how many positions were published.
pub(super) fn run(
    mut rig: Rig,
    endpoints: &Endpoints,
    parameters: &Parameters,
    clock: &NodeClock,
    stop: &Receiver<()>,
) -> u64 {
    let period = rig.period;
    let mut line = Delay::new(rig.latency_s, period.as_secs_f64());
    let mut wrong_joint = Throttle::new(Duration::from_secs(30));
    let begun = Instant::now();
    let mut due = begun + period;
    let mut published = 0;
    loop {
        match stop.recv_deadline(due) {
            Err(RecvTimeoutError::Timeout) => {}
            _ => return published,
        }
        // Absolute deadlines. After a long hold-up the motion goes on from where it stands: no burst of positions.
        let now = Instant::now();
        due = if now > due + MADE_UP * period { now + period } else { due + period };
        while let Some(message) = endpoints.servo.take() {
            obey(&mut rig.driver, &message, &rig.joint, &mut wrong_joint);
        }
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
    /// What the sensors say at this moment.
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

fn obey(driver: &mut Driver, message: &JointState, joint: &str, wrong_joint: &mut Throttle) {
    match goal(message, joint) {
        Some(goal) if driver.go_to(goal) => {}
        Some(goal) => tracing::warn!("servo_jp: {goal} is not a position: send a depth in m, a finite number"),
        None if wrong_joint.pass().is_some() => {
            tracing::warn!(
                "servo_jp has the joints {:?}, this driver moves `{joint}`: name that one, or set joint_name",
                message.name
            );
        }
        None => {}
    }
}

/// The position for the joint; one position without a name is taken for it.
fn goal(message: &JointState, joint: &str) -> Option<f64> {
    let index = match message.name.iter().position(|name| name == joint) {
        None if message.name.is_empty() && message.position.len() == 1 => 0,
        found => found?,
    };
    message.position.get(index).copied()
}
