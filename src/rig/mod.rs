//! The simulated rig.

pub mod sensors;
