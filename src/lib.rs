//! Digital twin of a needle-insertion test rig.
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
//!                                                                               │
//!            bag, ros, rig, guard, compare, study, report   ◄──────────────────┘   the outer ring
//! ```
//!
//! The inner ring (`scene` to `twin`) is numbers only: no files, sockets or clocks. The outer ring is
//! input and output round the same [`twin::Twin`].
#![allow(non_snake_case)] // the code uses the formula's own symbols: F, P, J
#![forbid(unsafe_code)]

pub mod cli;
pub mod compare;
pub mod guard;
pub mod input;
pub mod instrument;
pub mod mesh;
pub mod report;
pub mod rig;
pub mod ros;
pub mod scene;
pub mod study;
pub mod twin;
