//! What rcl gives a node, for programs over `ros2-client`.
//!
//! [`arguments`], [`environment`], [`names`], [`parameters`], [`qos`], [`clock`], [`lifecycle`] and [`logging`] are what every ROS 2
//! program does; [`participant`] is the network, over the guarded middleware process of `ros2_guarded`; [`recorder`] records what
//! the node sends and hears into a bag. [`mod@start`] puts them together.
//!
//! A program that takes this crate calls [`ros2_guarded::serve`] first of all in `main`.
#![forbid(unsafe_code)]

pub mod arguments;
pub mod clock;
mod endpoint;
pub mod environment;
pub mod lifecycle;
pub mod lifecycle_services;
pub mod logger_services;
pub mod logging;
pub mod names;
pub mod origin;
pub mod parameter;
pub mod parameter_file;
pub mod parameter_services;
pub mod parameters;
pub mod participant;
pub mod qos;
pub mod recorder;
pub mod rosout;
pub mod service;
pub mod start;

pub use parameter_file::YamlError;
