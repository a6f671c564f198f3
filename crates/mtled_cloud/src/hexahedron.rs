//! Hexahedra among the background cells, and how hexahedra, wedges and pyramids are cut into tetrahedra.
//!
//! Nodes, supports, surface and projection know tetrahedra alone. The crate `mtled_hexahedra` integrates a hexahedron's tetrahedra together.
//! The cut is the cone of the corner with the lowest number over the faces that it is not on, and each quadrangle
//! is cut through its lowest corner, so cells that share a face cut it in the same way (Dompierre, Labbé, Vallet, Camarero 1999).

use crate::vector::{Point, cross, dot};

/// A hexahedron, and the tetrahedra among a cloud's cells that it is cut into.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hexahedron {
    /// Corners: those of one face in turn, then those opposite to them.
    pub corners: [u32; 8],
    /// Its tetrahedra, five or six, by their places among the cells.
    pub cells: Vec<u32>,
}

/// Local coordinates of a hexahedron's corners, over 1: each is -1 or 1.
pub const CORNERS: [[i8; 3]; 8] =
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]];

/// Faces by places among the corners, counter-clockwise seen from outside.
const HEXAHEDRON: [&[usize]; 6] =
    [&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];
const WEDGE: [&[usize]; 5] = [&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]];
const PYRAMID: [&[usize]; 5] = [&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];

/// The tetrahedra of a hexahedron (8 corners), a wedge (6), a pyramid (5) or a tetrahedron (4), of positive volume where the
/// second face of a hexahedron or wedge, or the tip, lies beyond its first; none of anything else.
#[must_use]
pub fn cut(corners: &[u32]) -> Vec<[u32; 4]> {
    let faces: &[&[usize]] = match *corners {
        [a, b, c, d] => return vec![[a, b, c, d]],
        [_, _, _, _, _] => &PYRAMID,
        [_, _, _, _, _, _] => &WEDGE,
        [_, _, _, _, _, _, _, _] => &HEXAHEDRON,
        _ => &[],
    };
    let lowest = |of: &[usize]| of.iter().copied().min_by_key(|&k| corners[k]).unwrap_or_default();
    let apex = (0..corners.len()).min_by_key(|&k| corners[k]).unwrap_or_default();
    let mut cells = Vec::with_capacity(6);
    for face in faces.iter().filter(|face| !face.contains(&apex)) {
        let first = lowest(face);
        let start = face.iter().position(|&k| k == first).unwrap_or_default();
        let turned: Vec<u32> = (0..face.len()).map(|k| corners[face[(start + k) % face.len()]]).collect();
        cells.extend(turned[1..].windows(2).map(|edge| [corners[apex], turned[0], edge[0], edge[1]]));
    }
    cells
}

/// Whether a hexahedron's map has a positive determinant at each of its Gauss points: its corners are in order, and it is not folded.
#[must_use]
pub fn is_sound(corners: &[Point; 8]) -> bool {
    gauss_points().all(|xi| mapped(corners, xi).1 > 0.0)
}

/// Local coordinates of the eight Gauss points: each is -1/sqrt 3 or 1/sqrt 3.
pub fn gauss_points() -> impl Iterator<Item = Point> {
    CORNERS.iter().map(|c| c.map(|s| f64::from(s) / 3.0_f64.sqrt()))
}

/// Place and determinant of the map at local coordinates.
#[must_use]
pub fn mapped(corners: &[Point; 8], xi: Point) -> (Point, f64) {
    let (mut at, mut slope) = ([0.0; 3], [[0.0; 3]; 3]);
    for (x, corner) in corners.iter().zip(&CORNERS) {
        let sign = corner.map(f64::from);
        let factor: Point = std::array::from_fn(|k| 1.0 + sign[k] * xi[k]);
        for i in 0..3 {
            at[i] += 0.125 * factor[0] * factor[1] * factor[2] * x[i];
            (0..3).for_each(|k| slope[k][i] += 0.125 * sign[k] * factor[(k + 1) % 3] * factor[(k + 2) % 3] * x[i]);
        }
    }
    (at, dot(slope[0], cross(slope[1], slope[2])))
}
