//! Integration points of hexahedra: eight of Gauss, or one in the middle, in place of those of the tetrahedra that a hexahedron is cut into.
//!
//! ```text
//! x(xi) = sum_a N_a(xi) X_a,  N_a = (1 + xi_a xi)(1 + eta_a eta)(1 + zeta_a zeta) / 8       w_g = V det(dx/dxi)_g / sum det(dx/dxi)
//! ```
//!
//! at xi, eta, zeta = +-1/sqrt 3, with V the volume of the hexahedron's tetrahedra. With plane faces the sum of the determinants is that
//! volume (they are of second degree along each axis); where a face is warped, its two triangles and not the curved face bound the body, as
//! everywhere else in a cloud. The one point is the centroid, with all of V. A point belongs to the tetrahedron that holds it.

use super::regions::least_barycentric;
use super::table::tetrahedron;
use crate::cloud::hexahedron::{CORNERS, Hexahedron};
use crate::vector::{Point, cross, dot};

/// Points (m) and volumes (m^3) by the tetrahedron that holds them.
#[derive(Clone, Debug, Default)]
pub(super) struct HexahedronPoints {
    /// Offsets, one more than cells.
    start: Vec<u32>,
    points: Vec<(Point, f64)>,
}

impl HexahedronPoints {
    /// Of the hexahedra among the cells; `eight` says of a cell whether its hexahedron has eight points or one.
    pub(super) fn new(
        points: &[Point],
        cells: &[[u32; 4]],
        hexahedra: &[Hexahedron],
        eight: impl Fn(usize) -> bool,
    ) -> Self {
        let corners = |cell: u32| cells[cell as usize].map(|n| points[n as usize]);
        let mut held: Vec<(u32, Point, f64)> = Vec::new();
        for hexahedron in hexahedra {
            let volume: f64 = hexahedron.cells.iter().map(|&c| tetrahedron(&corners(c)).0).sum();
            let gauss = gauss(&hexahedron.corners.map(|n| points[n as usize]), volume);
            let own = if eight(hexahedron.cells[0] as usize) { gauss.to_vec() } else { vec![centroid(&gauss)] };
            held.extend(own.into_iter().map(|(at, weight)| {
                let inside = |c: &u32| least(&corners(*c), at);
                let holds = hexahedron.cells.iter().copied().max_by(|a, b| inside(a).total_cmp(&inside(b)));
                (holds.unwrap_or_default(), at, weight)
            }));
        }
        held.sort_by_key(|(cell, ..)| *cell);
        let start = (0..=cells.len() as u32).map(|c| held.partition_point(|(cell, ..)| *cell < c) as u32).collect();
        Self { start, points: held.into_iter().map(|(_, at, weight)| (at, weight)).collect() }
    }

    /// Those that a cell holds.
    pub(super) fn of(&self, cell: usize) -> &[(Point, f64)] {
        match self.start.get(cell..cell + 2) {
            Some(&[from, to]) => &self.points[from as usize..to as usize],
            _ => &[],
        }
    }
}

/// Whether a hexahedron's map has a positive determinant at each of its Gauss points: its corners are in order, and it is not folded.
#[must_use]
pub fn is_sound(corners: &[Point; 8]) -> bool {
    gauss_points().all(|xi| mapped(corners, xi).1 > 0.0)
}

fn gauss_points() -> impl Iterator<Item = Point> {
    CORNERS.iter().map(|c| c.map(|s| f64::from(s) / 3.0_f64.sqrt()))
}

/// The eight points, with weights whose sum is the volume.
fn gauss(corners: &[Point; 8], volume: f64) -> [(Point, f64); 8] {
    let mut found = [([0.0; 3], 0.0); 8];
    found.iter_mut().zip(gauss_points()).for_each(|(found, xi)| *found = mapped(corners, xi));
    let sum: f64 = found.iter().map(|(_, determinant)| determinant).sum();
    found.map(|(at, determinant)| (at, volume * determinant / sum))
}

/// The centroid, with the whole volume.
fn centroid(gauss: &[(Point, f64); 8]) -> (Point, f64) {
    let volume: f64 = gauss.iter().map(|(_, weight)| weight).sum();
    (std::array::from_fn(|k| gauss.iter().map(|(at, weight)| weight * at[k]).sum::<f64>() / volume), volume)
}

/// Place and determinant of the map at local coordinates.
fn mapped(corners: &[Point; 8], xi: Point) -> (Point, f64) {
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

/// Least barycentric coordinate of a place in a tetrahedron.
fn least(x: &[Point; 4], at: Point) -> f64 {
    least_barycentric(x, &tetrahedron(x).1, at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::hexahedron::cut;
    use crate::cloud::quality::six_volumes;

    /// A hexahedron with its corners moved by up to `warp` of its half edge, and its tetrahedra turned the right way.
    fn one(warp: f64) -> (Vec<Point>, Vec<[u32; 4]>, Vec<Hexahedron>) {
        let moved = |(k, c): (usize, &[i8; 3])| {
            std::array::from_fn(|i| f64::from(c[i]) + warp * ((3 * k + i) as f64 * 1.7).sin())
        };
        let points: Vec<Point> = CORNERS.iter().enumerate().map(moved).collect();
        let mut cells = cut(&[0, 1, 2, 3, 4, 5, 6, 7]);
        for c in &mut cells {
            if six_volumes(&c.map(|n| points[n as usize])) < 0.0 {
                c.swap(2, 3);
            }
        }
        let hexahedron = Hexahedron { corners: [0, 1, 2, 3, 4, 5, 6, 7], cells: (0..6).collect() };
        (points, cells, vec![hexahedron])
    }

    #[test]
    fn weights_sum_to_the_volume_of_the_tetrahedra_and_each_point_has_the_one_that_holds_it() {
        for warp in [0.0, 0.2] {
            let (points, cells, hexahedra) = one(warp);
            let whole: f64 = cells.iter().map(|c| six_volumes(&c.map(|n| points[n as usize])) / 6.0).sum();
            for (eight, count) in [(true, 8), (false, 1)] {
                let found = HexahedronPoints::new(&points, &cells, &hexahedra, |_| eight);
                let all = || (0..6).flat_map(|c| found.of(c).iter().map(move |p| (c, p)));
                assert_eq!(all().count(), count);
                let sum: f64 = all().map(|(_, (_, weight))| weight).sum();
                assert!((sum / whole - 1.0).abs() < 1e-13, "{sum} of {whole}");
                for (c, (at, weight)) in all() {
                    assert!(*weight > 0.0);
                    assert!(least(&cells[c].map(|n| points[n as usize]), *at) > -0.05 * warp - 1e-12, "{at:?}");
                }
            }
        }
        // plane faces: without the volume given the weights are the same
        let (points, ..) = one(0.0);
        let corners: [Point; 8] = std::array::from_fn(|k| points[k]);
        assert!(gauss(&corners, 8.0).iter().all(|(_, w)| (w - 1.0).abs() < 1e-14));
        assert!(is_sound(&corners));
        let mut folded = corners;
        folded.swap(0, 6);
        assert!(!is_sound(&folded));
    }

    #[test]
    fn polynomials_of_third_degree_are_exact() {
        let (points, cells, hexahedra) = one(0.0);
        let found = HexahedronPoints::new(&points, &cells, &hexahedra, |_| true);
        let sum: f64 = (0..6)
            .flat_map(|c| found.of(c).iter())
            .map(|([x, y, z], w)| w * (1.0 + x * x * x + x * x * y + x * x + 3.0 * x * x * y * y * z * z))
            .sum();
        assert!((sum - (8.0 + 8.0 / 3.0 + 8.0 / 9.0)).abs() < 1e-12, "{sum}");
    }
}
