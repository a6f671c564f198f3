//! The twin, the rig and the guard as ROS 2 nodes, with their own DDS (no ROS installation needed).
//!
//! The functions that every ROS 2 program needs are in the crate `ros2_node`.

pub(crate) mod guard_node;
pub(crate) mod observer;
pub mod rig_node;
mod scene_parameters;
pub mod twin_node;
