//! Integration points of the triangles of a half plane.

/// Barycentric place and weight of an integration point.
pub(super) type Gauss = ([f64; 3], f64);

pub(super) const CENTRE: [Gauss; 1] = [([1.0 / 3.0; 3], 1.0)];

/// Barycentric points and weights of a triangle: 3 of degree 2, 6 of degree 4 (Dunavant 1985) or 7 of degree 5 (Radon
/// 1948), where a tetrahedron has 1, 4 or 5. So there are as many points per node as in space, where a node has 5.5
/// cells and not 2: with a single point per triangle an indentation loses 12% of its force past 4 mm. Triangles at the axis
/// get six at least: their rings weigh next to nothing, so with three the nodes on the axis wobble by 1.3% of the depth.
pub(super) fn gauss_points(n: u32) -> Vec<Gauss> {
    let vertex = |a: f64, weight: f64| {
        (0..3).map(move |i| (std::array::from_fn(|k| if k == i { a } else { 0.5 * (1.0 - a) }), weight))
    };
    let root = 15f64.sqrt();
    match n {
        4 => vertex(0.816_847_572_980_459, 0.109_951_743_655_322)
            .chain(vertex(0.108_103_018_168_070, 0.223_381_589_678_011))
            .collect(),
        5 => std::iter::once(([1.0 / 3.0; 3], 0.225))
            .chain(vertex((9.0 + 2.0 * root) / 21.0, (155.0 - root) / 1200.0))
            .chain(vertex((9.0 - 2.0 * root) / 21.0, (155.0 + root) / 1200.0))
            .collect(),
        _ => vertex(2.0 / 3.0, 1.0 / 3.0).collect(),
    }
}

/// Two by two points on lines from a corner `apex` of a triangle at the axis: of degree 3 with the radius as weight, which the points'
/// volumes have as a factor (Stroud, Approximate Calculation of Multiple Integrals, 1971, section 2.4). `one`: the apex is the only
/// corner on the axis; otherwise it is the only one off it. s, the share of the way from the apex, by the Gauss-Jacobi points for s^2 or
/// s (1 - s).
pub(super) fn conical(apex: usize, one: bool) -> Vec<Gauss> {
    let along = if one {
        let half = 0.1f64.sqrt() / 1.5;
        [-half, half].map(|x| (2.0 / 3.0 + x, (1.0 / 6.0 + x / (72.0 * half * half)) / (2.0 / 3.0 + x)))
    } else {
        let half = 0.2f64.sqrt() / 2.0;
        [-half, half].map(|x| (0.5 + x, 1.0 / 12.0 / (0.5 - x)))
    };
    let across = [0.5 - 0.5 / 3f64.sqrt(), 0.5 + 0.5 / 3f64.sqrt()];
    let point = |(s, weight): (f64, f64), t: f64| {
        let mut at = [0.0; 3];
        (at[apex], at[(apex + 1) % 3], at[(apex + 2) % 3]) = (1.0 - s, s * (1.0 - t), s * t);
        (at, weight)
    };
    along.into_iter().flat_map(|a| across.map(|t| point(a, t))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integral of L1^a L2^b over a triangle of unit area is 2 a! b! / (a + b + 2)!.
    #[test]
    fn points_integrate_polynomials_of_their_degree() {
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        for (rule, degree) in [(1, 2), (4, 4), (5, 5)] {
            for a in 0..=degree {
                for b in 0..=degree - a {
                    let sum: f64 = gauss_points(rule).iter().map(|(l, w)| w * l[0].powi(a) * l[1].powi(b)).sum();
                    let exact = 2.0 * factorial(a) * factorial(b) / factorial(a + b + 2);
                    assert!((sum - exact).abs() < 1e-12, "rule {rule}: {a} {b}: {sum} {exact}");
                }
            }
        }
        // times a radius that is zero at the apex and 1 at both other corners, or the other way round
        for (apex, a, b) in (0..3).flat_map(|apex| (0..4).flat_map(move |a| (0..4 - a).map(move |b| (apex, a, b)))) {
            let [i, j] = [(apex + 1) % 3, (apex + 2) % 3];
            let integral =
                |p: i32, q: i32, r: i32| 2.0 * factorial(p) * factorial(q) * factorial(r) / factorial(p + q + r + 2);
            for one in [true, false] {
                let radius = |l: &[f64; 3]| if one { l[i] + l[j] } else { l[apex] };
                let term = |(l, w): &Gauss| w * radius(l) * l[i].powi(a) * l[apex].powi(b);
                let sum: f64 = conical(apex, one).iter().map(term).sum();
                let exact = if one { integral(a + 1, b, 0) + integral(a, b, 1) } else { integral(a, b + 1, 0) };
                assert!((sum - exact).abs() < 1e-12, "from corner {apex}, {one}: {a} {b}: {sum} {exact}");
            }
        }
    }
}
