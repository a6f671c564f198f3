//! Nodes that a rod drags along its axis, up to limits of force: friction along its wall, a push under its end.
//!
//! ```text
//! wall    P = K (d - b - w)           |P| <= L       beyond the limit b follows: the wall slips
//! end     P_i = k_i x_i, x_i = d - c_i - w_i   0 <= P_i <= l_i   beyond the limit c_i follows: the end goes on through the material;
//!                                     it never pulls, and comes back to where it was. Where c_i can't follow, each further x_i costs
//!                                     K_i >> k_i: a membrane
//! stop    c = sum_i a_i c_i <= z      a_i: share of ring i in the end's area; z: depth of the membrane
//! ```
//!
//! The end acts on the material at the depth c, the mean: the c_i differ as much as the tissue under its face is bent. So they all stop
//! together, when the mean is at the membrane. If each stopped at z for itself, the first ring there would carry all further force, and
//! the mean would never come.
//!
//! d: way of the rod along its axis; w: displacement of a layer of nodes along the axis. Behind the end a layer moves as one. The end
//! acts on three layers j in the shares s_j: w_i = sum_j s_j w_ij over their rings i, and P_i acts on them in the same shares. The end has the
//! rings of the layer that has most. Rings lie equal steps apart, and between those of a layer with fewer w_ij is linear.
//!
//! After a membrane has broken the tissue springs back, and swings: the masses are not those of tissue. What the end cuts and the wall
//! slips then is where that comes to rest under the limits, so until then ([`End::springs`]) c_i and b follow it both ways, down to where
//! they were at first.
//!
//! Springs are those at the end of the step ([`super::slide`]). What sticks goes with the rod: q is its velocity relative to the rod's
//! while it sticks and relative to its tangent motion t d while it slips, so that neither beginning is a push, and the trial force holds
//! no inertia. t itself is learnt throughout and not set to the rod's motion: a layer that sticks for a moment would go on with the rod.

use super::aside::{across, along};
use super::cloned::cloned_field_by_field;
use super::nodes::Rule;
use super::slide::{Rate, Tip, slide};
use super::slip::Slip;
use super::state::Moving;

/// Largest share of its distance from the outermost ring that a tied layer's node loses in a step.
const FLATTEN: f64 = 0.02;
/// Share of a limit that is nothing but the round-off of where the end goes on.
const ROUND_OFF: f64 = 1e-6;

/// How a layer of nodes goes along the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Grip {
    /// As free tissue.
    #[default]
    Free,
    /// Each node for itself: beside the rod's end.
    Apart,
    /// All as one: behind it.
    Tied,
}

/// What the rod's wall does to a layer.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Wall {
    /// How its nodes go.
    pub grip: Grip,
    /// K, N/m.
    pub spring: f64,
    /// L, N.
    pub limit: f64,
}

/// What the rod's end does.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct End {
    /// The first of the layers that it acts on.
    pub first: usize,
    /// s_j.
    pub shares: [f64; 3],
    /// Sum of the springs k_i, N/m; 0 without an end in the material.
    pub spring: f64,
    /// Sum of the springs K_i, N/m.
    pub stiff: f64,
    /// Sum of the limits l_i, N; infinite: c_i does not follow, and K_i acts from the first.
    pub limit: f64,
    /// Largest mean of all c_i, m: a membrane.
    pub stop: f64,
    /// How the limits grow with the speed of c_i.
    pub rate: Rate,
    /// How far a c_i may be behind the mean of all, m.
    pub lag: f64,
    /// Whether c_i and b go where the tissue springs back to, and back from there, at forces that stay the limits.
    pub springs: bool,
}

cloned_field_by_field! {
    /// The rod, and what it does to the layers.
    #[derive(Debug)]
    pub(super) struct Drag {
        /// Unit vector into the body.
        pub axis: [f64; 3],
        /// Nodes of each layer, ring by ring from the axis.
        pub nodes: Vec<u32>,
        /// Share of each of them that the model has: a half of one on a plane of symmetry.
        shares: Vec<f64>,
        layers: Vec<Layer>,
        /// Share of the end's area of each ring.
        pub areas: Vec<f64>,
        /// Way of the rod, or past it, on which what its end has bent becomes flat again behind it, m.
        pub flattening: f64,
        pub walls: Vec<Wall>,
        pub end: End,
        /// d at the start and the end of an advance, m.
        pub way: [f64; 2],
    }
}

cloned_field_by_field! {
    /// Rings of one layer.
    #[derive(Debug)]
    struct Layer {
        /// Where each ring begins in `nodes`, and where the next layer does.
        rings: Vec<usize>,
        /// Nodes that each ring has of the model.
        counts: Vec<f64>,
        /// Sum of the shares that each of them has in all rings of the end.
        crowd: Vec<f64>,
    }
}

impl Layer {
    /// Rings of so many nodes from a place on, of a rod whose end has so many rings. `shares`: of all nodes.
    fn new(first: usize, sizes: &[usize], shares: &[f64], of_end: usize) -> Self {
        let mut rings = vec![first];
        sizes.iter().for_each(|size| rings.push(rings[rings.len() - 1] + size));
        let counts = rings.windows(2).map(|ring| shares[ring[0]..ring[1]].iter().sum()).collect();
        let mut layer = Self { rings, counts, crowd: vec![0.0; sizes.len()] };
        for ring in 0..of_end {
            for (own, share) in layer.carries(ring, of_end) {
                layer.crowd[own] += share;
            }
        }
        layer
    }

    fn outermost(&self) -> usize {
        self.rings.len() - 2
    }

    /// The rings that carry one of so many rings of the end, and their shares.
    fn carries(&self, ring: usize, of_end: usize) -> [(usize, f64); 2] {
        let (steps, most) = (self.outermost(), (of_end - 1).max(1));
        let (inner, rest) = (ring * steps / most, ring * steps % most);
        let share = rest as f64 / most as f64;
        [(inner, 1.0 - share), ((inner + 1).min(steps), share)]
    }

    /// The ring of the end that is nearest to one of the layer's.
    fn nearest(&self, own: usize, of_end: usize) -> usize {
        (own * (of_end - 1) + self.outermost() / 2) / self.outermost().max(1)
    }
}

impl Drag {
    /// A rod that holds nothing yet, through layers of nodes with so many nodes in each ring, `areas` being the rings' shares of the end, and
    /// `shares` what the model has of each node.
    pub(super) fn new(
        axis: [f64; 3],
        (nodes, shares): (Vec<u32>, Vec<f64>),
        ring_sizes: &[Vec<usize>],
        areas: Vec<f64>,
        flattening: f64,
    ) -> Self {
        let mut first = 0;
        let layer = |sizes: &Vec<usize>| {
            let layer = Layer::new(first, sizes, &shares, areas.len());
            first += sizes.iter().sum::<usize>();
            layer
        };
        let layers: Vec<Layer> = ring_sizes.iter().map(layer).collect();
        let walls = vec![Wall::default(); layers.len()];
        Self { axis, nodes, shares, layers, areas, flattening, walls, end: End::default(), way: [0.0; 2] }
    }

    /// Places in `nodes` of a layer.
    pub(super) fn layer(&self, layer: usize) -> std::ops::Range<usize> {
        let rings = &self.layers[layer].rings;
        rings[0]..rings[rings.len() - 1]
    }

    /// Places of a ring of a layer.
    fn ring(&self, layer: usize, ring: usize) -> std::ops::Range<usize> {
        let rings = &self.layers[layer].rings;
        rings[ring]..rings[ring + 1]
    }

    /// Places of the ring of a layer that touches the wall.
    fn outermost(&self, layer: usize) -> std::ops::Range<usize> {
        self.ring(layer, self.layers[layer].outermost())
    }

    /// Places that the wall acts on: all of a tied layer, the outermost ring of another.
    fn walled(&self, layer: usize) -> std::ops::Range<usize> {
        match self.walls[layer].grip {
            Grip::Tied => self.layer(layer),
            Grip::Apart | Grip::Free => self.outermost(layer),
        }
    }

    /// Way of the rod in a step, m.
    fn way_of(&self, rule: &Rule) -> f64 {
        (self.way[1] - self.way[0]) / f64::from(rule.steps)
    }

    /// Way along the rod that the tangent motion has in a step, m.
    fn drift(&self, rule: &Rule, tangent: &[[f64; 3]; 3]) -> f64 {
        along(&std::array::from_fn(|k| rule.drift(tangent, k)), &self.axis)
    }

    pub(super) fn gripped(&self) -> impl Iterator<Item = usize> {
        (0..self.walls.len()).filter(|&l| self.walls[l].grip != Grip::Free)
    }

    /// Displacement of a place's node along the axis, m.
    fn along(&self, place: usize, u: &[[f64; 3]]) -> f64 {
        along(&u[self.nodes[place] as usize], &self.axis)
    }

    /// Nodes of places that the model has.
    fn count(&self, places: std::ops::Range<usize>) -> f64 {
        self.shares[places].iter().sum()
    }

    /// Mean displacement of a layer's outermost ring along the axis, m.
    pub(super) fn of_layer(&self, layer: usize, u: &[[f64; 3]]) -> f64 {
        let own = &self.layers[layer];
        let sum: f64 = self.outermost(layer).map(|p| self.shares[p] * self.along(p, u)).sum();
        sum / own.counts[own.outermost()]
    }

    /// One step of the dragged nodes, from the force at its start.
    pub(super) fn step(&self, state: &mut Moving, mass: &[f64], step: u32, rule: &Rule) {
        let share = f64::from(step) / f64::from(rule.steps);
        let d = self.way[0] + share * (self.way[1] - self.way[0]);
        state.slip.at = d;
        self.predict(state, mass, rule);
        if self.end.spring > 0.0 {
            self.push(state, mass, rule, d);
        }
        for layer in self.gripped() {
            let heavy = self.layer(layer).map(|p| mass[self.nodes[p] as usize]).sum::<f64>() * rule.mass_factor;
            let at = Standing { layer, heavy, flat: self.of_layer(layer, &state.u) };
            self.pull(state, mass, rule, d, &at);
            self.move_on(state, rule, &at);
        }
    }

    /// Ways without the rod.
    fn predict(&self, state: &mut Moving, mass: &[f64], rule: &Rule) {
        let Moving { q, tangent, f, slip, .. } = state;
        for layer in self.gripped() {
            for p in self.layer(layer) {
                let n = self.nodes[p] as usize;
                let drift = if slip.held[p] { self.way_of(rule) } else { self.drift(rule, &tangent.of(n)) };
                slip.step[p] = drift + rule.keep * along(&q[n], &self.axis)
                    - along(&f[n], &self.axis) / (mass[n] * rule.mass_factor);
                slip.load[p] = 0.0;
            }
            if self.walls[layer].grip == Grip::Tied {
                let weights = || self.layer(layer).map(|p| mass[self.nodes[p] as usize]);
                let sum: f64 = self.layer(layer).zip(weights()).map(|(p, m)| m * slip.step[p]).sum();
                let mean = sum / weights().sum::<f64>();
                slip.step[self.layer(layer)].fill(mean);
            }
        }
    }

    /// The rings that carry a ring of the end, how many nodes each has, its share, and the sum of its shares in all rings of the end.
    fn parts(&self, ring: usize) -> impl Iterator<Item = (std::ops::Range<usize>, f64, f64, f64)> {
        let pushed = (self.end.first..).zip(self.end.shares).filter(|(_, s)| *s > 0.0);
        pushed.flat_map(move |(l, s)| {
            let carries = self.layers[l].carries(ring, self.areas.len()).into_iter().filter(|(_, share)| *share > 0.0);
            carries.map(move |(own, share)| {
                let Layer { counts, crowd, .. } = &self.layers[l];
                (self.ring(l, own), counts[own], s * share, s * crowd[own])
            })
        })
    }

    /// w_i of a ring after a step without the end, m, and the ring's springs, with a limit in N of the whole end.
    fn meets(&self, i: usize, u: &[[f64; 3]], slip: &Slip, limit: f64, mass: &[f64], rule: &Rule) -> (f64, Tip) {
        let (mut w, mut compliance) = (0.0, 0.0);
        for (ring, count, weight, crowd) in self.parts(i) {
            for p in ring {
                // all rings of the end that a node carries push it at once
                let [each, together] = [weight, crowd].map(|w| self.shares[p] * (w / count));
                w += each * (self.along(p, u) + slip.step[p]);
                compliance += each * together / (mass[self.nodes[p] as usize] * rule.mass_factor);
            }
        }
        let [spring, stiff, most] = [self.end.spring, self.end.stiff, limit].map(|sum| self.areas[i] * sum);
        (w, Tip { spring, stiff, limit: if most.is_finite() { most } else { 0.0 }, compliance })
    }

    /// Where a ring's c_i has to be for its push to be at its limit `most` in N, m, and whether it goes faster than the limit holds for.
    /// `gap`: d - w_i, m.
    fn goes_on(&self, tip: &Tip, most: f64, gap: f64, began: f64) -> (f64, bool) {
        let at = gap - most * tip.give();
        let Rate { exponent, slow } = self.end.rate;
        if exponent > 0.0 && at - began > slow {
            (began + self.end.rate.way(at - began, most, 1.0 / tip.give()), true)
        } else {
            (at, false)
        }
    }

    /// Share of the way that the c_i would go in a step which brings their mean to a membrane, and no farther; 1 where it is not reached.
    fn share_of_way(&self, u: &[[f64; 3]], slip: &Slip, d: f64, mass: &[f64], rule: &Rule) -> f64 {
        let End { limit, stop, .. } = self.end;
        if !(limit.is_finite() && stop.is_finite()) {
            return 1.0;
        }
        let (mut before, mut after) = (0.0, 0.0);
        for (i, area) in self.areas.iter().enumerate() {
            let (w, tip) = self.meets(i, u, slip, limit, mass, rule);
            let c = slip.end_floor[i];
            let on = tip.force(d - c - w) > tip.limit;
            let to = if on { self.goes_on(&tip, tip.limit, d - w, slip.began[i]).0.max(c) } else { c };
            (before, after) = (before + area * c, after + area * to);
        }
        if after <= stop { 1.0 } else { ((stop - before) / (after - before)).max(0.0) }
    }

    /// The end's push, ring by ring.
    fn push(&self, state: &mut Moving, mass: &[f64], rule: &Rule, d: f64) {
        let Moving { u, slip, .. } = state;
        let end = &self.end;
        let limit = end.limit;
        if !end.springs {
            slip.end_floor.copy_from_slice(&slip.end);
        }
        let share = self.share_of_way(u, slip, d, mass, rule);
        slip.stopped = share < 1.0;
        for i in 0..self.areas.len() {
            let (w, mut tip) = self.meets(i, u, slip, limit, mass, rule);
            let most = self.areas[i] * limit;
            let mut c = slip.end_floor[i];
            let (mut force, mut work) = (tip.force(d - c - w), 0.0);
            if force > most {
                let (at, fast) = self.goes_on(&tip, most, d - w, slip.began[i]);
                c = if slip.stopped { c + share * (at - c).max(0.0) } else { at.max(c) };
                if fast && !slip.stopped {
                    // the limit at the speed that it has
                    tip.limit = (d - c - w) / tip.give();
                }
                force = tip.force(d - c - w);
                work = if fast && !slip.stopped { force } else { most.min(force) };
            }
            slip.dissipated += work * (c - slip.end[i]);
            slip.end[i] = c;
            slip.push[i] = force;
            for (ring, count, weight, _) in self.parts(i) {
                for p in ring {
                    let each = self.shares[p] * (force * weight / count);
                    slip.step[p] += each / (mass[self.nodes[p] as usize] * rule.mass_factor);
                    slip.load[p] += each;
                }
            }
        }
        let behind = self.cut(slip) - end.lag;
        for (c, force) in slip.end.iter_mut().zip(&slip.push).filter(|(c, _)| **c < behind) {
            slip.dissipated += force * (behind - *c);
            *c = behind;
        }
    }

    /// Mean of c_i over the end's area, m.
    pub(super) fn cut(&self, slip: &Slip) -> f64 {
        self.areas.iter().zip(&slip.end).map(|(a, c)| a * c).sum()
    }

    /// The wall's friction on a layer.
    fn pull(&self, state: &mut Moving, mass: &[f64], rule: &Rule, d: f64, at: &Standing) {
        let slip = &mut state.slip;
        let layer = at.layer;
        let Wall { grip, spring, limit } = self.walls[layer];
        if limit <= 0.0 {
            slip.pull[layer] = 0.0;
            return;
        }
        let places = self.walled(layer);
        let count = self.count(places.clone());
        let heavy = match grip {
            Grip::Tied => at.heavy,
            _ => places.clone().map(|p| mass[self.nodes[p] as usize]).sum::<f64>() * rule.mass_factor,
        };
        let w = places.clone().map(|p| self.shares[p] * slip.step[p]).sum::<f64>() / count + at.flat;
        if !self.end.springs {
            slip.wall_floor[layer] = slip.wall[layer];
        }
        let (force, b) = slide(spring, limit, heavy, d - w, slip.wall_floor[layer]);
        slip.dissipated += force * (b - slip.wall[layer]);
        (slip.wall[layer], slip.pull[layer]) = (b, force);
        for p in places {
            slip.step[p] += force / heavy;
            // a tied layer is loaded as one
            let share = match grip {
                Grip::Tied => mass[self.nodes[p] as usize] * rule.mass_factor / heavy,
                _ => self.shares[p] / count,
            };
            slip.load[p] += share * force;
        }
    }

    /// Whether a layer's wall sticks.
    fn sticks(&self, slip: &Slip, layer: usize) -> bool {
        let Wall { grip, limit, .. } = self.walls[layer];
        grip == Grip::Tied && limit > 0.0 && slip.pull[layer].abs() < limit
    }

    /// Whether the end holds a place's node, of the layer that is nearest to the end: what it pushes with less than its limit, or at a
    /// membrane.
    fn is_pushed(&self, slip: &Slip, layer: usize, place: usize) -> bool {
        let End { first, shares, spring, limit, .. } = self.end;
        let most = shares.iter().copied().fold(0.0, f64::max);
        if spring <= 0.0 || layer.checked_sub(first).and_then(|j| shares.get(j)).is_none_or(|s| *s < most) {
            return false;
        }
        let own = &self.layers[layer];
        let ring = own.nearest(own.rings.partition_point(|first| *first <= place) - 1, self.areas.len());
        slip.push[ring] > 0.0 && (slip.stopped || slip.push[ring] < (1.0 - ROUND_OFF) * self.areas[ring] * limit)
    }

    /// Takes a layer's step, and what velocity is left of it. That of a wall that sticks is damped critically for its spring.
    fn move_on(&self, state: &mut Moving, rule: &Rule, at: &Standing) {
        let (rod, wall) = (self.way_of(rule), &self.walls[at.layer]);
        let sticks = self.sticks(&state.slip, at.layer);
        let keep = if sticks { (1.0 - 2.0 * (wall.spring / at.heavy).sqrt()).max(0.0) } else { 0.0 };
        let Moving { u, q, tangent, slip, .. } = state;
        for p in self.layer(at.layer) {
            let n = self.nodes[p] as usize;
            let moved = slip.step[p];
            (0..3).for_each(|k| u[n][k] += moved * self.axis[k]);
            if wall.grip == Grip::Tied {
                // What the end has bent becomes flat again as the wall slides past: the force does not fall at once. After a
                // puncture it is the layer that goes past a rod which stands.
                let flatten = FLATTEN.min(rod.abs().max((rod - moved).abs()) / self.flattening);
                let bent = flatten * (at.flat - self.along(p, u));
                (0..3).for_each(|k| u[n][k] += bent * self.axis[k]);
            }
            let pushed = !sticks && self.is_pushed(slip, at.layer, p);
            slip.held[p] = sticks || pushed;
            let mut known = tangent.of(n);
            let deviation = moved - self.drift(rule, &known);
            let left: [f64; 3] = std::array::from_fn(|k| rule.teach(&mut known, k, deviation * self.axis[k]));
            tangent.set(n, known);
            let left = match (sticks, pushed) {
                (true, _) => keep * (moved - rod),
                // what the end holds would swing past its limit, and stay cut
                (false, true) => 0.0,
                (false, false) => along(&left, &self.axis),
            };
            let beside = across(&q[n], &self.axis);
            q[n] = std::array::from_fn(|k| beside[k] + left * self.axis[k]);
        }
    }
}

/// A layer at the start of a step.
struct Standing {
    layer: usize,
    /// Force per way that all of the layer makes of a force within a step, N/m.
    heavy: f64,
    /// Mean displacement of its outermost ring along the axis, m.
    flat: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of the end acts at its own radius, with all of its push, on layers of any number of rings.
    #[test]
    fn rings_of_the_end_are_carried_where_they_are() {
        for (own, of_end) in [(9, 9), (3, 9), (4, 9), (2, 5), (8, 9)] {
            let layer = Layer::new(0, &vec![1; own], &vec![1.0; own], of_end);
            for ring in 0..of_end {
                let carries = layer.carries(ring, of_end);
                let radius: f64 = carries.iter().map(|(i, share)| share * *i as f64 / (own - 1) as f64).sum();
                assert!((radius - ring as f64 / (of_end - 1) as f64).abs() < 1e-12, "{own} of {of_end}: {carries:?}");
                assert!((carries[0].1 + carries[1].1 - 1.0).abs() < 1e-15);
            }
            assert!((layer.crowd.iter().sum::<f64>() - of_end as f64).abs() < 1e-12);
            assert_eq!((layer.nearest(0, of_end), layer.nearest(own - 1, of_end)), (0, of_end - 1));
        }
    }
}
