//! What a needle meets on its way through the material: layers of nodes, and what the tissue between two of them does to it.

use crate::scene::{Interaction, Metres, NamedMaterial, Needle, Region, Scene};
use mtled::cloud::Axis;
use mtled::mirror::Mirror;

/// What tissue does to a needle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Resistance {
    /// 0: in no region; otherwise one more than the region's place in the scene.
    pub region: u8,
    /// Largest friction per length, N/m.
    pub friction: f64,
    /// Friction over the normal pressure of the tissue on the shaft, beside that.
    pub friction_coefficient: f64,
    /// N.
    pub cutting: f64,
    /// Exponent of the speed in the cutting force.
    pub rate_exponent: f64,
    /// Force to enter it, N; 0: no membrane.
    pub puncture: f64,
    /// Pa.
    pub shear_modulus: f64,
}

impl Resistance {
    /// Of the scene's region by number (0: none).
    #[must_use]
    pub(crate) fn of(scene: &Scene, region: u8, diameter: f64) -> Self {
        let named = |r: &Region| scene.materials.iter().find(|m| m.name == r.material);
        match region.checked_sub(1).and_then(|i| scene.regions.get(usize::from(i))).and_then(named) {
            Some(NamedMaterial { material, pierced, .. }) => Self {
                region,
                friction: pierced.friction,
                friction_coefficient: pierced.friction_coefficient,
                // a cut as wide as the needle: the energy of its new surface is that of the force's way
                cutting: if pierced.cutting_force > 0.0 {
                    pierced.cutting_force
                } else {
                    pierced.fracture_toughness * diameter
                },
                rate_exponent: pierced.cutting_rate_exponent,
                puncture: pierced.puncture_force,
                shear_modulus: material.shear_modulus(),
            },
            None => {
                let none = Self { shear_modulus: scene.material.shear_modulus(), ..Self::default() };
                match scene.instrument.map(|i| i.interaction) {
                    Some(Interaction::Frictional {
                        friction,
                        shaft_friction_coefficient,
                        cutting_force,
                        puncture_force,
                        cutting_rate_exponent,
                        ..
                    }) => Self {
                        friction,
                        friction_coefficient: shaft_friction_coefficient,
                        cutting: cutting_force,
                        rate_exponent: cutting_rate_exponent,
                        puncture: puncture_force,
                        ..none
                    },
                    _ => none,
                }
            }
        }
    }
}

/// Layers of nodes across the path, and what lies between them.
#[derive(Clone, Debug)]
pub struct Shaft {
    /// Depth of each layer below the top along the axis, m.
    pub depths: Vec<f64>,
    /// Nodes by layer, each ring by ring from the axis.
    pub nodes: Vec<u32>,
    /// Unit vector from the axis to each of them; zero on the axis.
    pub outward: Vec<[f64; 3]>,
    /// Share of each of them that the model has: a half of one on a plane of symmetry.
    shares: Vec<f64>,
    /// That plane.
    mirror: Option<Mirror>,
    /// Nodes in each ring of each layer; rings are equal steps apart, from the axis to R.
    pub rings: Vec<Vec<usize>>,
    /// Place of each layer's first node, and the number of nodes.
    first: Vec<usize>,
    /// Share of each ring of the layer with most of them in the push of the tip's face (`Shaft::with_face`).
    pub areas: Vec<f64>,
    /// What lies under each layer.
    pub under: Vec<Resistance>,
    /// R, m.
    pub radius: f64,
    /// Unit vector along it, into the tissue.
    pub axis: [f64; 3],
}

/// Length of the tip over which it pushes, in radii.
const SPREAD: f64 = 0.125;
/// Distances between nodes of one layer, over those between layers.
const SAME: f64 = 0.25;

impl Shaft {
    /// From nodes on the path with their depth below the top along the axis, m, and distance from the axis, m; `None` if they don't lie
    /// in layers of rings. `spacing`: least distance between layers, m; `share`: of a node, what the model has of it.
    #[must_use]
    pub(crate) fn new(
        mut nodes: Vec<(u32, f64, f64)>,
        spacing: f64,
        radius: f64,
        share: impl Fn(u32) -> f64,
    ) -> Option<Self> {
        nodes.sort_by(|a, b| a.1.total_cmp(&b.1));
        let layers: Vec<Vec<(u32, f64, f64)>> = nodes
            .chunk_by(|a, b| b.1 - a.1 < SAME * spacing)
            .map(|layer| {
                let mut layer = layer.to_vec();
                layer.sort_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)));
                layer
            })
            .collect();
        let sizes = |layer: &Vec<(u32, f64, f64)>| -> Vec<usize> {
            layer.chunk_by(|a, b| b.2 - a.2 < SAME * spacing).map(<[_]>::len).collect()
        };
        let rings: Vec<Vec<usize>> = layers.iter().map(sizes).collect();
        let in_steps = |(layer, sizes): (&Vec<(u32, f64, f64)>, &Vec<usize>)| {
            let ring = sizes.iter().enumerate().flat_map(|(i, &size)| std::iter::repeat_n(i, size));
            let step = radius / (sizes.len() - 1) as f64;
            sizes.len() > 1 && layer.iter().zip(ring).all(|(n, i)| (n.2 - i as f64 * step).abs() < SAME * spacing)
        };
        // as many rings are always of as many nodes; every other layer is turned, and has others on a plane of symmetry
        let counts = |layer: &Vec<(u32, f64, f64)>| -> Vec<f64> {
            layer
                .chunk_by(|a, b| b.2 - a.2 < SAME * spacing)
                .map(|ring| ring.iter().map(|n| share(n.0)).sum())
                .collect()
        };
        let counts: Vec<Vec<f64>> = layers.iter().map(counts).collect();
        let alike = |a: &Vec<f64>| counts.iter().all(|b| a.len() != b.len() || a == b);
        if layers.len() < 3 || !layers.iter().zip(&rings).all(in_steps) || !counts.iter().all(alike) {
            return None;
        }
        let mut first = vec![0];
        layers.iter().for_each(|layer| first.push(first[first.len() - 1] + layer.len()));
        let depths = layers.iter().map(|l| l[0].1).collect();
        let nodes: Vec<u32> = layers.iter().flatten().map(|(n, ..)| *n).collect();
        let (outward, areas, under) = (Vec::new(), Vec::new(), Vec::new());
        let shares = nodes.iter().map(|&n| share(n)).collect();
        let (mirror, axis) = (None, [0.0, 0.0, -1.0]);
        Some(Self { depths, nodes, outward, shares, mirror, rings, first, areas, under, radius, axis })
    }

    /// The same layers of a body of which the model has the half beside a plane of symmetry, if it has one.
    #[must_use]
    pub(crate) fn mirrored(self, mirror: Option<Mirror>) -> Self {
        Self { mirror, ..self }
    }

    /// Sum of a vector over places of the whole body.
    pub(crate) fn sum(&self, places: std::ops::Range<usize>, of: impl Fn(usize) -> [f64; 3]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for place in places {
            let v = of(place);
            (0..3).for_each(|k| sum[k] += v[k]);
        }
        self.mirror.map_or(sum, |mirror| mirror.within(&sum).map(|x| 2.0 * x))
    }

    /// Share of the body that the model has.
    pub(crate) fn half(&self) -> f64 {
        if self.mirror.is_some() { 0.5 } else { 1.0 }
    }

    /// Share of a place's node that the model has.
    pub(crate) fn share_of(&self, place: usize) -> f64 {
        self.shares[place]
    }

    /// Nodes of places that the model has.
    pub(crate) fn count(&self, places: std::ops::Range<usize>) -> f64 {
        self.shares[places].iter().sum()
    }

    /// Along an axis that meets the body's top at a height, m, through nodes at these places, m.
    #[must_use]
    pub(crate) fn along(mut self, axis: &Axis, top: f64, points: &[[f64; 3]]) -> Self {
        let secant = axis.secant();
        self.axis = [axis.slope[0], axis.slope[1], -1.0].map(|x| x / secant);
        self.outward = self.nodes.iter().map(|&n| axis.outward(top, points[n as usize])).collect();
        self
    }

    /// With what lies under each layer for a needle along an axis: `region` of a point there.
    #[must_use]
    pub(crate) fn in_tissue(
        mut self,
        scene: &Scene,
        needle: &Needle,
        axis: &Axis,
        top: f64,
        region: impl Fn([f64; 3]) -> u8,
    ) -> Self {
        let (secant, diameter) = (axis.secant(), needle.diameter.get());
        self.under = (0..self.depths.len())
            .map(|k| {
                let next = self.depths.get(k + 1).copied().unwrap_or(self.depths[k] + 1e-6);
                let depth = 0.5 * (self.depths[k] + next) / secant;
                let [x, y] = axis.at(depth);
                Resistance::of(scene, region([x, y, top - depth]), diameter)
            })
            .collect();
        self
    }

    /// Layer at or above a depth, and how far the depth is from there to the next one.
    #[must_use]
    pub(crate) fn place(&self, depth: f64) -> (usize, f64) {
        let near = 1e-6 * self.radius;
        let k = self.depths.partition_point(|z| *z <= depth + near).clamp(1, self.depths.len() - 1) - 1;
        let share = (depth - self.depths[k]) / (self.depths[k + 1] - self.depths[k]);
        (k, if share.abs() < 1e-6 { 0.0 } else { share.clamp(0.0, 1.0) })
    }

    /// How the push at a depth is spread over layers: the first of three, and their shares. It acts over a length b of R/8, at most
    /// the distance between layers: with x the depth, and H_j the linear function of layer j,
    ///
    /// ```text
    /// s_j = 1/b integral of H_j(y) dy over x - b/2 to x + b/2        sum 1, mean x
    /// ```
    ///
    /// The quadratic B-splines where b is the distance. At a sharp depth tissue yields twice as much to a push at a layer as halfway to the
    /// next one, at that length by a fifth of that; else the front goes on in leaps. Above the first layer there is none: the first one
    /// yields for it.
    #[must_use]
    pub(crate) fn spread(&self, depth: f64) -> (usize, [f64; 3]) {
        let (above, share) = self.place(depth);
        let nearest = (above + usize::from(share > 0.5)).min(self.depths.len() - 2);
        let z = self.depths[nearest];
        let below = self.depths[nearest + 1] - z;
        let over = nearest.checked_sub(1).map_or(below, |k| z - self.depths[k]);
        // from the nearest layer, m
        let x = (self.depths[above] + share * (self.depths[above + 1] - self.depths[above]) - z).min(0.5 * below);
        let b = (SPREAD * self.radius).min(over).min(below);
        // integral of a function that rises to 1 at 0 over one length and falls over another, to y
        let to = |y: f64, rise: f64, fall: f64| {
            if y < 0.0 {
                0.5 * rise * (1.0 + y / rise).max(0.0).powi(2)
            } else {
                0.5 * rise + 0.5 * fall * (1.0 - (1.0 - y / fall).max(0.0).powi(2))
            }
        };
        // of the function of a layer at a distance from the nearest
        let share_of =
            |at: f64, rise: f64, fall: f64| (to(x + 0.5 * b - at, rise, fall) - to(x - 0.5 * b - at, rise, fall)) / b;
        let [up, at, down] = [share_of(-over, over, over), share_of(0.0, over, below), share_of(below, below, below)];
        match nearest.checked_sub(1) {
            Some(first) => (first, [up, at, down]),
            None => (0, [at + 2.0 * up, down - up, 0.0]),
        }
    }

    /// What a layer has of the length of shaft from the surface to a depth, m, weighted by `of` what lies there: the integral of the
    /// layer's linear function.
    #[must_use]
    pub(crate) fn share(&self, layer: usize, to: f64, of: impl Fn(&Resistance) -> f64) -> f64 {
        let z = &self.depths;
        let mut sum = 0.0;
        if layer > 0 {
            let h = z[layer] - z[layer - 1];
            let s = ((to - z[layer - 1]) / h).clamp(0.0, 1.0);
            sum += 0.5 * s * s * h * of(&self.under[layer - 1]);
        }
        if layer + 1 < z.len() {
            let h = z[layer + 1] - z[layer];
            let s = ((to - z[layer]) / h).clamp(0.0, 1.0);
            sum += s * (1.0 - 0.5 * s) * h * of(&self.under[layer]);
        }
        sum
    }

    /// Places of the nodes of a layer.
    pub(crate) fn layer(&self, layer: usize) -> std::ops::Range<usize> {
        self.first[layer]..self.first[layer + 1]
    }

    /// Layer of a place.
    pub(crate) fn layer_of(&self, place: usize) -> usize {
        self.first.partition_point(|first| *first <= place) - 1
    }

    /// Places of the nodes of a layer's outermost ring.
    pub(crate) fn wall(&self, layer: usize) -> std::ops::Range<usize> {
        let end = self.first[layer + 1];
        end - self.rings[layer].last().copied().unwrap_or(0)..end
    }

    /// The first layer below a depth under which another region begins.
    #[must_use]
    pub(crate) fn boundary_below(&self, depth: f64) -> Option<usize> {
        let near = 1e-6 * self.radius;
        (1..self.depths.len())
            .find(|&k| self.depths[k] > depth + near && self.under[k].region != self.under[k - 1].region)
    }
}

/// Depth of the needle's start along its axis, m, and the speed up to which cutting takes the same force, m/s.
#[must_use]
pub(crate) fn start_and_slow(scene: &Scene) -> [f64; 2] {
    let slow = match scene.instrument.map(|i| i.interaction) {
        Some(Interaction::Frictional { cutting_rate_reference, .. }) => cutting_rate_reference.get(),
        _ => f64::INFINITY,
    };
    [scene.motion.map_or(0.0, |m| Metres::get(m.start_depth)), slow]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn shaft() -> Shaft {
        let nodes = (0..5).flat_map(|k| (0..3).map(move |i| (3 * k + i, 1e-3 * f64::from(k), 2.5e-4 * f64::from(i))));
        let mut shaft = Shaft::new(nodes.collect(), 1e-3, 5e-4, |_| 1.0).unwrap();
        let tissue = Resistance { friction: 2.0, cutting: 1.0, shear_modulus: 1e3, ..Resistance::default() };
        shaft.under = vec![tissue; 5];
        shaft
    }

    #[test]
    fn shares_make_the_inserted_length() {
        let shaft = shaft();
        for to in [0.0, 3e-4, 1e-3, 2.7e-3, 4e-3] {
            let sum: f64 = (0..5).map(|k| shaft.share(k, to, |r| r.friction)).sum();
            assert!((sum - 2.0 * to).abs() < 1e-15, "{to}: {sum}");
        }
    }

    /// Whatever the distances of the layers, and where two lengths meet.
    #[test]
    fn the_push_is_spread_with_sum_one_and_where_it_is() {
        let depths = [0.0, 6e-5, 1.2e-4, 2.4e-4, 4.9e-4, 7.4e-4];
        let nodes =
            depths.iter().zip(0..).flat_map(|(z, k)| (0..3).map(move |i| (3 * k + i, *z, 2.5e-4 * f64::from(i))));
        let shaft = Shaft::new(nodes.collect(), 6e-5, 5e-4, |_| 1.0).unwrap();
        for k in 0..=105 {
            let depth = 7.0e-5 + 5e-6 * f64::from(k);
            let (first, shares) = shaft.spread(depth);
            let at: f64 = shares.iter().zip(&depths[first..]).map(|(s, z)| s * z).sum();
            assert!(
                (shares.iter().sum::<f64>() - 1.0).abs() < 1e-12 && (at - depth).abs() < 1e-12,
                "{depth}: {shares:?}"
            );
            assert!(shares.iter().all(|s| *s > -1e-12), "{depth}: {shares:?}");
        }
    }

    /// A layer may have fewer rings than another, but rings lie equal steps apart.
    #[test]
    fn layers_of_several_numbers_of_rings_are_a_shaft() {
        let layer = |first: u32, z: f64, steps: u32| {
            (0..=steps).map(move |i| (first + i, z, 5e-4 * f64::from(i) / f64::from(steps)))
        };
        let of = |steps: [u32; 3]| (0..3).flat_map(|k| layer(10 * k, 1e-4 * f64::from(k), steps[k as usize])).collect();
        let shaft = Shaft::new(of([4, 3, 2]), 1e-4, 5e-4, |_| 1.0).unwrap();
        assert_eq!(shaft.rings.iter().map(Vec::len).collect::<Vec<_>>(), [5, 4, 3]);
        assert_eq!([shaft.layer(1), shaft.wall(1)], [5..9, 8..9]);
        assert_eq!((shaft.layer_of(4), shaft.layer_of(5), shaft.layer_of(11)), (0, 1, 2));
        let mut uneven: Vec<(u32, f64, f64)> = of([4, 4, 4]);
        uneven[2].2 += 4e-5;
        assert!(Shaft::new(uneven, 1e-4, 5e-4, |_| 1.0).is_none());
    }

    #[test]
    fn layers_that_differ_are_none() {
        let nodes = vec![(0, 0.0, 0.0), (1, 0.0, 1e-3), (2, 1e-3, 0.0), (3, 2e-3, 0.0), (4, 2e-3, 1e-3)];
        assert!(Shaft::new(nodes, 1e-3, 1e-3, |_| 1.0).is_none());
        assert_eq!(shaft().place(1.25e-3), (1, 0.25));
        assert_eq!(shaft().place(2e-3), (2, 0.0));
    }
}
