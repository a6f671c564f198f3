//! Bits of the faces that a node lies on.

/// Node lies on the base, z = 0.
pub const BASE: u8 = 1;
/// Node lies on the top face, z = height.
pub const TOP: u8 = 2;
/// Node lies on the side (of a cylinder, or any of the four of a box).
pub const SIDE: u8 = 0b0011_1100;
/// Node lies on the plane of symmetry of a half body, y = 0.
pub const MIRROR: u8 = 0b1000_0000;
/// In the faces of a node under construction: it lies on the boundary of a region, or between two groups of a mesh.
pub(crate) const INTERFACE: u8 = 64;
