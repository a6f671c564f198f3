//! Numbers: the kernel's scalar type, and eight of them side by side in one vector register.

pub mod lanes;
pub mod real;

pub use lanes::{LANES, Lanes};
pub use real::{Number, Real};
