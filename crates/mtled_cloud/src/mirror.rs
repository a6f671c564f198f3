//! A vertical plane about which a body and all that happens to it are symmetric: a model holds the half with n.x >= 0.

/// Distance over the size of the body below which a point lies on the plane.
const ON: f64 = 1e-9;

/// A plane through the z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    /// n, horizontal unit vector.
    normal: [f64; 3],
}

impl Mirror {
    /// The plane that holds the z axis and a horizontal direction, a unit vector (x, y); n is that direction turned left.
    #[must_use]
    pub const fn along([x, y]: [f64; 2]) -> Self {
        Self { normal: [-y, x, 0.0] }
    }

    /// The horizontal unit vector (x, y) within the plane.
    #[must_use]
    pub const fn direction(&self) -> [f64; 2] {
        [self.normal[1], -self.normal[0]]
    }

    /// n . v: distance from the plane, in the unit of v.
    #[inline]
    #[must_use]
    pub fn across(&self, v: &[f64; 3]) -> f64 {
        self.normal[0] * v[0] + self.normal[1] * v[1] + self.normal[2] * v[2]
    }

    /// v - 2 (n . v) n, the mirrored vector or place.
    #[inline]
    #[must_use]
    pub fn image(&self, v: &[f64; 3]) -> [f64; 3] {
        let twice = 2.0 * self.across(v);
        std::array::from_fn(|k| v[k] - twice * self.normal[k])
    }

    /// v - (n . v) n, the part within the plane.
    #[inline]
    #[must_use]
    pub fn within(&self, v: &[f64; 3]) -> [f64; 3] {
        let across = self.across(v);
        std::array::from_fn(|k| v[k] - across * self.normal[k])
    }

    /// A place of the frame whose x lies along [`Mirror::direction`] and whose y is n, in the frame of the body.
    #[must_use]
    pub fn from_own_frame(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [c, s] = self.direction();
        [c * x - s * y, s * x + c * y, z]
    }

    /// The other way.
    #[must_use]
    pub fn to_own_frame(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [c, s] = self.direction();
        [c * x + s * y, c * y - s * x, z]
    }

    /// Which of a body's points lie on the plane.
    #[must_use]
    pub fn holds(&self, points: &[[f64; 3]]) -> Vec<bool> {
        let size = points.iter().flatten().fold(0.0_f64, |size, x| size.max(x.abs()));
        points.iter().map(|p| self.across(p).abs() <= ON * size).collect()
    }
}
