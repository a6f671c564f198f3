//! Vectors and places in space as plain arrays.

/// A vector, or a place in m.
pub type Point = [f64; 3];

#[inline(always)]
pub(crate) fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a - b.
#[inline(always)]
#[must_use]
pub fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// s a.
#[inline(always)]
#[must_use]
pub fn scale(a: Point, s: f64) -> Point {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// a . b.
#[inline(always)]
#[must_use]
pub fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a x b.
#[inline(always)]
#[must_use]
pub fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// |a|.
#[inline]
pub(crate) fn norm(a: Point) -> f64 {
    dot(a, a).sqrt()
}

/// a + t (b - a). Where both ends have the same digits, so has all between: a node is on an edge exactly or not at all.
#[inline]
pub(crate) fn between(a: Point, b: Point, t: f64) -> Point {
    [0, 1, 2].map(|k| if a[k] == b[k] { a[k] } else { a[k] + t * (b[k] - a[k]) })
}

/// Lowest and highest coordinates of all points.
#[must_use]
pub fn bounds(points: &[Point]) -> [Point; 2] {
    let all = |k: usize, pick: fn(f64, f64) -> f64, start: f64| points.iter().map(|p| p[k]).fold(start, pick);
    [[0, 1, 2].map(|k| all(k, f64::min, f64::INFINITY)), [0, 1, 2].map(|k| all(k, f64::max, f64::NEG_INFINITY))]
}

/// √(x² + y²); lengths of a body are far from overflow, and `hypot` is slow.
#[inline]
pub(crate) fn length2(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// |a - b|.
#[inline]
#[must_use]
pub fn distance(a: Point, b: Point) -> f64 {
    norm(sub(a, b))
}

/// A fixed hash of (i, salt) to [0, 1): the generator's only "chance", the same on every machine.
#[inline]
pub(crate) fn hash01(i: u64, salt: u64) -> f64 {
    let mut z = i.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(salt.wrapping_mul(0xD1B5_4A32_D192_ED03))
        ^ 0x5851_F42D_4C95_7F2D;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Two unit vectors across a unit vector.
pub(crate) fn tangents(n: Point) -> [Point; 2] {
    let least = (0..3).fold(0, |best, k| if n[k].abs() < n[best].abs() { k } else { best });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let across = sub(axis, scale(n, n[least]));
    let first = scale(across, 1.0 / norm(across));
    [first, cross(n, first)]
}
