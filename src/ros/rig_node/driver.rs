//! The driver thread: `servo_jp` in, a motion with limits, `measured_js` out.

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};

use crate::rig::Driver;
use crate::ros::clock::NodeClock;
use crate::ros::logging::Throttle;
use crate::ros::messages::sensor_msgs::JointState;
use crate::ros::messages::std_msgs::Header;
use crate::ros::participant::{Input, Output, Participant, ParticipantError};
use crate::ros::qos;

/// Endpoints of the driver.
pub(super) struct Endpoints {
    servo: Input<JointState>,
    measured: Output<JointState>,
}

impl Endpoints {
    pub fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self {
            servo: participant.subscription("servo_jp", qos::sensor(10))?,
            measured: participant.publisher("measured_js", qos::reliable(10))?,
        })
    }
}

/// Moves until `stop` is closed; returns how many positions were published.
pub(super) fn run(
    mut driver: Driver,
    endpoints: &Endpoints,
    joint: &str,
    rate_hz: f64,
    clock: &NodeClock,
    stop: &Receiver<()>,
) -> u64 {
    let period = Duration::from_secs_f64(1.0 / rate_hz);
    let mut wrong_joint = Throttle::new(Duration::from_secs(30));
    let mut due = Instant::now() + period;
    let mut published = 0;
    loop {
        match stop.recv_deadline(due) {
            Err(RecvTimeoutError::Timeout) => {}
            _ => return published,
        }
        // Absolute deadlines. After a long hold-up the motion goes on from where it stands: no burst of positions.
        let now = Instant::now();
        due = if now > due + 100 * period { now + period } else { due + period };
        while let Some(message) = endpoints.servo.take() {
            match goal(&message, joint) {
                Some(goal) if driver.go_to(goal) => {}
                Some(goal) => tracing::warn!("servo_jp: {goal} is not a position"),
                None if wrong_joint.pass().is_some() => {
                    tracing::warn!("servo_jp has the joints {:?}, this driver moves `{joint}`", message.name);
                }
                None => {}
            }
        }
        driver.step(period.as_secs_f64());
        let Some(now) = clock.now_nanos() else { continue };
        endpoints.measured.send(JointState {
            header: Header {
                stamp: crate::ros::messages::builtin_interfaces::Time::from_nanos(now),
                ..Header::default()
            },
            name: vec![joint.to_owned()],
            position: vec![driver.position_m()],
            velocity: vec![driver.velocity_m_per_s()],
            effort: Vec::new(),
        });
        published += 1;
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
