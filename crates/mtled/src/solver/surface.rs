//! Rigid surfaces by their signed distance: what free tissue must not pass.
//!
//! A shape stands at the origin and opens upwards, along +z; the tissue is outside. Distances in m, positive outside. In a half
//! plane x is the radius and y is zero, so the same formulas hold for a shape on the axis.
//!
//! ```text
//! plate      phi = -z                                             above the plane z = 0
//! table      phi = z                                              below it
//! punch      phi = |(max(a, 0), max(b, 0))| - e                   flat end at z = 0 to R, round edge, wall at r = R + e
//!            a = r - R, b = e - z
//! shaft      phi = max(a, b)                                      sharp flat end at z = 0, wall at the distance R from a tilted axis
//!            a = |x - (x.t) t| - R, b = -z, t = (-s, 1) / |(-s, 1)|
//! ball       phi = |x - c| - R,  c = (0, 0, max(z, R))            lowest point at z = 0, cylinder above the half ball
//! ```

/// A rigid shape, its lowest (a table's highest) point at the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Everything above a horizontal plane.
    Plate,
    /// Everything below a horizontal plane.
    Table,
    /// Upright cylinder with a flat lower end.
    Punch {
        /// R, m.
        radius: f64,
        /// e, radius of the edge, m; 0 for a sharp one. Nodes slide round an edge as round as they are apart without a jump of the
        /// force; off a sharp one each falls at once.
        edge: f64,
    },
    /// Oblique cylinder, cut flat at its lower end.
    Shaft {
        /// R across the axis, m.
        radius: f64,
        /// s, lateral way of the axis per metre downward.
        slope: [f64; 2],
    },
    /// Upright cylinder that ends below in a half ball.
    Ball {
        /// R, m.
        radius: f64,
    },
}

/// A point inside a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inside {
    /// How far, m: greater than 0.
    pub depth: f64,
    /// Unit vector along which the point comes out on the shortest way.
    pub normal: [f64; 3],
}

const DOWN: [f64; 3] = [0.0, 0.0, -1.0];
const UP: [f64; 3] = [0.0, 0.0, 1.0];

impl Shape {
    /// Where `x` is inside, if it is; `from` is where the point was before, outside. A point that enters a punch near its edge comes
    /// out by the face or the wall that it came through, not by the nearer one: so no point is carried round the edge.
    #[must_use]
    pub fn inside(&self, from: &[f64; 3], x: &[f64; 3]) -> Option<Inside> {
        let (phi, normal) = match *self {
            Self::Plate => (-x[2], DOWN),
            Self::Table => (x[2], UP),
            Self::Punch { radius, edge } => {
                let beside = |p: &[f64; 3]| p[0].hypot(p[1]) - radius;
                let (a, b) = (beside(x), edge - x[2]);
                match (a > 0.0, b > 0.0) {
                    (true, true) => (a.hypot(b) - edge, tilted(x, a, b)),
                    (true, false) => (a - edge, outward(x, 0.0)),
                    (false, true) => (b - edge, DOWN),
                    // deeper than the edge is round
                    (false, false) if edge - from[2] >= beside(from) => (b - edge, DOWN),
                    (false, false) => (a - edge, outward(x, 0.0)),
                }
            }
            Self::Shaft { radius, slope } => {
                let across = |p: &[f64; 3]| across(p, slope);
                let beside = |p: &[f64; 3]| length(&across(p)) - radius;
                if -x[2] >= 0.0 || -from[2] >= beside(from) {
                    // beside the end there is nothing under it
                    (if beside(x) < 0.0 { -x[2] } else { 0.0 }, DOWN)
                } else {
                    let (way, a) = (across(x), beside(x));
                    (a, way.map(|w| w / (a + radius)))
                }
            }
            Self::Ball { radius } => {
                let height = x[2].max(radius);
                let distance = (x[2] - height).hypot(x[0]).hypot(x[1]);
                (distance - radius, outward(x, x[2] - height))
            }
        };
        (phi < 0.0).then_some(Inside { depth: -phi, normal })
    }
}

/// Unit vector along (x, y, z) with x and y of a point; down where they all are zero.
fn outward(p: &[f64; 3], z: f64) -> [f64; 3] {
    let length = p[0].hypot(p[1]).hypot(z);
    if length > 0.0 { [p[0] / length, p[1] / length, z / length] } else { DOWN }
}

/// From the axis of slope `s` through the origin to a point, on the shortest way.
fn across(p: &[f64; 3], s: [f64; 2]) -> [f64; 3] {
    let t = [-s[0], -s[1], 1.0];
    let along = (p[2] - s[0] * p[0] - s[1] * p[1]) / (1.0 + s[0] * s[0] + s[1] * s[1]);
    std::array::from_fn(|k| p[k] - along * t[k])
}

fn length(v: &[f64; 3]) -> f64 {
    v[0].hypot(v[1]).hypot(v[2])
}

/// Unit vector of `a` parts outward from the axis and `b` downward.
fn tilted(p: &[f64; 3], a: f64, b: f64) -> [f64; 3] {
    let (r, length) = (p[0].hypot(p[1]), a.hypot(b));
    [a * p[0] / (r * length), a * p[1] / (r * length), -b / length]
}
