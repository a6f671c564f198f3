//! ROS 2: the twin and the rig as nodes, over a DDS of our own (no ROS installation needed).
//!
//! `arguments`, `environment`, `names`, `parameters`, `qos`, `clock` and `logging` are what every ROS 2 program does;
//! `participant` and `middleware` are the network; `twin_node`, `rig_node` and `guard_node` are the nodes.

pub mod arguments;
mod bell;
pub mod clock;
mod endpoint;
pub mod environment;
pub mod guard_node;
pub mod lifecycle;
mod lifecycle_services;
pub mod logging;
pub mod messages;
pub mod middleware;
pub mod names;
pub mod observer;
pub mod parameter_file;
mod parameter_services;
pub mod parameters;
pub mod participant;
pub mod qos;
mod raw;
mod recorder;
pub mod rig_node;
pub mod rosout;
mod scene_parameters;
pub mod service;
pub mod signals;
pub mod start;
mod threads;
pub mod twin_node;

pub use parameter_file::YamlError;
