//! The body: an upright cylinder or box on the plane z = 0, centred on the z axis.

use super::error::CloudError;
use super::vector::{Point, length2};

/// Node lies on the base, z = 0.
pub const BASE: u8 = 1;
/// Node lies on the top face, z = height.
pub const TOP: u8 = 2;
/// Node lies on the side (of a cylinder, or any of the four of a box).
pub const SIDE: u8 = 0b0011_1100;

/// Shape of the body, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain {
    /// Upright cylinder round the z axis, from z = 0 to z = height.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Height.
        height: f64,
    },
    /// Upright box centred on the z axis, from z = 0 to z = size\[2\].
    Box {
        /// Edge lengths along x, y, z.
        size: [f64; 3],
    },
}

impl Domain {
    /// Height in metres.
    pub fn height(&self) -> f64 {
        match *self {
            Domain::Cylinder { height, .. } => height,
            Domain::Box { size } => size[2],
        }
    }

    /// Volume in cubic metres.
    pub fn volume(&self) -> f64 {
        match *self {
            Domain::Cylinder { radius, height } => std::f64::consts::PI * radius * radius * height,
            Domain::Box { size } => size[0] * size[1] * size[2],
        }
    }

    /// Half of the smallest extent: coarser spacing than this cannot represent the body.
    pub fn half_thickness(&self) -> f64 {
        match *self {
            Domain::Cylinder { radius, height } => radius.min(0.5 * height),
            Domain::Box { size } => 0.5 * size[0].min(size[1]).min(size[2]),
        }
    }

    /// Distance from a point of the top face to its rim (negative outside).
    pub(crate) fn rim_distance(&self, centre: [f64; 2]) -> f64 {
        match *self {
            Domain::Cylinder { radius, .. } => radius - length2(centre[0], centre[1]),
            Domain::Box { size } => (0.5 * size[0] - centre[0].abs()).min(0.5 * size[1] - centre[1].abs()),
        }
    }

    /// Smallest and largest corner.
    pub(crate) fn bounds(&self) -> (Point, Point) {
        match *self {
            Domain::Cylinder { radius, height } => ([-radius, -radius, 0.0], [radius, radius, height]),
            Domain::Box { size } => ([-0.5 * size[0], -0.5 * size[1], 0.0], [0.5 * size[0], 0.5 * size[1], size[2]]),
        }
    }

    /// Depth of a point under the nearest face (negative outside).
    pub(crate) fn depth(&self, p: Point) -> f64 {
        let z = p[2].min(self.height() - p[2]);
        self.rim_distance([p[0], p[1]]).min(z)
    }

    /// Bits of all faces that the body has.
    pub(crate) fn faces(&self) -> &'static [u8] {
        match self {
            Domain::Cylinder { .. } => &[1, 2, 4],
            Domain::Box { .. } => &[1, 2, 4, 8, 16, 32],
        }
    }

    /// Are all faces plane whose bits are set?
    pub(crate) fn is_plane(&self, face: u8) -> bool {
        matches!(self, Domain::Box { .. }) || face & SIDE == 0
    }

    /// Puts a point onto the face with this bit.
    pub(crate) fn project(&self, face: u8, mut p: Point) -> Point {
        match (*self, face) {
            (_, BASE) => p[2] = 0.0,
            (_, TOP) => p[2] = self.height(),
            (Domain::Cylinder { radius, .. }, _) => {
                let s = radius / length2(p[0], p[1]);
                p[0] *= s;
                p[1] *= s;
            }
            (Domain::Box { size }, 4) => p[0] = -0.5 * size[0],
            (Domain::Box { size }, 8) => p[0] = 0.5 * size[0],
            (Domain::Box { size }, 16) => p[1] = -0.5 * size[1],
            (Domain::Box { size }, _) => p[1] = 0.5 * size[1],
        }
        p
    }

    /// Distance, within the face, from a point of the face to the face's edge (negative outside).
    pub(crate) fn edge_distance(&self, face: u8, p: Point) -> f64 {
        let z = p[2].min(self.height() - p[2]);
        match (*self, face) {
            (_, BASE | TOP) => self.rim_distance([p[0], p[1]]),
            (Domain::Cylinder { .. }, _) => z,
            (Domain::Box { size }, 4 | 8) => z.min(0.5 * size[1] - p[1].abs()),
            (Domain::Box { size }, _) => z.min(0.5 * size[0] - p[0].abs()),
        }
    }

    /// Two orthonormal tangents of a face at a point of it.
    pub(crate) fn tangents(&self, face: u8, p: Point) -> [Point; 2] {
        match (*self, face) {
            (_, BASE | TOP) => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            (Domain::Cylinder { radius, .. }, _) => [[-p[1] / radius, p[0] / radius, 0.0], [0.0, 0.0, 1.0]],
            (Domain::Box { .. }, 4 | 8) => [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            (Domain::Box { .. }, _) => [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        }
    }

    /// # Errors
    /// A length that is not positive and finite.
    pub(crate) fn validate(&self) -> Result<(), CloudError> {
        let lengths: Vec<(&'static str, f64)> = match *self {
            Domain::Cylinder { radius, height } => vec![("sample radius", radius), ("sample height", height)],
            Domain::Box { size } => {
                vec![("sample size along x", size[0]), ("sample size along y", size[1]), ("sample height", size[2])]
            }
        };
        for (key, value) in lengths {
            if !(value.is_finite() && value > 0.0) {
                return Err(CloudError::OutOfRange { key, value, rule: "give a positive length in metres".into() });
            }
        }
        Ok(())
    }
}
