//! Hexahedra for `mtled`, for comparison with its tetrahedra: clouds of hexahedra, and their integration points.
//!
//! - [`structured`]: a whole cylinder or box as a grid of hexahedra.
//! - [`with_bricks`]: any body, with hexahedra inside and tetrahedra around them.
//! - [`integrated`]: an approximation whose hexahedra have eight Gauss points each, or one.
//!
//! Tetrahedra have the smaller force error for their cost, so nothing that is shipped by default uses this crate.
#![warn(unreachable_pub)]

mod bricks;
mod points;
mod structured;

pub use bricks::with_bricks;
pub use points::integrated;
pub use structured::structured;
