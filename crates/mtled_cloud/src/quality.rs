//! Shape of a tetrahedral cell.

use crate::vector::{Point, cross, dot, norm, sub};

/// Six times the volume; positive if d lies on the side of a, b, c from which they run counter-clockwise.
#[inline]
pub fn six_volumes(p: &[Point; 4]) -> f64 {
    dot(sub(p[1], p[0]), cross(sub(p[2], p[0]), sub(p[3], p[0])))
}

/// Volume-length ratio 6√2 V / l_rms³ (Parthasarathy, Graichen, Hathaway 1994): 1 for the regular tetrahedron,
/// 0 when flat, negative when inverted.
#[inline]
pub fn volume_length(p: &[Point; 4]) -> f64 {
    let edges = [sub(p[1], p[0]), sub(p[2], p[0]), sub(p[3], p[0]), sub(p[2], p[1]), sub(p[3], p[1]), sub(p[3], p[2])];
    let square = edges.iter().map(|&e| dot(e, e)).sum::<f64>() / 6.0;
    std::f64::consts::SQRT_2 * dot(edges[0], cross(edges[1], edges[2])) / (square * square.sqrt())
}

/// Smallest and largest dihedral angle in degrees.
pub(super) fn dihedral_range(p: &[Point; 4]) -> (f64, f64) {
    let normal = |a: usize, b: usize, c: usize| {
        let n = cross(sub(p[b], p[a]), sub(p[c], p[a]));
        let l = norm(n).max(f64::MIN_POSITIVE);
        [n[0] / l, n[1] / l, n[2] / l]
    };
    // Outward normals of a positive cell.
    let n = [normal(1, 2, 3), normal(0, 3, 2), normal(0, 1, 3), normal(0, 2, 1)];
    let (mut low, mut high) = (180.0f64, 0.0f64);
    for i in 0..4 {
        for j in i + 1..4 {
            let angle = 180.0 - dot(n[i], n[j]).clamp(-1.0, 1.0).acos().to_degrees();
            low = low.min(angle);
            high = high.max(angle);
        }
    }
    (low, high)
}

/// Shape of all cells of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Lowest volume-length ratio (1 is the regular tetrahedron).
    pub lowest: f64,
    /// Mean volume-length ratio.
    pub mean: f64,
    /// Smallest dihedral angle in degrees.
    pub smallest_angle: f64,
    /// Largest dihedral angle in degrees.
    pub largest_angle: f64,
    /// Number of cells by volume-length ratio, in tenths from 0 to 1.
    pub histogram: [usize; 10],
}

impl Summary {
    /// Measures all cells.
    pub fn of(points: &[[f64; 3]], cells: &[[u32; 4]]) -> Self {
        let mut s = Self { lowest: 1.0, mean: 0.0, smallest_angle: 180.0, largest_angle: 0.0, histogram: [0; 10] };
        for c in cells {
            let p = c.map(|v| points[v as usize]);
            let q = volume_length(&p);
            let (low, high) = dihedral_range(&p);
            s.lowest = s.lowest.min(q);
            s.mean += q;
            s.smallest_angle = s.smallest_angle.min(low);
            s.largest_angle = s.largest_angle.max(high);
            s.histogram[((10.0 * q) as usize).min(9)] += 1;
        }
        s.mean /= cells.len().max(1) as f64;
        s
    }
}
