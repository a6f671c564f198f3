//! ROS 2 messages as plain serde structs: field order is the order of the .msg file, nothing is derived from elsewhere.
//!
//! One file per ROS package. The same structs go over DDS and into bags; [`to_cdr`] and [`from_cdr`] turn them into
//! the bytes of a bag (a 4-byte encapsulation header, then CDR). Each type is checked byte for byte against an
//! independent reader in `tests/bags.rs`, because a wrong field order is silent on the wire.

pub mod builtin_interfaces;
mod cdr;
pub mod diagnostic_msgs;
pub mod geometry_msgs;
pub mod lifecycle_msgs;
pub mod needle_twin;
pub mod rosbag2_interfaces;
pub mod rosgraph_msgs;
pub mod sensor_msgs;
pub mod std_msgs;
pub mod std_srvs;
pub mod visualization_msgs;

pub use cdr::{CdrError, from_cdr, to_cdr};

/// A message type that has a name in ROS: what a topic, a bag channel or a schema is labelled with.
pub trait RosMessage: serde::Serialize + serde::de::DeserializeOwned {
    /// Package, `sensor_msgs`.
    const PACKAGE: &'static str;
    /// Name within the package, `JointState`.
    const NAME: &'static str;
    /// Full name as bags and `ros2 topic list -t` write it, `sensor_msgs/msg/JointState`.
    const TYPE: &'static str;
}

/// Implements [`RosMessage`] and ros2-client's marker trait for the messages of one package.
macro_rules! ros_messages {
    ($package:literal: $($name:ident),+ $(,)?) => {$(
        impl $crate::ros::messages::RosMessage for $name {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($name);
            const TYPE: &'static str = concat!($package, "/msg/", stringify!($name));
        }
        impl ros2_client::Message for $name {}
    )+};
}
use ros_messages;
