//! Digital twin of a needle-insertion test rig, numbers only.
//!
//! A pose comes in, the scene turns it into constraints, the solver takes the steps that the pose is
//! worth, and a prediction goes out: [`twin::Twin::step`].
//!
//! ```text
//! scene (TOML) ─► cloud ─► approximation ─► solver model            built once
//!                                               ▲
//! pose ─► instrument (pose → constraints) ──────┤                   every pose
//!                                               ▼
//!                         solver state ─► twin (pace, health, observation) ─► prediction
//! ```
//!
//! No sockets, no files but those of the scene, and no clock that a result depends on. The method itself is the crate `mtled`.
//!
//! A preset, three poses, and the force of the tissue on the indenter:
//!
//! ```
//! use needle_core::scene::Scene;
//! use needle_core::twin::{StampedPose, Twin};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::preset("indentation")?;
//! let mut twin = Twin::new(&scene)?;
//! let mut force_n = 0.0;
//! for (time_s, depth_m) in [(0.1, 1e-4), (0.2, 2e-4), (0.3, 3e-4)] {
//!     let pose = StampedPose { time_s, pose: twin.pose_at_depth(depth_m) };
//!     let prediction = twin.step(pose)?;
//!     // the force in frame `sample`: tissue that resists pushes the indenter upwards
//!     force_n = prediction.force_n[2];
//! }
//! // 83 N/m is the stiffness of the finite-element reference near the surface
//! assert!((force_n / (83.0 * 3e-4) - 1.0).abs() < 0.03, "{force_n} N");
//! # Ok(())
//! # }
//! ```
#![allow(non_snake_case)] // the code uses the formula's own symbols: F, P, J
#![forbid(unsafe_code)]

pub mod instrument;
pub mod mesh;
pub mod scene;
pub mod twin;

/// Program and version, as bags and files name their writer.
pub const WRITER: &str = concat!("needle_twin ", env!("CARGO_PKG_VERSION"));
