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

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPES: [Shape; 6] = [
        Shape::Plate,
        Shape::Table,
        Shape::Punch { radius: 2.0, edge: 0.0 },
        Shape::Punch { radius: 1.5, edge: 0.5 },
        Shape::Shaft { radius: 2.0, slope: [0.4, -0.3] },
        Shape::Ball { radius: 2.0 },
    ];

    /// Points all over the neighbourhood of the shapes.
    fn points() -> impl Iterator<Item = [f64; 3]> {
        let value = |i: usize| ((i.wrapping_mul(2_654_435_761) >> 7) % 10_007) as f64 / 10_007.0 - 0.5;
        (0..2000).map(move |i| std::array::from_fn(|k| 8.0 * value(3 * i + k + 1)))
    }

    #[test]
    fn the_normal_is_the_gradient_of_the_depth_and_leads_out() {
        for shape in SHAPES {
            let mut seen = 0;
            for x in points() {
                let Some(inside) = shape.inside(&x, &x) else { continue };
                seen += 1;
                let length = inside.normal.iter().map(|n| n * n).sum::<f64>();
                assert!((length - 1.0).abs() < 1e-12, "{shape:?} {x:?}");
                let out: [f64; 3] = std::array::from_fn(|k| x[k] + (inside.depth + 1e-9) * inside.normal[k]);
                assert_eq!(shape.inside(&x, &out), None, "{shape:?} {x:?}");
                for k in 0..3 {
                    let at = |h: f64| {
                        let mut y = x;
                        y[k] += h;
                        shape.inside(&x, &y).map_or(0.0, |i| i.depth)
                    };
                    let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
                    let near = inside.depth < 1e-5;
                    assert!(near || (slope + inside.normal[k]).abs() < 1e-6, "{shape:?} {x:?} {k}: {slope}");
                }
            }
            assert!(seen > 50, "{shape:?}: {seen}");
        }
    }

    #[test]
    fn a_shaft_that_stands_upright_is_a_sharp_punch() {
        let (shaft, punch) = (Shape::Shaft { radius: 2.0, slope: [0.0; 2] }, Shape::Punch { radius: 2.0, edge: 0.0 });
        for (from, x) in points().zip(points().skip(7)).filter(|(from, _)| punch.inside(from, from).is_none()) {
            let (a, b) = (shaft.inside(&from, &x), punch.inside(&from, &x));
            assert_eq!(a.is_some(), b.is_some(), "{from:?} {x:?}");
            let (Some(a), Some(b)) = (a, b) else { continue };
            assert!((a.depth - b.depth).abs() < 1e-12, "{from:?} {x:?}: {a:?} {b:?}");
            assert!((0..3).all(|k| (a.normal[k] - b.normal[k]).abs() < 1e-12), "{from:?} {x:?}: {a:?} {b:?}");
        }
    }

    #[test]
    fn a_point_leaves_a_punch_where_it_entered() {
        let punch = Shape::Punch { radius: 2.0, edge: 0.0 };
        let inside = [1.9, 0.0, 0.05];
        let through_the_face = punch.inside(&[1.9, 0.0, -0.01], &inside).map(|i| i.normal);
        let through_the_wall = punch.inside(&[2.0, 0.0, 0.3], &inside).map(|i| i.normal);
        assert_eq!((through_the_face, through_the_wall), (Some(DOWN), Some([1.0, 0.0, 0.0])));
        assert_eq!(punch.inside(&inside, &[2.1, 0.0, 0.1]), None);
        assert_eq!(punch.inside(&inside, &[0.0, 0.0, -0.1]), None);
    }
}
