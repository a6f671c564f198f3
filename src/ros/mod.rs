//! ROS 2: the twin and the rig as nodes, over a DDS of our own (no ROS installation needed).
//!
//! `arguments`, `environment`, `names`, `parameters`, `qos`, `clock` and `logging` are what every ROS 2 program does;
//! `participant` is the network (over the guarded middleware process of `ros2_guarded`); `twin_node`, `rig_node` and `guard_node` are the nodes.

pub mod arguments;
pub mod clock;
mod endpoint;
pub mod environment;
pub mod guard_node;
pub mod lifecycle;
mod lifecycle_services;
mod logger_services;
pub mod logging;
pub mod names;
pub mod observer;
mod origin;
pub mod parameter;
pub mod parameter_file;
mod parameter_services;
pub mod parameters;
pub mod participant;
pub mod qos;
mod recorder;
pub mod rig_node;
pub mod rosout;
mod scene_parameters;
pub mod service;
pub mod start;
pub mod twin_node;

pub use parameter_file::YamlError;
/// The middleware process; a program whose nodes come from this library calls `serve` first of all in `main`.
pub use ros2_guarded as middleware;
pub use ros2_messages as messages;
