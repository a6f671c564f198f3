//! How the needle holds the tissue at its shaft: friction of its layers, their place sideways, cells that it fills.

use super::{Frictional, STICKING, TIP_LENGTH};
use crate::instrument::Tip;
use crate::instrument::bevel::Push;
use mtled::solver::{End, Grip, Role, Solver, Wall};

/// Share of the tip that the uppermost of its layers has at least. With less, its nodes stand between cells that the needle fills: nothing
/// holds them, they drift, and invert the cells when the tip comes back.
const LEFT_BEHIND: f64 = 0.002;

impl Frictional {
    /// Roles of the nodes, friction of the layers, push of the tip, cells that the needle fills.
    pub(super) fn hold(&mut self, tip: &Tip, solver: &mut Solver) {
        let (front, at) = (self.progress.front, self.progress.shoulder);
        let pushes = self.progress.tip > front - self.layer();
        let spread = self.shaft.spread(if pushes { self.shoulder(front) } else { at });
        let least = |layer: usize| if layer == spread.0 { LEFT_BEHIND } else { 0.0 };
        let ends = |layer: usize| (spread.0..).zip(spread.1).any(|(l, share)| l == layer && share > least(l));
        self.progress.friction = 0.0;
        let mut pressure = 0.0;
        for layer in 0..self.shaft.depths.len() {
            let above = layer.checked_sub(1).map_or(0.0, |k| self.shaft.depths[k]);
            let grip = if ends(layer) && (pushes || at > above) {
                Grip::Apart
            } else if at > above || (layer == 0 && self.progress.entered.is_some()) {
                Grip::Tied
            } else {
                Grip::Free
            };
            let mut wall = Wall { grip, spring: 0.0, limit: 0.0 };
            if grip != Grip::Free {
                wall.spring = STICKING * self.shaft.share(layer, at, |r| r.shear_modulus);
                wall.limit = self.shaft.share(layer, at, |r| r.friction);
                let slides = self.shaft.share(layer, at, |r| r.friction_coefficient);
                if slides > 0.0 {
                    // at the end of the shaft there is tissue under it, too
                    pressure = if grip == Grip::Tied { self.pressure(layer, solver) } else { pressure };
                    wall.limit += slides * pressure;
                }
                self.progress.friction += wall.limit;
            }
            solver.grip(layer, wall);
            self.guide(layer, grip, tip, solver);
        }
        let end = if pushes { self.end(spread) } else { End::default() };
        solver.set_end(end);
        self.fill(solver);
    }

    /// Force per length with which the tissue presses on the shaft at a layer, N/m: the radial part of what holds the layer's outermost
    /// ring, over the layer's length. 2 pi R p for a pressure p; where the tissue pulls, nothing.
    fn pressure(&self, layer: usize, solver: &Solver) -> f64 {
        let on = |i: usize| {
            let (f, outward) = (solver.internal_force(self.shaft.nodes[i] as usize), self.shaft.outward[i]);
            (f[0] * outward[0] + f[1] * outward[1] + f[2] * outward[2]).max(0.0)
        };
        let sum = self.shaft.wall(layer).map(on).sum::<f64>() / self.shaft.half();
        sum / self.shaft.share(layer, f64::INFINITY, |_| 1.0)
    }

    /// Where the shaft's full section ends when the tip is at a depth of the material, m.
    pub(super) fn shoulder(&self, tip: f64) -> f64 {
        let (way, length) = (tip - self.start, TIP_LENGTH * self.shaft.radius);
        self.start + (way - way.clamp(-length, length))
    }

    /// Holds a layer's nodes sideways: by a spring as far as the tip has come from the layer before, then rigidly.
    fn guide(&mut self, layer: usize, grip: Grip, tip: &Tip, solver: &mut Solver) {
        let role = if grip == Grip::Free { Role::Free } else { Role::Dragged };
        let z = self.shaft.depths[layer];
        let vertical = -self.shaft.axis[2] * z;
        let before = self.progress.grip[layer];
        self.progress.grip[layer] = grip;
        if grip == Grip::Free && before == Grip::Free {
            return;
        }
        if before == Grip::Free {
            self.progress.beside[layer] = self.axis_at(tip, vertical);
        }
        let above = self.above(layer);
        let (gap, passed) = (z - above, ((self.progress.shoulder - above) / (z - above)).clamp(0.0, 1.0));
        // tissue beside a bevel is held where that pushes it, once the full section is there
        let passed = self.bevel.as_ref().map_or(passed, |bevel| bevel.passed(self.progress.tip, z));
        let rigid = passed >= 1.0 - 1e-9;
        let mu = self.shaft.under[layer].shear_modulus;
        let axis = self.axis_at(tip, vertical);
        let (mut spring, mut off) = (f64::INFINITY, [0.0; 2]);
        if let (false, Some(bevel)) = (rigid, &self.bevel) {
            spring = Push::lead(mu * gap);
            let push = bevel.on_layer(layer, passed, gap, self.progress.front - self.progress.tip, tip.roll);
            let nodes = self.shaft.count(self.shaft.layer(layer)) / self.shaft.half();
            off = [0, 1].map(|k| push[k] / (nodes * spring));
            let shift = self.shift(layer, solver);
            self.progress.beside[layer] = [0, 1].map(|k| axis[k] - shift[k]);
        } else if !rigid {
            spring = 2.0 * mu * gap * passed / (1.0 - passed);
        }
        let beside = self.progress.beside[layer];
        let to = [axis[0] - beside[0] + off[0], axis[1] - beside[1] + off[1], 0.0];
        for place in self.shaft.layer(layer) {
            let n = self.shaft.nodes[place];
            if (before == Grip::Free) != (grip == Grip::Free) {
                solver.set_role(n as usize, role);
            }
            if grip != Grip::Free {
                solver.guide(n as usize, to, self.shaft.share_of(place) * spring);
            }
        }
    }

    /// How far a layer's nodes have gone sideways off the needle's line, m, in the mean.
    fn shift(&self, layer: usize, solver: &Solver) -> [f64; 2] {
        let (axis, places) = (self.shaft.axis, self.shaft.layer(layer));
        let sum = self.shaft.sum(places.clone(), |place| {
            let (u, share) = (solver.parameters()[self.shaft.nodes[place] as usize], self.shaft.share_of(place));
            std::array::from_fn(|k| share * (u[k] - u[2] / axis[2] * axis[k]))
        });
        [0, 1].map(|k| sum[k] * self.shaft.half() / self.shaft.count(places.clone()))
    }

    /// The needle takes the place of the tissue in the cells above its tip: of those above a layer the share that lies on it and below.
    fn fill(&mut self, solver: &mut Solver) {
        let (first, shares) = self.shaft.spread(self.progress.shoulder);
        for (layer, (points, filled)) in self.inner.iter().zip(&mut self.progress.filled).enumerate() {
            let below = (first..).zip(shares).filter(|(l, _)| *l >= layer).map(|(_, share)| share).sum::<f64>();
            let share = match (self.progress.entered, layer) {
                (None, _) | (_, 0) => 0.0,
                _ if layer <= first => 1.0,
                _ => below,
            };
            let share = match &self.bevel {
                Some(bevel) => share.min(bevel.passed(self.progress.tip, self.shaft.depths[layer])),
                None => share,
            };
            if share != *filled {
                *filled = share;
                points.iter().for_each(|&point| solver.set_active(point as usize, 1.0 - share));
            }
        }
    }

    pub(super) fn release(&mut self, solver: &mut Solver) {
        for layer in 0..self.shaft.depths.len() {
            if self.progress.grip[layer] != Grip::Free {
                self.progress.grip[layer] = Grip::Free;
                solver.grip(layer, Wall::default());
                let nodes = &self.shaft.nodes[self.shaft.layer(layer)];
                nodes.iter().for_each(|&n| solver.set_role(n as usize, Role::Free));
            }
        }
        solver.set_end(End::default());
        self.fill(solver);
    }
}
