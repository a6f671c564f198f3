//! What inertia and damping add to the force on the instrument, and how to take it out again.
//!
//! While the tissue lags behind, the internal forces f_j of the free nodes do not vanish: they accelerate and are damped, and
//! the instrument feels a part of each. How much of it follows from virtual work: let every instrument node move by the
//! same, and the free nodes by t_j, as they would at rest. The work of all internal forces in that motion is that of the force
//! at rest, to first order in the lag, since its stiffness times t vanishes at the free nodes (Betti):
//!
//! ```text
//! c_k . F = c_k . F_instrument - sum_free t_kj . f_j        k = x, y, z
//! ```
//!
//! c_k: mean displacement of the instrument's nodes per metre of its travel along k; t_k: tissue's displacement per metre of that
//! travel, of which the solver knows two approximations. The tangent motion that it has learnt comes late, the present motion
//! t_k + q d_k/d^2 runs ahead; F is taken with their mean, and half of the difference is the error estimate. Directions are taken
//! one after the other, each for what the ones before have left, so that a motion that is known by several counts once. What is
//! left of the forces on instrument and base across all known c_k has no such estimate: half of it counts as error.
//!
//! Each t_j being between nothing and all of the instrument's own motion, F lies between the forces on instrument and base: it is
//! never further off than those.

use crate::approximation::Form;

use super::aside::across;
use super::contact::By;
use super::model::Model;
use super::state::{Constraints, Path, Role, State};
use super::step::Balance;
use crate::vector::{cross, dot};

/// Share of the gap that is nothing but the round-off of its projection.
const ROUND_OFF: f64 = 1e-9;

/// What the instrument's motions are to its nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// c_k.
    pub rate: [[f64; 3]; 3],
    /// d / (d^2 + e^2), 1/m, with d the travel per step (see [`super::step`]); 0 at rest.
    pub gain: [f64; 3],
    /// Of each t_k, the share that has not been learnt yet.
    pub unpredicted: [f64; 3],
}

impl Default for Motion {
    fn default() -> Self {
        Self { rate: [[0.0; 3]; 3], gain: [0.0; 3], unpredicted: [1.0; 3] }
    }
}

/// Sums over nodes that the balance is made of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// Force of the tissue on the instrument, N.
    pub instrument: [f64; 3],
    /// Force of the tissue on the base, N.
    pub base: [f64; 3],
    /// Moment of the force on the instrument about the frame's origin, N m.
    pub moment: [f64; 3],
    /// Kinetic energy of the scaled masses, J.
    pub kinetic: f64,
    /// sum t_kj . f_j over the free nodes, N.
    pub learnt: [f64; 3],
    /// sum q_j . f_j over the free nodes, J.
    pub present: f64,
}

impl Sums {
    /// The force on whatever holds a node at a place, m.
    pub(super) fn add_held(&mut self, by: By, place: &[f64; 3], force: &[f64; 3]) {
        if by == By::Base {
            (0..3).for_each(|k| self.base[k] += force[k]);
            return;
        }
        let moment = cross(*place, *force);
        for k in 0..3 {
            self.instrument[k] += force[k];
            self.moment[k] += moment[k];
        }
    }

    /// A free node of a mass with what is left of the internal force on it; tangent motions along the last directions.
    #[inline(always)]
    pub(super) fn add_free<const N: usize>(
        &mut self,
        mass: f64,
        q: &[f64; 3],
        tangent: [&[f64; 3]; N],
        left: &[f64; 3],
    ) {
        self.kinetic += 0.5 * mass * dot(*q, *q);
        self.learnt.iter_mut().skip(3 - N).zip(tangent).for_each(|(learnt, tangent)| *learnt += dot(*tangent, *left));
        self.present += dot(*q, *left);
    }

    /// Those of a state that holds no numbers any more.
    pub(super) const LOST: Self = Self {
        instrument: [f64::NAN; 3],
        base: [f64::NAN; 3],
        moment: [f64::NAN; 3],
        kinetic: f64::NAN,
        learnt: [f64::NAN; 3],
        present: f64::NAN,
    };
}

impl std::ops::Add for Sums {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            instrument: std::array::from_fn(|k| self.instrument[k] + other.instrument[k]),
            base: std::array::from_fn(|k| self.base[k] + other.base[k]),
            moment: std::array::from_fn(|k| self.moment[k] + other.moment[k]),
            kinetic: self.kinetic + other.kinetic,
            learnt: std::array::from_fn(|k| self.learnt[k] + other.learnt[k]),
            present: self.present + other.present,
        }
    }
}

impl Model {
    /// Learns c of an advance by `travel` metres; of a rest or of an advance without instrument nodes the one before stays.
    pub(super) fn note_motion(&self, state: &mut State, travel: [f64; 3]) {
        if travel == [0.0; 3] {
            return;
        }
        let Constraints { role, path, instrument, way, drag, .. } = &state.constraints;
        let (mut sum, mut count) = ([0.0; 3], 0.0_f64);
        for (n, path) in path.iter().enumerate().filter(|(n, _)| role[*n] == Role::Instrument) {
            let moved = std::array::from_fn(|k| path.end[k] - path.start[k]);
            let (moved, nodes) = self.half.as_ref().map_or((moved, 1.0), |half| half.with_image(n, &moved));
            (0..3).for_each(|k| sum[k] += moved[k]);
            count += nodes;
        }
        if count == 0.0 && instrument.is_some() {
            (sum, count) = (std::array::from_fn(|k| way.end[k] - way.start[k]), 1.0);
        }
        if count == 0.0 && !drag.nodes.is_empty() {
            let rigid = |n: &usize| role[*n] == Role::Dragged && path[*n].spring == f64::INFINITY;
            for n in (0..path.len()).filter(rigid) {
                let Path { start, end, .. } = &path[n];
                let moved = across(&[end[0] - start[0], end[1] - start[1], 0.0], &drag.axis);
                let (moved, nodes) = self.half.as_ref().map_or((moved, 1.0), |half| half.with_image(n, &moved));
                (0..3).for_each(|k| sum[k] += moved[k]);
                count += nodes;
            }
            count = count.max(1.0);
            (0..3).for_each(|k| sum[k] += count * drag.axis[k] * (drag.way[1] - drag.way[0]));
        }
        if self.form == Form::Axisymmetric {
            // round a ring radial motions cancel, as their forces do
            sum[0] = 0.0;
        }
        if count > 0.0 {
            state.control.motion.learn(sum, count, travel);
        }
    }
}

impl Motion {
    /// Changes the c_k by the least that explains the displacements of the instrument's nodes, their sum in m and their number, by
    /// its travel.
    fn learn(&mut self, sum: [f64; 3], count: f64, travel: [f64; 3]) {
        let square = dot(travel, travel);
        for i in 0..3 {
            let known: f64 = (0..3).map(|k| self.rate[k][i] * travel[k]).sum();
            for k in (0..3).filter(|&k| travel[k] != 0.0) {
                // along one direction alone nothing of the former is left
                let alone = travel[k] * travel[k] == square;
                self.rate[k][i] = if alone {
                    sum[i] / (count * travel[k])
                } else {
                    self.rate[k][i] + (sum[i] / count - known) * travel[k] / square
                };
            }
        }
    }

    /// Takes inertia out of force and moment on the instrument; fills in gap and error estimate. `slides`: tissue may slide on a surface.
    pub(super) fn take_out_inertia(&self, b: &mut Balance, sums: &Sums, slides: bool) {
        let mut left: [f64; 3] = std::array::from_fn(|k| b.instrument[k] + b.base[k]);
        b.gap = dot(left, left).sqrt();
        let (mut taken_out, mut errors) = ([0.0; 3], [0.0; 3]);
        // The insertion first: most of the force is along it. Tissue that slides does not follow a surface sideways.
        let directions = if slides { &[2][..] } else { &[2, 0, 1] };
        for &k in directions {
            let rate = self.rate[k];
            let square = dot(rate, rate);
            if square <= 0.0 {
                continue;
            }
            // along c_k, in newtons
            let (half, most) = (0.5 * sums.present * self.gain[k] / square.sqrt(), dot(left, rate) / square.sqrt());
            let wanted = sums.learnt[k] / square.sqrt() + half - dot(taken_out, rate) / square.sqrt();
            let taken = wanted.clamp(most.min(0.0), most.max(0.0));
            errors[k] = half.abs().min(most.abs());
            if slides {
                // tissue that spreads between two smooth plates has a balance of forces, but no rest
                errors[k] = errors[k].max((wanted - taken).abs());
            }
            for i in 0..3 {
                b.instrument[i] -= taken * rate[i] / square.sqrt();
                taken_out[i] += taken * rate[i] / square.sqrt();
                left[i] -= most * rate[i] / square.sqrt();
            }
        }
        move_along_its_line(b, &taken_out);
        let across = dot(left, left).sqrt();
        let unknown = if across > ROUND_OFF * b.gap { 0.5 * across } else { 0.0 };
        b.error_estimate = (dot(errors, errors) + unknown * unknown).sqrt();
    }
}

/// Takes the moment of what was taken out of the force out of the moment: what inertia adds is taken to act along the force's own line,
/// which goes through c = F x M / |F|^2, so that the moment about the line stays.
fn move_along_its_line(b: &mut Balance, taken_out: &[f64; 3]) {
    let before: [f64; 3] = std::array::from_fn(|k| b.instrument[k] + taken_out[k]);
    let square = dot(before, before);
    if square > 0.0 {
        let moment = cross(cross(before, b.moment).map(|c| c / square), *taken_out);
        (0..3).for_each(|k| b.moment[k] -= moment[k]);
    }
}
