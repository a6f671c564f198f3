//! ROS 2 messages as plain serde structs: field order is the order of the .msg file, nothing is derived from elsewhere.
//!
//! One file per ROS package. The same structs go over DDS and into bags; [`to_cdr`] and [`from_cdr`] turn them into
//! the bytes of a bag (a 4-byte encapsulation header, then CDR); [`schema`](mod@schema) has the definition and the hash
//! that a bag's channel carries. Each type is checked byte for byte against an independent reader, because a wrong field
//! order is silent on the wire.
//!
//! ```
//! use ros2_messages::{from_cdr, std_msgs::Float64, to_cdr};
//!
//! let bytes = to_cdr(&Float64 { data: 1.5 })?;
//! assert_eq!(bytes.len(), 4 + 8);
//! assert_eq!(from_cdr::<Float64>(&bytes)?.data, 1.5);
//! # Ok::<(), ros2_messages::CdrError>(())
//! ```
#![forbid(unsafe_code)]

pub mod builtin_interfaces;
mod cdr;
pub mod diagnostic_msgs;
pub mod geometry_msgs;
pub mod lifecycle_msgs;
pub mod logger_levels;
pub mod needle_twin;
pub mod rosbag2_interfaces;
pub mod rosgraph_msgs;
pub mod schema;
pub mod sensor_msgs;
pub mod std_msgs;
pub mod std_srvs;
pub mod tf2_msgs;
mod type_hash;
pub mod visualization_msgs;

pub use cdr::{CdrError, from_cdr, to_cdr, to_cdr_in};
pub use type_hash::{hashed_types, type_hash};

/// A message type that has a name in ROS: what a topic, a bag channel or a schema is labelled with.
pub trait RosMessage: serde::Serialize + serde::de::DeserializeOwned {
    /// Package, `sensor_msgs`.
    const PACKAGE: &'static str;
    /// Name within the package, `JointState`.
    const NAME: &'static str;
    /// Full name as bags and `ros2 topic list -t` write it, `sensor_msgs/msg/JointState`.
    const TYPE: &'static str;
}

/// Implements [`RosMessage`] for the messages of one package.
macro_rules! ros_messages {
    ($package:literal: $($name:ident),+ $(,)?) => {$(
        impl $crate::RosMessage for $name {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($name);
            const TYPE: &'static str = concat!($package, "/msg/", stringify!($name));
        }
    )+};
}
use ros_messages;

/// The examples of README.md.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
