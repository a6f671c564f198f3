//! The product around the digital twin of a needle-insertion test rig: ROS 2 nodes, the live page and the command line.
//! A program that wants the twin alone takes `needle_core`.
//!
//! ```text
//! mtled_cloud ◄─ mtled ◄─ needle_core ◄─ needle_recording ◄─ needle_estimate ◄─ needle_studies ◄─ needle_report ◄┐
//!                          ros2_messages ◄─ ros2_guarded ◄─ ros2_node ◄──────────────────────────── needle_twin ┘
//! ```
//!
//! A room of this crate uses only rooms before it: live, ros, cli (`tests/rooms.rs`).
//! What lies in a crate of its own is held by cargo.
//!
//! The handbook, `docs/README.md` in the repository, says how to use the programs.
#![allow(non_snake_case)] // the code uses the formula's own symbols: F, P, J
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

pub mod cli;
#[cfg(feature = "page")]
pub mod live;
#[cfg(feature = "ros")]
pub mod ros;
