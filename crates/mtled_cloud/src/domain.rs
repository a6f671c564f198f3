//! The body: an upright cylinder or box on the plane z = 0, centred on the z axis, or the half of one with y >= 0.

use crate::error::CloudError;
use crate::faces::{BASE, MIRROR, SIDE, TOP};
use crate::outline::Outline;
use crate::path::Axis;
use crate::vector::{Point, length2, tangents};

/// Shape of the body, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain<'a> {
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
    /// The half of such a cylinder with y >= 0.
    HalfCylinder {
        /// Radius.
        radius: f64,
        /// Height.
        height: f64,
    },
    /// The half of such a box with y >= 0.
    HalfBox {
        /// Edge lengths of the whole box along x, y, z.
        size: [f64; 3],
    },
    /// What a mesh outlines, standing on z = 0.
    Outline(&'a Outline),
}

impl<'a> Domain<'a> {
    /// The half of this body with y >= 0.
    #[must_use]
    pub const fn half(self) -> Self {
        match self {
            Self::Cylinder { radius, height } => Self::HalfCylinder { radius, height },
            Self::Box { size } => Self::HalfBox { size },
            half => half,
        }
    }

    /// Is it a half?
    #[must_use]
    pub const fn is_half(&self) -> bool {
        matches!(self, Self::HalfCylinder { .. } | Self::HalfBox { .. })
    }

    /// The body that this is a half of, or this one.
    #[must_use]
    pub const fn whole(self) -> Self {
        match self {
            Self::HalfCylinder { radius, height } => Self::Cylinder { radius, height },
            Self::HalfBox { size } => Self::Box { size },
            whole => whole,
        }
    }

    /// The outline, if a mesh gives it.
    pub(crate) const fn outline(&self) -> Option<&'a Outline> {
        match self {
            Self::Outline(outline) => Some(*outline),
            _ => None,
        }
    }

    /// Length of an axis from the top face to the base, m.
    pub fn length_along(&self, axis: &Axis) -> f64 {
        match self {
            Self::Outline(outline) => outline.length_along(axis),
            _ => self.height() * axis.secant(),
        }
    }

    /// Height in metres; of what a mesh outlines that of the place where an instrument meets it.
    pub fn height(&self) -> f64 {
        match *self {
            Domain::Cylinder { height, .. } | Domain::HalfCylinder { height, .. } => height,
            Domain::Box { size } | Domain::HalfBox { size } => size[2],
            Domain::Outline(outline) => outline.top,
        }
    }

    /// Volume in cubic metres.
    pub fn volume(&self) -> f64 {
        match *self {
            Domain::Cylinder { radius, height } => std::f64::consts::PI * radius * radius * height,
            Domain::Box { size } => size[0] * size[1] * size[2],
            Domain::Outline(outline) => outline.volume,
            half => 0.5 * half.whole().volume(),
        }
    }

    /// Half of the whole body's smallest extent: coarser spacing than this cannot represent the body.
    pub fn half_thickness(&self) -> f64 {
        match *self {
            Domain::Cylinder { radius, height } | Domain::HalfCylinder { radius, height } => radius.min(0.5 * height),
            Domain::Box { size } | Domain::HalfBox { size } => 0.5 * size[0].min(size[1]).min(size[2]),
            Domain::Outline(outline) => {
                let (low, high) = outline.bounds;
                0.5 * [0, 1, 2].map(|k| high[k] - low[k]).into_iter().fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// Distance from a point of the top face to the whole body's rim (negative outside); infinite for an outline, which has none.
    pub(crate) fn rim_distance(&self, centre: [f64; 2]) -> f64 {
        match *self {
            Domain::Cylinder { radius, .. } | Domain::HalfCylinder { radius, .. } => {
                radius - length2(centre[0], centre[1])
            }
            Domain::Box { size } | Domain::HalfBox { size } => {
                (0.5 * size[0] - centre[0].abs()).min(0.5 * size[1] - centre[1].abs())
            }
            Domain::Outline(_) => f64::INFINITY,
        }
    }

    /// Distance from the plane of symmetry (negative on the other side); infinite for a whole body.
    fn mirror_distance(&self, p: Point) -> f64 {
        if self.is_half() { p[1] } else { f64::INFINITY }
    }

    /// Smallest and largest corner.
    pub fn bounds(&self) -> (Point, Point) {
        match *self {
            Domain::Cylinder { radius, height } => ([-radius, -radius, 0.0], [radius, radius, height]),
            Domain::Box { size } => ([-0.5 * size[0], -0.5 * size[1], 0.0], [0.5 * size[0], 0.5 * size[1], size[2]]),
            Domain::Outline(outline) => outline.bounds,
            half => {
                let ([x, _, z], high) = half.whole().bounds();
                ([x, 0.0, z], high)
            }
        }
    }

    /// Depth of a point under the nearest face (negative outside); of an outline under the nearest interface, too.
    pub(crate) fn depth(&self, p: Point) -> f64 {
        self.depth_to(p, f64::INFINITY)
    }

    /// The same where it is less than `reach`, which is all that most ask for: of an outline it is dear.
    pub(crate) fn depth_to(&self, p: Point, reach: f64) -> f64 {
        if let Domain::Outline(outline) = self {
            return outline.room(p, reach);
        }
        let z = p[2].min(self.height() - p[2]);
        self.rim_distance([p[0], p[1]]).min(z).min(self.mirror_distance(p))
    }

    pub(crate) fn is_inside(&self, p: Point) -> bool {
        match self {
            Domain::Outline(outline) => outline.cell_at(p).is_some(),
            _ => self.depth(p) > 0.0,
        }
    }

    /// Whether a point lies in the body or on its surface.
    pub(crate) fn holds(&self, p: Point) -> bool {
        match self {
            Domain::Outline(outline) => outline.cell_at(p).is_some(),
            _ => self.depth(p) >= -1e-9 * self.height(),
        }
    }

    /// Bits of all faces that the body has.
    pub(crate) fn faces(&self) -> &'static [u8] {
        match self {
            Domain::Cylinder { .. } => &[1, 2, 4],
            Domain::Box { .. } => &[1, 2, 4, 8, 16, 32],
            Domain::HalfCylinder { .. } => &[1, 2, 4, MIRROR],
            Domain::HalfBox { .. } => &[1, 2, 4, 8, 32, MIRROR],
            // these are filled by themselves
            Domain::Outline(_) => &[],
        }
    }

    /// Are all faces plane whose bits are set?
    pub(crate) fn is_plane(&self, face: u8) -> bool {
        match self {
            Domain::Box { .. } | Domain::HalfBox { .. } => true,
            Domain::Cylinder { .. } | Domain::HalfCylinder { .. } => face & SIDE == 0,
            // its cells are carved
            Domain::Outline(_) => true,
        }
    }

    /// Puts a point onto the face with this bit.
    pub(crate) fn project(&self, face: u8, mut p: Point) -> Point {
        if let Domain::Outline(outline) = self {
            return outline.on(face, p).map_or(p, |(q, _)| q);
        }
        match (self.whole(), face) {
            (_, MIRROR) => p[1] = 0.0,
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
            // the whole of a body is no half
            (Domain::HalfCylinder { .. } | Domain::HalfBox { .. } | Domain::Outline(_), _) => {}
        }
        p
    }

    /// Distance, within the face, from a point of the face to the face's edge (negative outside).
    pub(crate) fn edge_distance(&self, face: u8, p: Point) -> f64 {
        if matches!(self, Domain::Outline(_)) {
            // nodes on creases keep others away
            return f64::INFINITY;
        }
        let z = p[2].min(self.height() - p[2]);
        let beside = match (*self, face) {
            (_, MIRROR) => return z.min(self.rim_distance([p[0], 0.0])),
            (_, BASE | TOP) => self.rim_distance([p[0], p[1]]),
            (Domain::Cylinder { .. } | Domain::HalfCylinder { .. }, _) => z,
            (Domain::Box { size } | Domain::HalfBox { size }, 4 | 8) => z.min(0.5 * size[1] - p[1].abs()),
            (Domain::Box { size } | Domain::HalfBox { size }, _) => z.min(0.5 * size[0] - p[0].abs()),
            (Domain::Outline(_), _) => return f64::INFINITY,
        };
        if face == 32 { beside } else { beside.min(self.mirror_distance(p)) }
    }

    /// Two orthonormal tangents of a face at a point of it.
    pub(crate) fn tangents(&self, face: u8, p: Point) -> [Point; 2] {
        match (*self, face) {
            (Domain::Outline(outline), _) => {
                outline.on(face, p).map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], |(_, n)| tangents(n))
            }
            (_, BASE | TOP) => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            (_, MIRROR) => [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            (Domain::Cylinder { radius, .. } | Domain::HalfCylinder { radius, .. }, _) => {
                [[-p[1] / radius, p[0] / radius, 0.0], [0.0, 0.0, 1.0]]
            }
            (Domain::Box { .. } | Domain::HalfBox { .. }, 4 | 8) => [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            (Domain::Box { .. } | Domain::HalfBox { .. }, _) => [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        }
    }

    /// Checks the lengths.
    ///
    /// # Errors
    /// A length that is not positive and finite.
    pub fn validate(&self) -> Result<(), CloudError> {
        let lengths: Vec<(&'static str, f64)> = match *self {
            Domain::Cylinder { radius, height } | Domain::HalfCylinder { radius, height } => {
                vec![("sample radius", radius), ("sample height", height)]
            }
            Domain::Box { size } | Domain::HalfBox { size } => {
                vec![("sample size along x", size[0]), ("sample size along y", size[1]), ("sample height", size[2])]
            }
            Domain::Outline(outline) => vec![("sample height", outline.top), ("sample volume", outline.volume)],
        };
        for (key, value) in lengths {
            if !(value.is_finite() && value > 0.0) {
                return Err(CloudError::OutOfRange { key, value, rule: "give a positive length in metres".into() });
            }
        }
        Ok(())
    }
}
