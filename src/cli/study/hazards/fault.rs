//! The faults, and what each makes of a message.

use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Vector3, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;

/// Stamps of a clock that is wrong are off by this, ns.
const OFF_NANOS: i64 = 500_000_000;
/// A reading that jumps does by this, m or N.
const JUMP_M: f64 = 0.004;
const JUMP_N: f64 = 50.0;

/// What goes wrong with a stream of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// Nothing comes.
    Silent,
    /// The value stands still, with new stamps.
    Frozen,
    /// The last message again and again.
    Repeated,
    /// It comes half a second late, with the stamps that it had.
    Late,
    /// The sender's clock is half a second behind.
    Behind,
    /// The sender's clock is half a second ahead.
    Ahead,
    /// The value jumps and stays there.
    Jumping,
    /// The sign is turned.
    WrongSign,
    /// Millimetres for metres, millinewtons for newtons.
    WrongUnit,
    NotFinite,
    /// A second publisher says zero.
    TwoSources,
    /// Another joint; the force along another axis.
    WrongFrame,
    /// Something presses from the side, the force along the needle is right.
    Across,
    /// Something twists.
    Twisted,
}

impl Fault {
    pub(crate) const fn words(self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::Frozen => "frozen",
            Self::Repeated => "repeated",
            Self::Late => "0.5 s late",
            Self::Behind => "clock 0.5 s behind",
            Self::Ahead => "clock 0.5 s ahead",
            Self::Jumping => "jumping",
            Self::WrongSign => "wrong sign",
            Self::WrongUnit => "wrong unit",
            Self::NotFinite => "NaN",
            Self::TwoSources => "two sources",
            Self::WrongFrame => "wrong frame",
            Self::Across => "50 N across",
            Self::Twisted => "0.5 N m",
        }
    }

    /// How long each message is held, ns.
    pub(crate) const fn delay_nanos(self) -> i64 {
        if matches!(self, Self::Late) { OFF_NANOS } else { 0 }
    }

    fn stamp(self, stamp: Time) -> Time {
        match self {
            Self::Behind => Time::from_nanos(stamp.nanos() - OFF_NANOS),
            Self::Ahead => Time::from_nanos(stamp.nanos() + OFF_NANOS),
            _ => stamp,
        }
    }
}

/// A message that can be spoilt.
pub(super) trait Spoilt: Clone {
    /// The message as the fault makes it. `first`: the last good one.
    fn spoilt(self, fault: Fault, first: &Self) -> Option<Self>;

    /// What a second publisher says.
    fn zero(&self) -> Self;
}

impl Spoilt for JointState {
    fn spoilt(mut self, fault: Fault, first: &Self) -> Option<Self> {
        self.header.stamp = fault.stamp(self.header.stamp);
        let place = self.position.first_mut()?;
        match fault {
            Fault::Silent => return None,
            Fault::Repeated => return Some(first.clone()),
            Fault::Frozen => self.position.clone_from(&first.position),
            Fault::Jumping => *place += JUMP_M,
            Fault::WrongSign => *place = -*place,
            Fault::WrongUnit => *place *= 1e3,
            Fault::NotFinite => *place = f64::NAN,
            Fault::WrongFrame => self.name = vec!["elbow".to_owned()],
            _ => {}
        }
        Some(self)
    }

    fn zero(&self) -> Self {
        Self { position: vec![0.0], ..self.clone() }
    }
}

impl Spoilt for WrenchStamped {
    fn spoilt(mut self, fault: Fault, first: &Self) -> Option<Self> {
        self.header.stamp = fault.stamp(self.header.stamp);
        let force = &mut self.wrench.force;
        match fault {
            Fault::Silent => return None,
            Fault::Repeated => return Some(first.clone()),
            Fault::Frozen => *force = first.wrench.force,
            Fault::Jumping => force.z += JUMP_N,
            Fault::WrongSign => *force = scaled(*force, -1.0),
            Fault::WrongUnit => *force = scaled(*force, 1e3),
            Fault::NotFinite => *force = scaled(*force, f64::NAN),
            Fault::WrongFrame => *force = Vector3 { x: force.z, y: 0.0, z: 0.0 },
            Fault::Across => force.x += JUMP_N,
            Fault::Twisted => self.wrench.torque.x += 0.5,
            _ => {}
        }
        Some(self)
    }

    fn zero(&self) -> Self {
        let mut zero = self.clone();
        zero.wrench.force = Vector3::default();
        zero
    }
}

fn scaled(Vector3 { x, y, z }: Vector3, by: f64) -> Vector3 {
    Vector3 { x: by * x, y: by * y, z: by * z }
}
