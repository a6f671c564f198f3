//! Numbers: the kernel's scalar type, and eight of them side by side in one vector register.

mod elementary;
#[allow(unsafe_code)] // vector instructions
pub mod lanes;
#[allow(unsafe_code)] // the same
mod real;

#[allow(unsafe_code)] // the same
pub(crate) mod vector;

pub use lanes::{LANES, Lanes};
pub use real::{Number, Real};
pub use vector::Vector;
