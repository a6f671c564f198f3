//! The twin, the rig and the guard as ROS 2 nodes, over a DDS of our own (no ROS installation needed).
//!
//! What every ROS 2 program does is the crate `ros2_node`.

pub mod guard_node;
pub mod observer;
pub mod rig_node;
mod scene_parameters;
pub mod twin_node;
