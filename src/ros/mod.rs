//! ROS 2: messages, arguments, environment, nodes.

pub mod messages;
