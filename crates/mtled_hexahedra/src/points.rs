//! Integration points of hexahedra: eight of Gauss, or one in the middle, in place of those of the tetrahedra that a hexahedron is cut into.
//!
//! ```text
//! x(xi) = sum_a N_a(xi) X_a,  N_a = (1 + xi_a xi)(1 + eta_a eta)(1 + zeta_a zeta) / 8       w_g = V det(dx/dxi)_g / sum det(dx/dxi)
//! ```
//!
//! at xi, eta, zeta = +-1/sqrt 3, with V the volume of the hexahedron's tetrahedra. With plane faces the sum of the determinants is that
//! volume (they are of second degree along each axis); where a face is warped, its two triangles and not the curved face bound the body, as
//! everywhere else in a cloud. The one point is the centroid, with all of V. A point belongs to the tetrahedron that holds it.

use mtled::approximation::table::{Approximation, tetrahedron};
use mtled::cloud::hexahedron::{Hexahedron, gauss_points, mapped};

type Point = [f64; 3];

/// The approximation with the points of hexahedra in place of those of their tetrahedra; `eight` says of a cell whether its hexahedron has
/// eight points or one. To be called last, as [`Approximation::with_points`].
#[must_use]
pub fn integrated(
    approximation: Approximation,
    points: &[Point],
    cells: &[[u32; 4]],
    hexahedra: &[Hexahedron],
    eight: impl Fn(usize) -> bool,
) -> Approximation {
    let own: Vec<u32> = hexahedra.iter().flat_map(|h| &h.cells).copied().collect();
    approximation.with_points(&own, &held(points, cells, hexahedra, eight))
}

/// Cell that holds it, place (m) and volume (m^3) of each point, by cell.
fn held(
    points: &[Point],
    cells: &[[u32; 4]],
    hexahedra: &[Hexahedron],
    eight: impl Fn(usize) -> bool,
) -> Vec<(u32, Point, f64)> {
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
    held
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

/// Least barycentric coordinate of a place in a tetrahedron.
fn least(x: &[Point; 4], at: Point) -> f64 {
    let slope = tetrahedron(x).1;
    let value = |a: usize| (0..3).map(|k| slope[a][k] * (at[k] - x[(a + 1) % 4][k])).sum::<f64>();
    (0..4).map(value).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mtled::cloud::hexahedron::{CORNERS, cut, is_sound};
    use mtled::cloud::quality::six_volumes;

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
                let found = held(&points, &cells, &hexahedra, |_| eight);
                assert_eq!(found.len(), count);
                let sum: f64 = found.iter().map(|(_, _, weight)| weight).sum();
                assert!((sum / whole - 1.0).abs() < 1e-13, "{sum} of {whole}");
                for (c, at, weight) in &found {
                    assert!(*weight > 0.0);
                    assert!(
                        least(&cells[*c as usize].map(|n| points[n as usize]), *at) > -0.05 * warp - 1e-12,
                        "{at:?}"
                    );
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
        let sum: f64 = held(&points, &cells, &hexahedra, |_| true)
            .iter()
            .map(|(_, [x, y, z], w)| w * (1.0 + x * x * x + x * x * y + x * x + 3.0 * x * x * y * y * z * z))
            .sum();
        assert!((sum - (8.0 + 8.0 / 3.0 + 8.0 / 9.0)).abs() < 1e-12, "{sum}");
    }
}
