//! How the push of the tip's face is shared among the rings of nodes.
//!
//! ```text
//! a_i = sum over the nodes j of ring i, of any layer, of 1/(pi R^2) times the integral of phi_j over the face
//! ```
//!
//! That is the consistent load of a uniform pressure: its work on the field, not on the nodes. Moving least squares reach farther than the
//! linear functions between rings do. What the face gives to nodes beside the path, some hundredths, is left to the rings, in proportion.

use mtled::cloud::Axis;

use super::Shaft;

/// Layers whose distances differ by less are equally close.
const SAME_WIDTH: f64 = 1e-6;
/// Circles of points over the face, each for the same share of its area.
const CIRCLES: u32 = 64;
/// Points on each of them where the needle is not an axis of symmetry.
const AROUND: u32 = 32;

impl Shaft {
    /// The layer of that face: of those that are closest to their neighbours the one nearest to the middle.
    fn faced(&self) -> usize {
        let z = &self.depths;
        let width = |k: usize| z[k + 1] - z[k - 1];
        let least = (1..z.len() - 1).map(width).fold(f64::INFINITY, f64::min);
        let close = (1..z.len() - 1).filter(|&k| width(k) < (1.0 + SAME_WIDTH) * least);
        close.min_by_key(|k| k.abs_diff(z.len() / 2)).unwrap_or(z.len() / 2)
    }

    /// Points that stand for the same share each of a tip's face at a layer; with an axis of `symmetry`, on a radius.
    #[must_use]
    pub(crate) fn face(&self, axis: &Axis, top: f64, symmetry: bool) -> Vec<[f64; 3]> {
        let secant = axis.secant();
        let depth = self.depths[self.faced()] / secant;
        let [x, y] = axis.at(depth);
        let lean = axis.slope[0].hypot(axis.slope[1]);
        // layers lie level, so a face that leans is an ellipse there
        let along = if lean > 0.0 { axis.slope.map(|s| s / lean) } else { [1.0, 0.0] };
        let around = if symmetry { 1 } else { AROUND };
        let point = |i: u32| {
            let (circle, turn) = (f64::from(i / around), f64::from(i % around) / f64::from(around));
            let r = self.radius * ((circle + 0.5) / f64::from(CIRCLES)).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
            let (a, b) = (secant * r * cos, r * sin);
            [x + a * along[0] - b * along[1], y + a * along[1] + b * along[0], top - depth]
        };
        (0..CIRCLES * around).map(point).collect()
    }

    /// With the shares a_i, from phi_j at all points of the face.
    #[must_use]
    pub(crate) fn with_face(mut self, phi: &[(u32, f64)]) -> Self {
        let most = self.rings.iter().map(Vec::len).max().unwrap_or(1);
        // of a layer with fewer rings the nearest of the end's
        let of_end = |sizes: &Vec<usize>, i: usize| (i * (most - 1) + (sizes.len() - 1) / 2) / (sizes.len() - 1);
        let of_layer = |sizes: &Vec<usize>| -> Vec<usize> {
            sizes.iter().enumerate().flat_map(|(i, &size)| vec![of_end(sizes, i); size]).collect()
        };
        let mut place: Vec<(u32, usize)> =
            self.nodes.iter().copied().zip(self.rings.iter().flat_map(of_layer)).collect();
        place.sort_unstable();
        let mut sums = vec![0.0; most];
        for (node, value) in phi {
            if let Ok(at) = place.binary_search_by_key(node, |p| p.0) {
                sums[place[at].1] += value;
            }
        }
        let all: f64 = sums.iter().sum();
        self.areas = sums.into_iter().map(|sum| sum / all).collect();
        self
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Rings at 0, 0.25 and 0.5 mm of five layers.
    fn shaft() -> Shaft {
        let nodes = (0..5).flat_map(|k| (0..3).map(move |i| (3 * k + i, 1e-3 * f64::from(k), 2.5e-4 * f64::from(i))));
        Shaft::new(nodes.collect(), 1e-3, 5e-4, |_| 1.0).unwrap()
    }

    #[test]
    fn linear_functions_of_the_radius_share_as_their_integrals() {
        let shaft = shaft();
        let mut phi = Vec::new();
        for [x, y, z] in shaft.face(&Axis::vertical([1e-3, 0.0]), 5e-3, false) {
            assert!((z - 3e-3).abs() < 1e-12);
            let r = (x - 1e-3).hypot(y) / 2.5e-4;
            let linear = |i: f64| (1.0 - (r - i).abs()).max(0.0);
            // half of it to the layer above, as to nodes of another layer that the field reaches
            phi.extend([(3, 0.5 * linear(0.0)), (6, 0.5 * linear(0.0)), (7, linear(1.0)), (8, linear(2.0)), (99, 0.1)]);
        }
        let areas = shaft.with_face(&phi).areas;
        for (area, exact) in areas.iter().zip([1.0 / 12.0, 0.5, 5.0 / 12.0]) {
            assert!((area - exact).abs() < 3e-4, "{areas:?}");
        }
        assert!((areas.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_face_that_leans_is_as_far_from_the_axis_as_one_that_does_not() {
        let (shaft, axis) = (shaft(), Axis { entry: [0.0; 2], slope: [0.2, 0.1] });
        let distance = |p: &[f64; 3]| axis.distance(5e-3, *p);
        let face = shaft.face(&axis, 5e-3, false);
        let (least, most) = face.iter().map(distance).fold((f64::MAX, 0.0_f64), |(l, m), d| (l.min(d), m.max(d)));
        assert!(most < 5e-4 && most > 4.97e-4 && least > 4e-5 && least < 5e-5, "{least} {most}");
        let level = face.iter().map(|p| p[2]).collect::<Vec<_>>();
        assert!(level.iter().all(|z| (z - level[0]).abs() < 1e-15));
    }
}
