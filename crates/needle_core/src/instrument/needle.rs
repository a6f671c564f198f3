//! Kinematic needle (source paper, section 2.1.2; definitions of our own where the paper leaves them open).
//!
//! *Indentation*: the surface nodes under the tip move with it until the largest principal Green-Lagrange strain
//! round the entry point passes the puncture strain. *Penetration*: material within the capture radius of the axis
//! and behind the tip follows the needle by the deformation coefficient C_D,
//!
//! ```text
//! incremental (default)   u_i = -C_D (d - z_i) a        z_i: depth of the node in the reference configuration
//! absolute                u_i = -C_D d a                a: axis, pointing out of the sample; lateral components 0
//! ```
//!
//! Cells whose corners are all held are filled by the needle: they carry no stress. Their strain (u_r = 0 and C_D along
//! the axis, a volume ratio of 1 - C_D) is an artefact of the kinematic rule, and its pressure would spread into the tissue.
//!
//! An oblique needle's tip is cut parallel to the top face: d and z_i are depths below that face, and the rule's
//! vertical displacement carries its lateral share along, as the path goes.
//!
//! *Lateral motion and tilt* of an inserted needle carry the captured nodes along, as a rigid needle does: each moves
//! sideways as the axis has moved at its depth since its capture. Material that the needle has pierced beside the line of
//! the path stays beside it. Tissue ahead of the tip is free to go along (see [`super::capture`]).
//!
//! *Retraction* from the deepest point d_m: u_i = C_D (d_m - z_i) - C_R (d_m - d) along the axis; a node is let go
//! when the tip has passed it on the way out.
//!
//! Before the puncture free tissue beside the tip does not pass the shaft, where the surface is pressed deep enough for that
//! ([`super::surface`]). After it the wall is out of the way: what is captured holds the tissue.
//!
//! Capture is continuous: while the tip approaches, a node is moved along the axis from its present displacement to the one that
//! the rule prescribes, on a linear ramp over the capture window that ends when the tip reaches the node. So everything behind
//! the tip follows the rule exactly, and the held length grows without a jump; in space but for the last eighth of a layer, over which a node
//! sets off, since velocities that jump make a peak of the force at each layer. A window of one layer of nodes, or a smoother
//! ramp, leaves a saw-tooth of 2 to 4 % in the force at the distance of the layers. A ramp that ends half a layer later makes
//! the force 3 % larger at a depth of 2 mm, since tissue ahead of the tip is dragged along and released late.
//! In a half plane, where nothing moves sideways, the radial displacement is on that ramp, too.

mod carry;
mod tissue;

use std::f64::consts::PI;

use super::{Event, Phase, Tip};
use crate::scene::Needle;
use mtled::cloned_field_by_field;
use mtled::mirror::Mirror;
use mtled::solver::{Role, Solver};

use super::bevel::Push;
use super::capture::{Capture, Hold};
use super::flexible::{self, Bending};
use super::puncture::{Strained, is_withdrawn};

/// Capture window that a needle has by default, in capture radii. Tissue in the window is held along the needle where the problem
/// has it free: a window of half a radius costs 1 % of the force at 1 mm, one of a whole radius 2 %.
const SHORT_WINDOW: f64 = 0.375;
/// The same in layers of nodes, where they are longer: in space, and in a half plane, whose layers are finer where the needle enters.
const LEAST_WINDOW: f64 = 1.5;
const LEAST_WINDOW_IN_HALF_PLANE: f64 = 2.0;

/// How far above the tissue the wall goes at the puncture, m.
const AWAY: f64 = 1.0;

/// Nodes whose depths differ by less are of one layer, m: rounding.
const SAME_LAYER: f64 = 1e-9;

/// Vertical length of the capture window of a node whose layer is that far from the next, m; `least`: in layers.
fn window(needle: &Needle, layer: f64, least: f64) -> f64 {
    let slope = needle.slope();
    let secant = 1.0_f64.hypot(slope[0]).hypot(slope[1]);
    match needle.capture_window.get() {
        0.0 => (SHORT_WINDOW * needle.capture_radius.get() / secant).max(least * layer),
        length => length / secant,
    }
}

/// State of the insertion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Insertion {
    /// Whether the surface is punctured.
    pub punctured: bool,
    /// Deepest tip depth below the top face since the puncture, m.
    pub deepest: f64,
}

/// Nodes along the needle's path, and what each is doing.
#[derive(Clone, Debug)]
pub struct NeedlePath {
    /// Node and its reference depth below the top, by depth.
    nodes: Vec<(u32, f64)>,
    needle: Needle,
    /// Lateral way of the path per metre of depth.
    slope: [f64; 2],
    /// Vertical distance between the layers of nodes, m.
    layer: f64,
    /// Vertical distance of each node's layer from the one above, m; of a half plane, where nothing moves sideways, the largest.
    above: Vec<f64>,
    /// Vertical length of each node's capture window, m.
    window: Vec<f64>,
    /// Of the tissue at each node, Pa.
    shear_modulus: Vec<f64>,
    /// Integration points within two spacings of the entry point.
    watched: Vec<u32>,
    /// Integration points in cells all of whose corners are on the path, with the corners' places in `nodes`.
    inner: Vec<(u32, [u32; 4])>,
    /// m; see [`NeedlePath::effective_radius`].
    effective_radius: f64,
    /// Whether the nodes are those of a half plane, whose radial displacement is no sideways motion.
    revolved: bool,
    /// Plane of symmetry of a model of half the body.
    mirror: Option<Mirror>,
    /// Share of each node's tissue that the model has: half of it on that plane.
    share: Vec<f64>,
    /// How far each node is held along the needle, 0 to 1: scratch memory of [`NeedlePath::fill`].
    along: Vec<f64>,
    /// Push of a bevel at each node.
    bevel: Option<Push>,
    progress: Progress,
}

cloned_field_by_field! {
    /// What an insertion changes: copied in one line, with no allocation.
    #[derive(Debug)]
    struct Progress {
        /// What each node of the path is doing.
        hold: Vec<Hold>,
        /// Share of each of the inner points that the needle fills.
        filled: Vec<f64>,
        state: Insertion,
        /// What pressing has done to the surface so far.
        strained: Strained,
        withdrawn: bool,
        /// Depth of the tip below the top face at the pose before, m.
        tip: f64,
        /// Roll of the shaft then, rad.
        roll: f64,
        /// The shaft, if it bends.
        shaft: Option<Bending>,
    }
}

impl NeedlePath {
    /// A path of a length in m through some of `count` nodes, each with its reference depth in m. `watched` are the integration points
    /// whose strain decides about the puncture, `cells` the cell corners and the volume in m³ of every integration point.
    #[must_use]
    pub(crate) fn new(
        mut nodes: Vec<(u32, f64)>,
        count: usize,
        needle: Needle,
        length: f64,
        layer: f64,
        watched: Vec<u32>,
        cells: impl Iterator<Item = ([u32; 4], f64)>,
    ) -> Self {
        nodes.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let hold = vec![Hold::Free; nodes.len()];
        let state = Insertion { punctured: false, deepest: 0.0 };
        let mut place: Vec<Option<u32>> = vec![None; count];
        for (i, (n, _)) in nodes.iter().enumerate() {
            place[*n as usize] = Some(i as u32);
        }
        let slope = needle.slope();
        let secant = 1.0_f64.hypot(slope[0]).hypot(slope[1]);
        let end = length / secant * (1.0 + 1e-9);
        let above = vec![layer; nodes.len()];
        let window = vec![window(&needle, layer, LEAST_WINDOW); nodes.len()];
        let mut inner = Vec::new();
        let mut filled = 0.0;
        for (point, (c, volume)) in (0u32..).zip(cells) {
            if let [Some(a), Some(b), Some(c), Some(d)] = c.map(|n| place[n as usize]) {
                inner.push((point, [a, b, c, d]));
                let on_path = [a, b, c, d].iter().all(|&c| nodes[c as usize].1 <= end);
                filled += if on_path { volume } else { 0.0 };
            }
        }
        let effective_radius = (filled / (PI * length)).sqrt();
        Self {
            share: vec![1.0; nodes.len()],
            along: vec![0.0; nodes.len()],
            shear_modulus: vec![0.0; nodes.len()],
            mirror: None,
            nodes,
            needle,
            slope,
            layer,
            above,
            window,
            watched,
            progress: Progress {
                hold,
                filled: vec![0.0; inner.len()],
                state,
                strained: Strained::default(),
                withdrawn: false,
                tip: 0.0,
                roll: 0.0,
                shaft: None,
            },
            bevel: None,
            inner,
            effective_radius,
            revolved: false,
        }
    }

    /// The path of another needle, which differs from this one in its coefficients alone.
    #[must_use]
    pub(crate) fn with(self, needle: Needle) -> Self {
        Self { needle, ..self }
    }

    /// The same path of a needle whose shaft bends or whose tip is bevelled, if it is: in a body whose top is at a height, m, and whose tissue is
    /// cut with a force, N, at a depth, m. In a half plane nothing is pushed aside.
    #[must_use]
    pub(crate) fn bent(mut self, top: f64, cutting: impl Fn(f64) -> f64) -> Self {
        let (needle, nodes) = (self.needle, &self.nodes);
        self.progress.shaft = if self.revolved { None } else { Bending::new(&needle, top, nodes.len()) };
        let places = nodes.iter().map(|(_, z)| cutting(*z));
        self.bevel = if self.revolved { None } else { Push::new(&needle, self.layer, places) };
        self
    }

    /// The shaft, if it bends.
    #[must_use]
    pub(crate) fn shaft(&self) -> Option<&Bending> {
        self.progress.shaft.as_ref()
    }

    /// Whether it is one of a half plane.
    #[must_use]
    pub(crate) const fn is_revolved(&self) -> bool {
        self.revolved
    }

    /// Vertical distance between the layers of nodes, m.
    #[must_use]
    pub(crate) const fn layer(&self) -> f64 {
        self.layer
    }

    /// The same path in a half plane: its nodes are rings, which never move sideways.
    #[must_use]
    pub(crate) fn revolved(self) -> Self {
        let window = vec![window(&self.needle, self.layer, LEAST_WINDOW_IN_HALF_PLANE); self.nodes.len()];
        Self { revolved: true, window, ..self }
    }

    /// The same path where the distance between its layers grows with depth: each node's window is as long as the distance from its layer
    /// to the one above asks for, unless the needle says how long it is.
    #[must_use]
    pub(crate) fn graded(self) -> Self {
        let mut depths: Vec<f64> = self.nodes.iter().map(|(_, z)| *z).collect();
        depths.dedup_by(|a, b| (*a - *b).abs() < SAME_LAYER);
        let above = |z: f64| {
            let below = depths.partition_point(|d| *d < z - SAME_LAYER).max(1);
            depths.get(below).map_or(self.layer, |d| d - depths[below - 1]).min(self.layer)
        };
        let above: Vec<f64> = self.nodes.iter().map(|(_, z)| above(*z)).collect();
        let least = if self.revolved { LEAST_WINDOW_IN_HALF_PLANE } else { LEAST_WINDOW };
        let window = above.iter().map(|layer| window(&self.needle, *layer, least)).collect();
        Self { window, above: if self.revolved { self.above } else { above }, ..self }
    }

    /// The same path in the half of a body beside a plane of symmetry, of whose nodes these are the places in m.
    #[must_use]
    pub(crate) fn mirrored(mut self, mirror: Mirror, points: &[[f64; 3]]) -> Self {
        let on_plane = mirror.holds(points);
        self.share = self.nodes.iter().map(|(n, _)| if on_plane[*n as usize] { 0.5 } else { 1.0 }).collect();
        self.mirror = Some(mirror);
        // of a rod of which the half is in these cells
        self.effective_radius *= std::f64::consts::SQRT_2;
        self
    }

    /// The same path in tissue of a shear modulus in Pa at a depth in m, which sets how the hold grows between two layers of nodes.
    #[must_use]
    pub(crate) fn in_tissue(self, shear_modulus: impl Fn(f64) -> f64) -> Self {
        Self { shear_modulus: self.nodes.iter().map(|(_, z)| shear_modulus(*z)).collect(), ..self }
    }

    /// Radius of the straight rod, as long as the path, that has the volume of the cells that the needle fills, m:
    /// sqrt(V / (pi l)). It is under the capture radius by what the cloud doesn't resolve; 0 if it resolves nothing.
    #[must_use]
    pub fn effective_radius(&self) -> f64 {
        self.effective_radius
    }

    /// Present state of the insertion.
    #[must_use]
    pub(crate) fn insertion(&self) -> Insertion {
        self.progress.state
    }

    pub(super) fn impose(&mut self, straight: &Tip, solver: &mut Solver) -> (Phase, Option<Event>) {
        let tip = &self.bend(straight, solver);
        let answered = self.go_to(tip, solver);
        (self.progress.tip, self.progress.roll) = (-tip.offset[2], tip.roll);
        answered
    }

    /// Lets the shaft bend, if it does, and says where its tip is.
    fn bend(&mut self, straight: &Tip, solver: &Solver) -> Tip {
        let Some(mut shaft) = self.progress.shaft.take() else { return *straight };
        shaft.advance(straight, self.held(solver));
        let tip = shaft.tip(straight);
        self.progress.shaft = Some(shaft);
        tip
    }

    /// What holds the shaft: layers of nodes with the tissue's force on each.
    fn held<'a>(&'a self, solver: &'a Solver) -> impl Iterator<Item = flexible::Held> + 'a {
        let (mut first, mut count) = (0, 0);
        std::iter::from_fn(move || {
            let (_, depth) = *self.nodes.get(first)?;
            let end = first + self.nodes[first..].partition_point(|(_, z)| *z < depth + SAME_LAYER);
            let mut force = [0.0; 3];
            let mut holds = false;
            for i in first..end {
                if let Hold::Captured(_) | Hold::Indented = self.progress.hold[i] {
                    holds = true;
                    let f = solver.internal_force(self.nodes[i].0 as usize);
                    (0..3).for_each(|k| force[k] -= f[k]);
                }
            }
            let whole = self.mirror.map_or(force, |mirror| mirror.within(&force).map(|x| 2.0 * x));
            let (whole, holds_aside) = self.beside_bevel(first, whole);
            let (length, friction) = (self.above[first], 0.0);
            let shear = if holds_aside { self.shear_modulus[first] * length } else { 0.0 };
            first = end;
            let layer = count;
            count += 1;
            Some(holds.then_some(flexible::Held { layer, depth, force: whole, shear, length, friction }))
        })
        .flatten()
    }

    /// Force of a layer on the needle, N: beside a bevel that has not passed it, across the needle, what it is pushed with, since tissue that has yet
    /// to follow the push doesn't bear all of it. And whether the layer holds the needle aside.
    fn beside_bevel(&self, i: usize, force: [f64; 3]) -> ([f64; 3], bool) {
        let Hold::Captured(Capture { passed, .. }) = self.progress.hold[i] else { return (force, true) };
        let Some(bevel) = self.bevel.as_ref().filter(|_| passed < 1.0) else { return (force, true) };
        let back = self.progress.state.deepest - self.progress.tip;
        let push = bevel.on_layer(i, passed, self.above[i], back, self.progress.roll);
        (bevel.on_needle(force, self.axis(), push), false)
    }

    /// Lateral place of the needle's axis at a reference depth, m.
    fn axis_at(&self, tip: &Tip, depth: f64) -> [f64; 2] {
        self.progress.shaft.as_ref().map_or_else(|| tip.axis_at(depth), |shaft| shaft.axis_at(depth))
    }

    fn go_to(&mut self, tip: &Tip, solver: &mut Solver) -> (Phase, Option<Event>) {
        let depth = -tip.offset[2]; // the nodes' depths are vertical
        if !self.progress.state.punctured {
            solver.move_surface(tip.offset);
            if depth <= 0.0 {
                self.release_all(solver);
                self.progress.strained = Strained::default();
                return (Phase::Approach, None);
            }
            let strain = self.strain(solver);
            self.progress.strained.reached(strain);
            if strain < self.needle.puncture_strain {
                self.indent(tip, solver);
                self.progress.strained.pressed(tip.depth);
                return (Phase::Indentation, None);
            }
            // seen at the pose after the one that did it
            let depth_m = self.progress.strained.passed(self.needle.puncture_strain);
            self.progress.state = Insertion { punctured: true, deepest: depth };
            solver.move_surface([0.0, 0.0, AWAY]);
            self.penetrate(tip, solver);
            return (Phase::Penetration, Some(Event::Puncture { depth_m, region: 0 }));
        }
        solver.move_surface([0.0, 0.0, AWAY]);
        self.progress.state.deepest = self.progress.state.deepest.max(depth);
        self.progress.withdrawn = is_withdrawn(self.progress.withdrawn, self.progress.state.deepest - depth);
        self.penetrate(tip, solver);
        if depth <= 0.0 {
            // out of the tissue: the next insertion follows the same channel from the surface
            self.progress.state.deepest = 0.0;
        }
        let phase = match (self.progress.withdrawn, depth > 0.0) {
            (_, false) => Phase::Approach,
            (true, true) => Phase::Retraction,
            (false, true) => Phase::Penetration,
        };
        (phase, None)
    }

    pub(super) fn take_over(&mut self, other: &Self) {
        self.progress.clone_from(&other.progress);
    }

    pub(super) fn return_to(&mut self, earlier: &Self, solver: &mut Solver) {
        self.take_over(earlier);
        for (hold, (n, _)) in self.progress.hold.iter().zip(&self.nodes) {
            solver.set_role(*n as usize, self.role(hold));
        }
        for ((point, _), filled) in self.inner.iter().zip(&self.progress.filled) {
            solver.set_active(*point as usize, 1.0 - filled);
        }
    }

    pub(super) fn reset(&mut self, solver: &mut Solver) {
        self.release_all(solver);
        // a solver that was reset has all cells filled with tissue again
        self.progress.filled.fill(0.0);
        self.progress.state = Insertion { punctured: false, deepest: 0.0 };
        self.progress.strained = Strained::default();
        self.progress.withdrawn = false;
        (self.progress.tip, self.progress.roll) = (0.0, 0.0);
        if let Some(shaft) = &mut self.progress.shaft {
            shaft.reset();
        }
    }

    fn release_all(&mut self, solver: &mut Solver) {
        for (hold, (n, _)) in self.progress.hold.iter_mut().zip(&self.nodes) {
            if *hold != Hold::Free {
                *hold = Hold::Free;
                solver.set_role(*n as usize, Role::Free);
            }
        }
    }

    /// The surface moves with the tip.
    fn indent(&mut self, tip: &Tip, solver: &mut Solver) {
        for (hold, (n, z)) in self.progress.hold.iter_mut().zip(&self.nodes) {
            if *z > 1e-9 {
                break;
            }
            if *hold == Hold::Free {
                *hold = Hold::Indented;
                solver.set_role(*n as usize, Role::Instrument);
            }
            solver.prescribe(*n as usize, tip.offset);
        }
    }

    /// What holds a node of the path.
    fn role(&self, hold: &Hold) -> Role {
        match hold {
            Hold::Free | Hold::Left(_) => Role::Free,
            Hold::Captured(c) if !self.revolved && c.passed < 1.0 => Role::Guided,
            Hold::Indented | Hold::Captured(_) => Role::Instrument,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::*;
    use crate::scene::{InstrumentKind, Metres, Scene};

    #[test]
    fn a_window_follows_the_distance_between_its_layers() {
        let InstrumentKind::Needle(needle) = Scene::preset("needle_insertion").unwrap().instrument.unwrap().kind else {
            panic!("a needle")
        };
        // two nodes of one layer among them
        let depths = [0.0, 1.5e-4, 1.5e-4, 3.1e-4, 5.0e-4, 7.5e-4];
        let nodes: Vec<_> = (0u32..).zip(depths).collect();
        let path =
            |needle| NeedlePath::new(nodes.clone(), 6, needle, 1e-3, 2.5e-4, Vec::new(), std::iter::empty()).revolved();
        let close = |windows: &[f64], wanted: [f64; 6]| windows.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(&path(needle).window, [5e-4; 6]), "even layers");
        let graded = path(needle).graded().window;
        assert!(close(&graded, [3e-4, 3e-4, 3e-4, 3.2e-4, 3.8e-4, 5e-4]), "{graded:?}");
        let given = Needle { capture_window: Metres(2e-4), ..needle };
        assert!(close(&path(given).graded().window, [2e-4; 6]), "the needle says how long");
    }
}
