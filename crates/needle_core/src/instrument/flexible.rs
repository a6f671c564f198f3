//! A shaft that bends: an elastic rod ([`elastic_rod`]), clamped in the driver, that the tissue holds along its length.
//!
//! Rod and tissue take turns, on each twentieth of a radius of travel. The tissue holds the rod with the force f_i of each layer of nodes
//! that the needle holds, at the shape x_old that those nodes were moved to; how that force changes with the shape is taken to be a foundation,
//!
//! ```text
//! f_i(x) = f_i - k_i P (x - x_old - v_i d)    k_i = c mu h    h: length of the layer along the shaft, P: across the needle
//! ```
//!
//! so the rod finds its next shape beside springs. v_i is how far the shaft has gone sideways at the layer per travel of the driver, learnt as it goes,
//! and d the travel since: a needle that goes on as it did has no lag. Where rod and tissue rest, x = x_old, and k_i has no part in it: it only says how
//! fast they come there. c is some 20 times what a rigid rod in a wide block has (4 pi / ln of some hundred), since tissue that has just been moved
//! resists by its inertia as well: with 20 the shape oscillates.
//!
//! Torsion: friction t_i h of each layer against a shaft that is turned twists it by
//!
//! ```text
//! T = sum_i t_i h_i s_i / (G J)      s_i: arc length from the clamp to the layer
//! ```
//!
//! The tip stands until the driver has turned by T, and follows it by that much (exact where friction is the same all along; Reed, Okamura, Cowan,
//! "Modeling and control of needles with torsional friction", IEEE Trans. Biomed. Engng 56:2905, 2009). Friction has one direction: of a shaft that goes along its
//! axis by dz while it turns by dphi, the share R dphi / |(R dphi, dz)| of it resists the turn. So a needle that goes on lets the twist go.
//!
//! Material that the tip has passed keeps its place at the shaft ([`super::needle`], [`super::frictional`]): the channel is where the tip has been, not
//! the scene's straight path. A layer of the path's nodes stands for tissue at the channel, however far that is from the path.

use std::f64::consts::{PI, TAU};

use crate::scene::Needle;
use elastic_rod::{Clamp, Force, Rod, Spring};
use mtled::cloned_field_by_field;

use super::Tip;

/// Segments of the rod.
const SEGMENTS: usize = 80;
/// c of k_i.
const FOUNDATION: f64 = 60.0;
/// Travel of the driver on which the rate is learnt, over the radius of the needle.
const LEARNING: f64 = 0.5;
/// Travel between two looks at the tissue's force over the radius of the needle, and most poses between two: tissue that has just been moved needs
/// some steps before its force says how it holds the needle.
const LOOKS_APART: f64 = 0.05;
const MOST_POSES: u32 = 8;
/// Stiffness of the template's hole over E I / L^3 of the rod: next to rigid.
const TEMPLATE: f64 = 1e8;
/// Shapes that differ by less are the same, m: what no step of the tissue is worth.
const SAME_SHAPE: f64 = 1e-9;

/// What holds the shaft at one layer of nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    /// Number of the layer.
    pub layer: usize,
    /// Reference depth of the layer under the undeformed top, m.
    pub depth: f64,
    /// Force of the tissue on the needle, N.
    pub force: [f64; 3],
    /// mu h, N/m; 0 where tissue goes along with a force and not with the shaft.
    pub shear: f64,
    /// h, m.
    pub length: f64,
    /// Friction per length, N/m: t over R of a needle whose key does not say it.
    pub friction: f64,
}

/// A list whose copies have its room, so that they never grow while the twin steps.
#[derive(Debug)]
struct Reserved<T>(Vec<T>);

impl<T: Copy> Clone for Reserved<T> {
    fn clone(&self) -> Self {
        let mut copy = Vec::with_capacity(self.0.capacity());
        copy.extend_from_slice(&self.0);
        Self(copy)
    }

    fn clone_from(&mut self, other: &Self) {
        self.0.clone_from(&other.0);
    }
}

/// A layer that held the shaft at the last look.
#[derive(Clone, Copy, Debug)]
struct Hold {
    layer: usize,
    depth: f64,
    /// Where the axis was there then, and before the present move, m.
    seen: [f64; 2],
    now: [f64; 2],
    /// Where the straight segment between two vertices was there then, m.
    anchor: [f64; 2],
}

cloned_field_by_field! {
    /// The rod and where it is; places are relative to the entry point on the undeformed top, z upwards.
    #[derive(Debug)]
    pub(crate) struct Bending {
        rod: Rod,
        clamp: Clamp,
        length: f64,
        /// A point of the template's hole, m.
        template: Option<[f64; 3]>,
        /// Direction of the hole.
        path: [f64; 3],
        forces: Reserved<Force>,
        /// Those of the layers, and at the end that of the template.
        springs: Reserved<Spring>,
        /// What held the shaft at the last look.
        holds: Reserved<Hold>,
        /// v of each layer.
        rate: Vec<[f64; 2]>,
        /// Travel of the driver on which it is learnt, and that between two looks, m.
        learning: f64,
        apart: f64,
        /// d, and poses since the last look.
        since: f64,
        poses: u32,
        /// The driver's last move, m.
        last_move: [f64; 3],
        /// How far the shape has changed in the tissue at the last advance, m.
        moved: f64,
        /// Force of the template on the needle, N.
        template_force: [f64; 3],
        /// G J, N m^2, and R, m.
        torsional_stiffness: f64,
        radius: f64,
        /// t, if the scene says it, N.
        torsional_friction: Option<f64>,
        /// T of the last look, rad.
        twist: f64,
        /// Rotation of driver and tip, rad.
        roll: [f64; 2],
    }
}

impl Bending {
    /// Of a scene's needle, whose path has so many layers of nodes; `top`: height of the surface in frame `sample`, m. `None`: it is rigid.
    pub(super) fn new(needle: &Needle, top: f64, layers: usize) -> Option<Self> {
        let flexible = needle.flexible?;
        let [x, y] = needle.slope();
        let cosine = 1.0 / (1.0 + x * x + y * y).sqrt();
        let path = [x * cosine, y * cosine, -cosine];
        let length = flexible.length.get();
        let clamp = Clamp { place: path.map(|c| -length * c), direction: path };
        let template = flexible.guide_z.map(|z| {
            let up = z.get() - top;
            [-x * up, -y * up, up]
        });
        let section = flexible.section(needle.diameter);
        Some(Self {
            rod: Rod::new(&section, length, SEGMENTS, &clamp),
            clamp,
            length,
            template,
            path,
            forces: Reserved(Vec::with_capacity(layers)),
            springs: Reserved(Vec::with_capacity(layers + 1)),
            holds: Reserved(Vec::with_capacity(layers)),
            rate: vec![[0.0; 2]; layers],
            learning: LEARNING * 0.5 * needle.diameter.get(),
            apart: LOOKS_APART * 0.5 * needle.diameter.get(),
            since: 0.0,
            poses: 0,
            last_move: [0.0; 3],
            moved: 0.0,
            template_force: [0.0; 3],
            torsional_stiffness: section.torsional_stiffness(),
            radius: 0.5 * needle.diameter.get(),
            torsional_friction: flexible.torsional_friction,
            twist: 0.0,
            roll: [0.0; 2],
        })
    }

    /// Straight again, out of the tissue.
    pub(super) fn reset(&mut self) {
        self.clamp = Clamp { place: self.path.map(|c| -self.length * c), direction: self.path };
        self.rod.straighten(&self.clamp);
        self.rate.fill([0.0; 2]);
        self.forces.0.clear();
        self.springs.0.clear();
        self.holds.0.clear();
        (self.since, self.poses, self.last_move) = (0.0, 0, [0.0; 3]);
        (self.moved, self.template_force, self.twist, self.roll) = (0.0, [0.0; 3], 0.0, [0.0; 2]);
    }

    /// Lets the driver go to where its straight needle would have that tip, and the rod to rest beside what holds it.
    pub(super) fn advance(&mut self, straight: &Tip, held: impl Iterator<Item = Held>) {
        let clamp = self.clamp_of(straight);
        let moved: [f64; 3] = std::array::from_fn(|k| clamp.place[k] - self.clamp.place[k]);
        if dot(moved, self.last_move) < 0.0 {
            self.rate.fill([0.0; 2]);
        }
        let travel = dot(moved, moved).sqrt();
        if travel > 0.0 {
            self.last_move = moved;
        }
        self.poses += 1;
        if self.since >= self.apart || self.poses >= MOST_POSES || travel <= 0.0 {
            self.look(held, &clamp);
        }
        self.turn(straight.roll, travel);
        self.since += travel;
        for at in &mut self.holds.0 {
            at.now = axis_at(&self.rod, at.depth);
        }
        let before = self.clamp;
        self.rod.carry(&before, &clamp);
        self.clamp = clamp;
        // the layers stay where they are while the rod goes along them
        let way = dot(moved, clamp.direction);
        for (i, hold) in self.holds.0.iter().enumerate() {
            let (force, spring) = (&mut self.forces.0[i], &mut self.springs.0[i]);
            force.arc = (force.arc - way).clamp(0.0, self.length);
            spring.arc = force.arc;
            let rate = self.rate[hold.layer];
            (0..2).for_each(|k| spring.place[k] = hold.anchor[k] + rate[k] * self.since);
        }
        self.springs.0.truncate(self.holds.0.len());
        if let Some(place) = self.template.filter(|_| self.has_template()) {
            let stiffness = TEMPLATE * self.rod.bending_stiffness() / self.length.powi(3);
            self.springs.0.push(Spring { arc: arc_at(&self.rod, -place[2]), place, axis: self.path, stiffness });
        }
        // a rod that finds no rest keeps the shape with which it went along: the tissue then holds it as a rigid one
        let settled = self.rod.settle(&clamp, &self.forces.0, &self.springs.0).is_ok();
        let gap = |hold: &Hold| {
            let [x, y] = axis_at(&self.rod, hold.depth);
            (x - hold.now[0]).hypot(y - hold.now[1])
        };
        self.moved = self.holds.0.iter().map(gap).fold(0.0, f64::max);
        self.template_force = match self.springs.0.get(self.holds.0.len()) {
            Some(spring) if settled => spring.force(self.rod.at(spring.arc)),
            _ => [0.0; 3],
        };
    }

    /// Looks at what holds the rod, and learns how its shape has gone since the last look.
    fn look(&mut self, held: impl Iterator<Item = Held>, clamp: &Clamp) {
        if self.since > 0.0 {
            let share = (self.since / self.learning).min(1.0);
            for hold in &self.holds.0 {
                let (now, rate) = (axis_at(&self.rod, hold.depth), &mut self.rate[hold.layer]);
                let seen: [f64; 2] = std::array::from_fn(|k| (now[k] - hold.seen[k]) / self.since);
                *rate = std::array::from_fn(|k| rate[k] + share * (seen[k] - rate[k]));
            }
        }
        (self.since, self.poses) = (0.0, 0);
        self.forces.0.clear();
        self.springs.0.clear();
        self.holds.0.clear();
        let (mut twist, mut held_length) = (0.0, 0.0);
        for Held { layer, depth, force, shear, length, friction } in held {
            let arc = arc_at(&self.rod, depth);
            twist +=
                self.torsional_friction.unwrap_or(self.radius * friction) * length * arc / self.torsional_stiffness;
            held_length += length;
            let place = self.rod.at(arc);
            let stiffness = FOUNDATION * shear;
            self.forces.0.push(Force { arc, force });
            self.springs.0.push(Spring { arc, place, axis: clamp.direction, stiffness });
            let seen = axis_at(&self.rod, depth);
            self.holds.0.push(Hold { layer, depth, seen, now: seen, anchor: [place[0], place[1]] });
        }
        // layers stand for more than is in the tissue
        let inside = self.length - arc_at(&self.rod, 0.0);
        self.twist = if held_length > inside { twist * inside / held_length } else { twist };
    }

    /// Turns the driver to a rotation in rad, while it travels by so many m, and the tip after it.
    fn turn(&mut self, to: f64, travel: f64) {
        let [driver, tip] = self.roll;
        let by = PI - (PI - to + driver).rem_euclid(TAU);
        let way = (self.radius * by).hypot(travel);
        if way > 0.0 {
            let lag = self.twist * (self.radius * by).abs() / way;
            // a whole turn more or less is the same rotation of both
            let driver = driver + by;
            self.roll = [to, tip.clamp(driver - lag, driver + lag) + to - driver];
        }
    }

    fn has_template(&self) -> bool {
        self.template.is_some_and(|place| self.is_between(place[2]))
    }

    /// Whether a height is between clamp and tip.
    fn is_between(&self, z: f64) -> bool {
        let x = self.rod.vertices();
        z < x[0][2] && z > x[x.len() - 1][2]
    }

    /// The clamp of a driver whose straight needle would have that tip.
    fn clamp_of(&self, straight: &Tip) -> Clamp {
        let [x, y] = straight.slope;
        let cosine = 1.0 / (1.0 + x * x + y * y).sqrt();
        let direction = [-x * cosine, -y * cosine, -cosine];
        Clamp { place: std::array::from_fn(|k| straight.offset[k] - self.length * direction[k]), direction }
    }

    /// How far the shape in the tissue has changed at the last advance, m; 0 where that is nothing.
    pub(crate) fn moved(&self) -> f64 {
        if self.moved > SAME_SHAPE { self.moved } else { 0.0 }
    }

    /// Force of the template on the needle, N, and where it acts, m.
    pub(crate) fn template(&self) -> Option<([f64; 3], [f64; 3])> {
        self.template.filter(|_| self.has_template()).map(|place| (self.template_force, place))
    }

    /// Where the tip is, in the place of where the straight needle's would be.
    pub(super) fn tip(&self, straight: &Tip) -> Tip {
        let x = self.rod.vertices();
        let d = self.rod.tip_direction();
        Tip { offset: x[x.len() - 1], depth: straight.depth, slope: [d[0] / d[2], d[1] / d[2]], roll: self.roll[1] }
    }

    /// Rotation of the tip, rad.
    pub(crate) fn tip_roll(&self) -> f64 {
        self.roll[1]
    }

    /// Places from the clamp to the tip, m.
    pub(crate) fn places(&self) -> &[[f64; 3]] {
        self.rod.vertices()
    }

    /// Unit vectors along the needle there: of the chord between the neighbours.
    pub(crate) fn directions(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let x = self.rod.vertices();
        let last = x.len() - 1;
        (0..=last).map(move |i| match i {
            0 => self.clamp.direction,
            i if i == last => self.rod.tip_direction(),
            i => {
                let chord: [f64; 3] = std::array::from_fn(|k| x[i + 1][k] - x[i - 1][k]);
                let length = chord.iter().map(|c| c * c).sum::<f64>().sqrt();
                chord.map(|c| c / length)
            }
        })
    }

    /// Lateral place of the needle's axis at a reference depth below the top, m.
    pub(super) fn axis_at(&self, depth: f64) -> [f64; 2] {
        axis_at(&self.rod, depth)
    }
}

/// First of the two vertices about a height, and the share of the second: beyond the ends those of the last segment.
fn about(rod: &Rod, z: f64) -> (usize, f64) {
    let x = rod.vertices();
    let i = x.partition_point(|v| v[2] > z).clamp(1, x.len() - 1) - 1;
    (i, (x[i][2] - z) / (x[i][2] - x[i + 1][2]))
}

/// Arc length from the clamp at a depth under the top, m.
fn arc_at(rod: &Rod, depth: f64) -> f64 {
    let (i, share) = about(rod, -depth);
    ((i as f64 + share) * rod.length() / SEGMENTS as f64).clamp(0.0, rod.length())
}

/// Lateral place of the axis at a depth, m: a cubic through four vertices, which has no kink where they are, and past the tip a straight line.
fn axis_at(rod: &Rod, depth: f64) -> [f64; 2] {
    let x = rod.vertices();
    let (last, z) = (x.len() - 1, -depth);
    if z <= x[last][2] {
        let d = rod.tip_direction();
        return std::array::from_fn(|k| x[last][k] + d[k] / d[2] * (z - x[last][2]));
    }
    let (i, t) = about(rod, z);
    let slope = |j: usize, k: usize| {
        let (a, b) = (j.saturating_sub(1), (j + 1).min(last));
        (x[b][k] - x[a][k]) / (x[b][2] - x[a][2])
    };
    let (h, t2, t3) = (x[i + 1][2] - x[i][2], t * t, t * t * t);
    std::array::from_fn(|k| {
        (2.0 * t3 - 3.0 * t2 + 1.0) * x[i][k]
            + (t3 - 2.0 * t2 + t) * h * slope(i, k)
            + (3.0 * t2 - 2.0 * t3) * x[i + 1][k]
            + (t3 - t2) * h * slope(i + 1, k)
    })
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
