//! The functions of rcl for nodes based on `ros2-client`.
//!
//! [`arguments`], [`environment`], [`names`], [`parameters`], [`qos`], [`clock`], [`lifecycle`] and [`logging`] are
//! what every ROS 2 program has. [`participant`] is the network, through the guarded middleware process of
//! `ros2_guarded`. [`recorder`] records what the node sends and receives into a bag. [`mod@start`] combines them.
//!
//! A program that uses this crate calls [`ros2_guarded::serve`] first of all in `main`.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

pub mod arguments;
pub mod clock;
mod declaration;
mod endpoint;
pub mod environment;
mod error;
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
