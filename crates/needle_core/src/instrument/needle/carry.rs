//! What is captured goes with the needle: which node is on its ramp or behind the tip, and where the rule puts it.

use super::{NeedlePath, SAME_LAYER};
use crate::instrument::Tip;
use crate::instrument::bevel::Push;
use crate::instrument::capture::{Capture, Hold, carried, passed};
use crate::scene::DeformationRule;
use mtled::solver::Solver;

/// Length before and behind the tip over which what it captures begins to move, over the distance between layers. Where all of a layer began
/// within one step the force had a peak of 2.6 % at each layer, three rings of nodes within the capture radius, 1 um per step.
const ONSET: f64 = 0.125;

/// How much earlier than the window says a ramp begins and ends at most, over the window: half a layer where it has four.
const EARLY: f64 = 0.125;

impl NeedlePath {
    pub(super) fn penetrate(&mut self, tip: &Tip, solver: &mut Solver) {
        let depth = -tip.offset[2];
        // how far the last layer behind the tip is off the path
        let mut behind = [0.0; 2];
        for i in 0..self.nodes.len() {
            let (n, z) = (self.nodes[i].0 as usize, self.nodes[i].1);
            let before = self.progress.hold[i];
            if before == Hold::Free && depth + self.window[i] < z {
                // the needle has not come there yet
                continue;
            }
            let hold = if depth + self.window[i] < z || depth < 0.0 {
                match before {
                    Hold::Captured(c) | Hold::Left(c) if depth >= 0.0 => Hold::Left(Capture { passed: 0.0, ..c }),
                    _ => Hold::Free,
                }
            } else {
                Hold::Captured(self.capture(i, tip, behind, solver))
            };
            if self.role(&hold) != self.role(&before) {
                solver.set_role(n, self.role(&hold));
            }
            self.progress.hold[i] = hold;
            if let Hold::Captured(capture) = hold {
                self.carry(i, &capture, tip, solver);
                if capture.passed >= 1.0 && !self.revolved {
                    behind = self.off_path(tip, z, capture.beside);
                }
            }
        }
        self.fill(depth, solver);
    }

    /// What becomes of node i in the window or behind the tip.
    fn capture(&self, i: usize, tip: &Tip, behind: [f64; 2], solver: &Solver) -> Capture {
        let (n, z) = (self.nodes[i].0 as usize, self.nodes[i].1);
        let depth = -tip.offset[2];
        let passed = match &self.bevel {
            Some(bevel) => bevel.passed(depth, z),
            None => passed(depth, z, self.above[i]),
        };
        let hold = self.progress.hold[i];
        let beside = |behind: [f64; 2]| {
            let axis = self.axis_at(tip, z);
            std::array::from_fn(|k| axis[k] - self.slope[k] * z - behind[k])
        };
        let axis = self.axis_at(tip, z);
        if let (Hold::Captured(c), true) = (hold, self.bevel.is_some()) {
            // tissue ahead of a bevel is held where that has pushed it
            let beside = if c.passed < 1.0 { beside(self.layer_shift(z, solver)) } else { c.beside };
            return Capture { beside, passed, ..c };
        }
        match hold {
            Hold::Captured(c) if c.passed > 0.0 || self.revolved => Capture { passed, ..c },
            Hold::Left(c) if self.revolved => Capture { passed, ..c },
            Hold::Captured(c) | Hold::Left(c) if hold != Hold::Left(c) || c.is_on(axis) => {
                let shift = carried(self.layer_shift(z, solver), behind);
                Capture { beside: beside(shift), passed, ..c }
            }
            _ => {
                let shift = self.layer_shift(z, solver);
                let as_it_is = hold == Hold::Indented || self.bevel.is_some();
                let shift = if as_it_is { shift } else { carried(shift, behind) };
                let since = if matches!(hold, Hold::Left(_)) { depth } else { self.entered(i, depth) };
                Capture { since, from: solver.parameters()[n], axis, beside: beside(shift), passed }
            }
        }
    }

    /// Depth of the tip at which node i began its ramp, m: where the tip was at the pose before, since the node has moved freely up
    /// to there. A node that began within the pose would stand still, or nearly so, for all of it.
    fn entered(&self, i: usize, depth: f64) -> f64 {
        let reached = self.nodes[i].1 - self.window[i];
        self.progress.tip.max(reached - EARLY * self.window[i]).min(depth)
    }

    /// How far the needle has carried what is captured at depth z sideways off the path, m.
    fn off_path(&self, tip: &Tip, z: f64, beside: [f64; 2]) -> [f64; 2] {
        let axis = self.axis_at(tip, z);
        std::array::from_fn(|k| axis[k] - self.slope[k] * z - beside[k])
    }

    /// Prescribes where a captured node goes.
    fn carry(&self, i: usize, capture: &Capture, tip: &Tip, solver: &mut Solver) {
        let (n, z) = (self.nodes[i].0 as usize, self.nodes[i].1);
        let depth = -tip.offset[2];
        let along = self.follow(i, depth);
        let off = self.off_path(tip, z, capture.beside);
        let to = [off[0] + self.slope[0] * along, off[1] + self.slope[1] * along, -along];
        let (s, from) = (capture.share(depth, self.window[i]), capture.from);
        let [x, y, z] = std::array::from_fn(|k| (1.0 - s) * from[k] + s * to[k]);
        if self.revolved {
            solver.prescribe(n, [x, y, z]);
            return;
        }
        if capture.passed >= 1.0 {
            // motion along the path takes its lateral share along, on the ramp as behind the tip
            solver.prescribe(n, [off[0] - self.slope[0] * z, off[1] - self.slope[1] * z, z]);
        } else if let Some(bevel) = &self.bevel {
            let spring = self.share[i] * Push::lead(self.shear_modulus[i] * self.above[i]);
            let back = self.progress.state.deepest - depth;
            let push = bevel.on_layer(i, capture.passed, self.above[i], back, tip.roll);
            let part = self.part(i);
            let off = std::array::from_fn(|k| off[k] + part * push[k] / spring);
            self.guide(n, off, [&from, &to], s, spring, solver);
        } else {
            let spring = self.share[i] * capture.spring(self.shear_modulus[i], self.above[i]);
            self.guide(n, off, [&from, &to], s, spring, solver);
        }
    }

    /// Node i's part of what acts on its layer: of the model's half, where it has half of the body.
    fn part(&self, i: usize) -> f64 {
        let z = self.nodes[i].1;
        let first = self.nodes.partition_point(|(_, d)| *d < z - SAME_LAYER);
        let end = self.nodes.partition_point(|(_, d)| *d <= z + SAME_LAYER);
        let of_half = if self.mirror.is_some() { 0.5 } else { 1.0 };
        of_half * self.share[i] / self.share[first..end].iter().sum::<f64>()
    }

    /// Guides a node ahead of the tip: held along the path at a share s of the way between two displacements, pulled across it to where the
    /// needle is, `off` the path.
    fn guide(&self, n: usize, off: [f64; 2], [from, to]: [&[f64; 3]; 2], s: f64, spring: f64, solver: &mut Solver) {
        if self.slope == [0.0; 2] {
            solver.guide(n, [off[0], off[1], (1.0 - s) * from[2] + s * to[2]], spring);
            return;
        }
        let axis = self.axis();
        let along = |v: &[f64; 3]| v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2];
        let off = [off[0], off[1], 0.0];
        let way = (1.0 - s) * along(from) + s * along(to) - along(&off);
        solver.guide_along(n, std::array::from_fn(|k| off[k] + way * axis[k]), spring, axis);
    }

    /// Unit vector along the path, into the sample.
    pub(super) fn axis(&self) -> [f64; 3] {
        let secant = 1.0_f64.hypot(self.slope[0]).hypot(self.slope[1]);
        [self.slope[0], self.slope[1], -1.0].map(|x| x / secant)
    }

    /// How far the path's layer of nodes at depth z has been moved sideways off the path, m: its mean lateral
    /// displacement less what motion along the path would make.
    fn layer_shift(&self, z: f64, solver: &Solver) -> [f64; 2] {
        if self.revolved {
            return [0.0; 2];
        }
        let near = 0.25 * self.layer;
        let first = self.nodes.partition_point(|(_, d)| *d < z - near);
        let layer = self.nodes[first..].iter().zip(&self.share[first..]).take_while(|((_, d), _)| *d <= z + near);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for ((n, _), share) in layer {
            let u = solver.parameters()[*n as usize];
            (0..2).for_each(|k| sum[k] += share * (u[k] + self.slope[k] * u[2]));
            count += share;
        }
        let [x, y, _] = self.mirror.map_or(sum, |mirror| mirror.within(&sum));
        if count > 0.0 { [x / count, y / count] } else { [x, y] }
    }

    /// Way x of the tip past node i, m, or 0 ahead of it; within b of the node (x + b)^2 / (4 b), so that its velocity has no jump.
    fn way_behind(&self, i: usize, x: f64) -> f64 {
        let b = if self.revolved { 0.0 } else { ONSET * self.above[i] };
        if x.abs() < b { (x + b) * (x + b) / (4.0 * b) } else { x.max(0.0) }
    }

    /// Displacement along the axis, into the sample, of node i.
    fn follow(&self, i: usize, depth: f64) -> f64 {
        let (n, z) = (&self.needle, self.nodes[i].1);
        let deepest = self.progress.state.deepest;
        let reached = match n.deformation_rule {
            DeformationRule::Incremental => n.deformation_coefficient * self.way_behind(i, deepest - z),
            DeformationRule::Absolute => n.deformation_coefficient * deepest,
        };
        // what retraction can undo ends where the node is released
        reached - n.retraction_coefficient * (deepest - depth.max(0.0)).min((deepest - z).max(0.0))
    }
}
