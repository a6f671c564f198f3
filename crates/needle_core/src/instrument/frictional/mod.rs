//! Needle with friction along its shaft, cutting at its tip, and puncture.
//!
//! The front is the depth c of the material to which the needle has cut; nothing closes it again. The tip stands at the front and pushes
//! on it, or within the channel above it, which the shaft alone rubs along.
//!
//! ```text
//! shaft   tissue sticks to it until it would carry more than the friction per length of its region, then slips
//! tip     pushes until the cutting force of what lies ahead; then the front goes on. Never pulls.
//! entry   the front stays at a membrane until the tip, at rest, pushes with the puncture force of the region behind it
//! ```
//!
//! How forces act on nodes is [`mtled::solver`]'s drag. Tissue behind the tip keeps its distance from the axis, as with the kinematic
//! needle, and cells within the capture radius carry no stress there. The tip is half as long as the shaft's radius: the shaft's full
//! section, where the tip pushes and from where on the shaft rubs, follows the front at that distance. A needle that is in place from the
//! start has its full section there; it cuts, or is withdrawn, by the length of the tip before that moves.

mod face;
mod front;
mod hold;
mod shaft;

pub use shaft::Resistance;
pub use shaft::Shaft;
pub(crate) use shaft::start_and_slow;

use super::bevel::Push;
use super::flexible::{self, Bending};
use super::puncture::is_withdrawn;
use super::{Event, Phase, Tip};
use crate::scene::{Dimension, Instrument, InstrumentKind, Needle, Scene};
use mtled::cloned_field_by_field;
use mtled::cloud::Axis;
use mtled::solver::{Grip, Model, Role, Solver};

/// Stiffness of sticking over the shear modulus: force per length of shaft and displacement. Forces are 1.8 % below those of a rigid
/// bond, and slip begins after some micrometres rather than at once.
const STICKING: f64 = 200.0;
/// Stiffness of the tip at a membrane over that with which it cuts: next to rigid.
const TIP_STIFFNESS: f64 = 50.0;
/// Length of the tip over the radius of the shaft.
const TIP_LENGTH: f64 = 0.5;
/// Way of the needle, or of the tissue past it, on which the tissue behind its tip becomes flat again, over the radius of the shaft.
const FLATTENING: f64 = 0.06;
/// How far a ring of the tip may be behind the mean, in radii.
const LAG: f64 = 1.0;

/// A needle and what it holds.
#[derive(Clone, Debug)]
pub(crate) struct Frictional {
    shaft: Shaft,
    /// Integration points in cells of the path, by the deepest layer of their corners.
    inner: Vec<Vec<u32>>,
    /// Depth at which the needle is in place at first, m.
    start: f64,
    /// Speed up to which cutting takes the same force, m/s.
    slow: f64,
    /// sqrt(V / (pi l)) of the cells that the needle fills, m.
    effective_radius: f64,
    /// Push of a bevel at each layer.
    bevel: Option<Push>,
    progress: Progress,
}

cloned_field_by_field! {
    /// What an insertion changes.
    #[derive(Debug)]
    struct Progress {
        /// c: depth of the material to which the needle has cut, m.
        front: f64,
        /// Deepest layer under which the front has entered; `None`: the surface is whole.
        entered: Option<usize>,
        /// Depth of the material at the tip, m.
        tip: f64,
        /// Depth of the material to which the shaft's full section reaches, m.
        shoulder: f64,
        grip: Vec<Grip>,
        /// Where the needle's axis was beside a layer's tissue when the tip came to it, m.
        beside: Vec<[f64; 2]>,
        /// Share that the needle fills of the inner points of each layer.
        filled: Vec<f64>,
        /// Depth of the tip, m.
        depth: f64,
        deepest: f64,
        /// Time that the present move takes, s; infinite where it is not known.
        elapsed: f64,
        withdrawn: bool,
        /// Push of the tip that breaks a membrane, N, until the next advance.
        broken: Option<f64>,
        /// Force at a puncture from which the tissue springs back, N, and looks at that so far.
        released: Option<(f64, u32)>,
        /// Friction of the whole shaft where all of it slips, N.
        friction: f64,
        /// Sign of the friction with which the whole shaft slips, 0 where it sticks.
        slips: f64,
        /// Roll of the shaft, rad.
        roll: f64,
        /// The shaft, if it bends.
        bending: Option<Bending>,
    }
}

impl Frictional {
    /// A needle along a shaft of layers. `[start, slow]`: depth at which it is in place at first, m, and speed up to which cutting takes
    /// the same force, m/s; `cells`: corners and volume of each integration point's cell.
    #[must_use]
    pub(crate) fn new(
        shaft: Shaft,
        [start, slow]: [f64; 2],
        length: f64,
        cells: impl Iterator<Item = ([u32; 4], f64)>,
    ) -> Self {
        let mut layer_of = std::collections::BTreeMap::new();
        for (i, n) in shaft.nodes.iter().enumerate() {
            layer_of.insert(*n, shaft.layer_of(i));
        }
        let (mut inner, mut volume) = (vec![Vec::new(); shaft.depths.len()], 0.0);
        for (point, (corners, v)) in (0u32..).zip(cells) {
            let layers = corners.map(|n| layer_of.get(&n).copied());
            if let [Some(a), Some(b), Some(c), Some(d)] = layers {
                let deepest = a.max(b).max(c).max(d);
                inner[deepest].push(point);
                volume += if shaft.depths[deepest] <= length * (1.0 + 1e-9) { v } else { 0.0 };
            }
        }
        let layers = shaft.depths.len();
        let progress = Progress {
            front: 0.0,
            entered: None,
            tip: 0.0,
            shoulder: 0.0,
            grip: vec![Grip::Free; layers],
            beside: vec![[0.0; 2]; layers],
            filled: vec![0.0; layers],
            depth: 0.0,
            deepest: 0.0,
            elapsed: f64::INFINITY,
            withdrawn: false,
            broken: None,
            released: None,
            friction: 0.0,
            slips: 0.0,
            roll: 0.0,
            bending: None,
        };
        let effective_radius = (volume / (shaft.half() * std::f64::consts::PI * length)).sqrt();
        Self { shaft, inner, start, slow, effective_radius, bevel: None, progress }
    }

    /// The same needle with the coefficients of a scene: `region` of a point on its axis, which meets the body's top at a height, m.
    #[must_use]
    pub(crate) fn in_tissue(
        self,
        scene: &Scene,
        instrument: &Instrument,
        top: f64,
        region: impl Fn([f64; 3]) -> u8,
    ) -> Self {
        let InstrumentKind::Needle(needle) = &instrument.kind else { return self };
        let axis = Axis { entry: instrument.entry.map(|m| m.get()), slope: needle.slope() };
        let [start, slow] = start_and_slow(scene);
        let shaft = self.shaft.in_tissue(scene, needle, &axis, top, region);
        Self { shaft, start, slow, ..self }.bent(scene, needle, top)
    }

    /// The same needle with a shaft that bends or a tip that is bevelled, if it is, in a body whose top is at a height, m. In a half plane nothing is
    /// pushed aside.
    #[must_use]
    pub(crate) fn bent(mut self, scene: &Scene, needle: &Needle, top: f64) -> Self {
        if scene.dimension().dimension == Dimension::Axisymmetric {
            return self;
        }
        self.progress.bending = Bending::new(needle, top, self.shaft.depths.len());
        self.bevel = Push::new(needle, self.layer(), self.shaft.under.iter().map(|under| under.cutting));
        self
    }

    /// The shaft, if it bends.
    #[must_use]
    pub(crate) fn bending(&self) -> Option<&Bending> {
        self.progress.bending.as_ref()
    }

    /// Lets the shaft bend, if it does, and says where its tip is.
    fn bend(&mut self, straight: &Tip, solver: &Solver) -> Tip {
        let Some(mut bending) = self.progress.bending.take() else { return *straight };
        let cosine = -self.shaft.axis[2];
        let held = (0..self.shaft.depths.len()).filter(|layer| self.progress.grip[*layer] != Grip::Free).map(|layer| {
            let depth = cosine * self.shaft.depths[layer];
            let on_tissue = |place: usize| solver.internal_force(self.shaft.nodes[place] as usize);
            let force = self.shaft.sum(self.shaft.layer(layer), on_tissue).map(|f| -f);
            let length = self.shaft.share(layer, self.progress.shoulder, |_| 1.0);
            let friction = self.shaft.share(layer, self.progress.shoulder, |r| r.friction);
            let friction = if length > 0.0 { friction / length } else { 0.0 };
            if let Some(bevel) = &self.bevel {
                let [tip, front, z] = [self.progress.tip, self.progress.front, self.shaft.depths[layer]];
                let p = bevel.passed(tip, z);
                let push = bevel.on_layer(layer, p, z - self.above(layer), front - tip, self.progress.roll);
                if p < 1.0 {
                    return flexible::Held {
                        layer,
                        depth,
                        force: bevel.on_needle(force, self.shaft.axis, push),
                        shear: 0.0,
                        length,
                        friction,
                    };
                }
            }
            let shear = self.shaft.share(layer, f64::INFINITY, |r| r.shear_modulus);
            flexible::Held { layer, depth, force, shear, length, friction }
        });
        bending.advance(straight, held);
        let tip = bending.tip(straight);
        self.progress.roll = tip.roll;
        self.progress.bending = Some(bending);
        tip
    }

    /// Depth of the layer above one, m; of the uppermost a little less than its own.
    fn above(&self, layer: usize) -> f64 {
        layer.checked_sub(1).map_or(self.shaft.depths[layer] - 1e-6, |k| self.shaft.depths[k])
    }

    /// Lateral place of the needle's axis at a depth below the top, m.
    fn axis_at(&self, tip: &Tip, vertical: f64) -> [f64; 2] {
        self.progress.bending.as_ref().map_or_else(|| tip.axis_at(vertical), |shaft| shaft.axis_at(vertical))
    }

    /// As [`super::NeedlePath::effective_radius`].
    #[must_use]
    pub(crate) fn effective_radius(&self) -> f64 {
        self.effective_radius
    }

    /// Deepest point of the insertion, m; `None` before the surface is punctured.
    #[must_use]
    pub(crate) fn deepest(&self) -> Option<f64> {
        self.progress.entered.map(|_| self.progress.deepest)
    }

    /// Depth of the material to which the needle has cut, m.
    #[must_use]
    pub(crate) fn front(&self) -> f64 {
        self.progress.front
    }

    /// Where material that lay at a depth is now, m: as the tissue around the needle has gone.
    #[must_use]
    pub(crate) fn deformed(&self, depth: f64, solver: &Solver) -> f64 {
        let (layer, share) = self.shaft.place(depth);
        depth + (1.0 - share) * solver.of_layer(layer) + share * solver.of_layer(layer + 1)
    }

    /// Deformation coefficient: way of the tissue along the shaft over that of the needle since its tip came to it, mean over the
    /// shaft's length by the needle's way. `None` while the needle is not going in.
    #[must_use]
    pub(crate) fn deformation_coefficient(&self, solver: &Solver) -> Option<f64> {
        let p = &self.progress;
        p.entered.filter(|_| !p.withdrawn)?;
        let (mut tissue, mut needle) = (0.0, 0.0);
        for (layer, z) in self.shaft.depths.iter().enumerate() {
            let length = self.shaft.share(layer, p.shoulder, |_| 1.0);
            tissue += length * solver.of_layer(layer);
            needle += length * (p.depth - z.max(self.start));
        }
        (needle > 0.0).then(|| tissue / needle)
    }

    /// Region that the tip is in, as [`Resistance::region`]; `None` before the puncture.
    #[must_use]
    pub(crate) fn region(&self) -> Option<u8> {
        self.progress.entered?;
        let (layer, _) = self.shaft.place(self.progress.tip);
        Some(self.shaft.under[layer].region)
    }

    /// R, m.
    #[must_use]
    pub(crate) fn radius(&self) -> f64 {
        self.shaft.radius
    }

    /// Distance between layers of nodes, m.
    #[must_use]
    pub(crate) fn layer(&self) -> f64 {
        self.shaft.depths[1] - self.shaft.depths[0]
    }

    /// The model with this needle's rod.
    #[must_use]
    pub(crate) fn rod(&self, model: Model) -> Model {
        let Shaft { nodes, rings, areas, axis, radius, .. } = &self.shaft;
        model.with_rod(*axis, nodes.clone(), rings, areas.clone(), FLATTENING * radius)
    }

    /// Whether the needle comes into a region at a depth of the material in m, or doesn't come so deep at all.
    #[must_use]
    pub(crate) fn meets(&self, depth: f64, region: u8) -> bool {
        let Shaft { depths, under, .. } = &self.shaft;
        let begins = |k: usize| under[k].region == region && (k == 0 || under[k - 1].region != region);
        let near = |k: usize| (depths[k] - depth).abs() <= self.layer();
        depths.last().is_some_and(|deepest| depth >= *deepest) || (0..depths.len()).any(|k| begins(k) && near(k))
    }

    /// Depth at which the needle is in place at first, m.
    #[must_use]
    pub(crate) fn start(&self) -> f64 {
        self.start
    }

    /// Puts a needle that starts in the tissue there, with the tissue at rest.
    pub(crate) fn place(&mut self, solver: &mut Solver) {
        if self.start <= 0.0 {
            return;
        }
        let p = &mut self.progress;
        (p.front, p.tip, p.shoulder, p.deepest) = (self.start, self.start, self.start, self.start);
        p.entered = Some(self.shaft.place(self.start).0);
        solver.drag_from(self.start);
        solver.place_end(self.start);
        let axis = self.shaft.axis;
        let tip = Tip {
            offset: axis.map(|a| self.start * a),
            depth: self.start,
            slope: [axis[0] / axis[2], axis[1] / axis[2]],
            roll: 0.0,
        };
        self.hold(&tip, solver);
    }

    /// Says how long the next moves take, each, in s: `None` where that is not known, which counts as slow.
    pub(crate) fn elapse(&mut self, each_s: Option<f64>) {
        self.progress.elapsed = each_s.filter(|t| *t > 0.0).unwrap_or(f64::INFINITY);
    }

    pub(super) fn impose(&mut self, straight: &Tip, solver: &mut Solver) -> (Phase, Option<Event>) {
        let tip = &self.bend(straight, solver);
        let depth = (0..3).map(|k| tip.offset[k] * self.shaft.axis[k]).sum::<f64>();
        solver.move_surface(tip.offset);
        let event = self.advance_front(solver);
        self.progress.tip = self.material_at(depth, solver);
        self.progress.shoulder = self.shoulder(self.progress.tip);
        if self.progress.tip < 0.0 || tip.offset[2] >= 0.0 {
            self.release(solver);
            solver.drag_from(depth);
            self.progress.deepest = 0.0;
            return (Phase::Approach, event);
        }
        self.progress.depth = depth;
        self.progress.deepest = self.progress.deepest.max(depth);
        self.progress.withdrawn = is_withdrawn(self.progress.withdrawn, self.progress.deepest - depth);
        let event = event.or_else(|| self.enter_without_membrane(tip.depth)).or_else(|| self.slip(tip.depth, solver));
        self.hold(tip, solver);
        solver.drag_to(depth);
        let phase = match (self.progress.entered, self.progress.withdrawn) {
            (None, _) => Phase::Indentation,
            (Some(_), true) => Phase::Retraction,
            (Some(_), false) => Phase::Penetration,
        };
        (phase, event)
    }

    /// Depth of the material at a depth of the tip: within the channel where z + w(z) is that; at most the front, negative above the
    /// surface.
    fn material_at(&self, depth: f64, solver: &Solver) -> f64 {
        let (front, z) = (self.progress.front, &self.shaft.depths);
        let mut above = (0.0, solver.of_layer(0));
        if depth < above.1 {
            return depth - above.1;
        }
        for k in 1..z.len() {
            let now = (z[k], z[k] + solver.of_layer(k));
            if now.1 > depth {
                let share = ((depth - above.1) / (now.1 - above.1)).clamp(0.0, 1.0);
                return (above.0 + share * (now.0 - above.0)).min(front);
            }
            if now.0 >= front {
                return front;
            }
            above = now;
        }
        front
    }

    pub(super) fn take_over(&mut self, other: &Self) {
        self.progress.clone_from(&other.progress);
    }

    pub(super) fn return_to(&mut self, earlier: &Self, solver: &mut Solver) {
        self.take_over(earlier);
        for (i, &n) in self.shaft.nodes.iter().enumerate() {
            let grip = self.progress.grip[self.shaft.layer_of(i)];
            solver.set_role(n as usize, if grip == Grip::Free { Role::Free } else { Role::Dragged });
        }
        for (points, filled) in self.inner.iter().zip(&self.progress.filled) {
            points.iter().for_each(|&point| solver.set_active(point as usize, 1.0 - filled));
        }
    }

    pub(super) fn reset(&mut self, solver: &mut Solver) {
        let p = &mut self.progress;
        (p.front, p.entered, p.tip, p.shoulder, p.deepest, p.withdrawn) = (0.0, None, 0.0, 0.0, 0.0, false);
        // a solver that was reset has all cells filled with tissue again
        p.filled.fill(0.0);
        (p.broken, p.released) = (None, None);
        (p.friction, p.slips, p.roll, p.depth, p.elapsed) = (0.0, 0.0, 0.0, 0.0, f64::INFINITY);
        if let Some(shaft) = &mut self.progress.bending {
            shaft.reset();
        }
        self.release(solver);
        self.place(solver);
    }
}
