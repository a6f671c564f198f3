//! One explicit step of a run of consecutive nodes, by what holds each.

use super::aside;
use super::contact::{By, Moved, Touch};
use super::disjoint::{Chunks, NODES_PER_CHUNK};
use super::inertia::Sums;
use super::state::{Moving, Path, Role};

/// What a run of steps has in common.
pub(super) struct Rule {
    /// Steps to take, of `steps` in all.
    pub first: u32,
    pub last: u32,
    pub steps: u32,
    pub travel: [f64; 3],
    /// d / (d^2 + e^2), 1/m.
    pub gain: [f64; 3],
    pub keep: f64,
    pub learn: f64,
    pub mass_factor: f64,
}

impl Rule {
    /// Component k of t d.
    #[inline]
    pub(super) fn drift(&self, tangent: &[[f64; 3]; 3], k: usize) -> f64 {
        let [x, y, z] = self.travel;
        // mostly an instrument moves along z alone
        if x == 0.0 && y == 0.0 { tangent[2][k] * z } else { tangent[0][k] * x + tangent[1][k] * y + tangent[2][k] * z }
    }

    /// Component k of the deviation from t d, after t has learnt from it.
    #[inline]
    pub(super) fn teach(&self, tangent: &mut [[f64; 3]; 3], k: usize, deviation: f64) -> f64 {
        let mut left = deviation;
        for d in (0..3).filter(|&d| self.travel[d] != 0.0) {
            let lesson = self.learn * self.gain[d] * deviation;
            tangent[d][k] += lesson;
            left -= lesson * self.travel[d];
        }
        left
    }

    /// Component k of the tangent motions of a node that is held, and has moved by so much in the step.
    #[inline]
    pub(super) fn set(&self, tangent: &mut [[f64; 3]; 3], k: usize, moved: f64) {
        for d in 0..3 {
            tangent[d][k] = moved * self.gain[d];
        }
    }
}

/// What holds all nodes, and their masses.
pub(super) struct Held<'a> {
    pub mass: &'a [f64],
    pub role: &'a [Role],
    pub path: &'a [Path],
    /// Unit vector along the rod that drags nodes.
    pub rod: [f64; 3],
    /// Undeformed places, m.
    pub points: &'a [[f64; 3]],
    /// Whether x is a radius, which stays zero on the axis.
    pub revolved: bool,
    /// What free nodes of the surface may meet.
    pub surfaces: [Option<Moved<'a>>; 2],
}

impl Held<'_> {
    /// Whether a node is on the axis of a half plane.
    #[inline]
    pub(super) fn keeps_on_axis(&self, n: usize) -> bool {
        self.revolved && self.points[n][0] == 0.0
    }
}

pub(super) type Vectors<'a> = &'a mut [[f64; 3]];
pub(super) type OfNodes<'a> = Chunks<'a, [f64; 3]>;
pub(super) type Tangents<'a> = (Vectors<'a>, Vectors<'a>, Vectors<'a>);
pub(super) type OfTangents<'a> = (OfNodes<'a>, OfNodes<'a>, OfNodes<'a>);
pub(super) type Parts<'a> = (Vectors<'a>, Vectors<'a>, Tangents<'a>, Vectors<'a>, &'a mut [Touch]);

/// The state's nodes, cut up for the team: u, q, tangent, f, touch.
pub(super) fn nodes(state: &mut Moving) -> (OfNodes<'_>, OfNodes<'_>, OfTangents<'_>, OfNodes<'_>, Chunks<'_, Touch>) {
    let [x, y, z] = state.tangent.0.each_mut().map(|t| Chunks::new(t, NODES_PER_CHUNK));
    (
        Chunks::new(&mut state.u, NODES_PER_CHUNK),
        Chunks::new(&mut state.q, NODES_PER_CHUNK),
        (x, y, z),
        Chunks::new(&mut state.f, NODES_PER_CHUNK),
        Chunks::new(&mut state.touch, NODES_PER_CHUNK),
    )
}

/// Consecutive nodes of the state.
pub(super) struct Nodes<'a> {
    /// Index of the first.
    pub first: usize,
    pub u: Vectors<'a>,
    pub q: Vectors<'a>,
    /// Along x, y and z.
    pub tangent: [Vectors<'a>; 3],
    pub f: Vectors<'a>,
    touch: &'a mut [Touch],
}

impl<'a> Nodes<'a> {
    /// Part `i` of [`nodes`].
    pub(super) fn new(i: usize, (u, q, (x, y, z), f, touch): Parts<'a>) -> Self {
        Self { first: i * NODES_PER_CHUNK, u, q, tangent: [x, y, z], f, touch }
    }

    pub(super) fn all(state: &'a mut Moving) -> Self {
        Self {
            first: 0,
            u: &mut state.u,
            q: &mut state.q,
            tangent: state.tangent.0.each_mut().map(Vec::as_mut_slice),
            f: &mut state.f,
            touch: &mut state.touch,
        }
    }

    /// The parts of a state, one after another.
    pub(super) fn parts(state: &'a mut Moving) -> impl Iterator<Item = Self> {
        let chunks = |v: &'a mut [[f64; 3]]| v.chunks_mut(NODES_PER_CHUNK);
        let [x, y, z] = state.tangent.0.each_mut().map(|t| chunks(t));
        let field = chunks(&mut state.u).zip(chunks(&mut state.q)).zip(x.zip(y.zip(z)));
        let all = field.zip(chunks(&mut state.f)).zip(state.touch.chunks_mut(NODES_PER_CHUNK)).enumerate();
        all.map(|(i, ((((u, q), (x, (y, z))), f), touch))| Self::new(i, (u, q, (x, y, z), f, touch)))
    }

    /// Adds to `sums` what the node at `l` of these, which is not free, contributes to the balance.
    pub(super) fn add_to(&self, sums: &mut Sums, l: usize, held: &Held<'_>, mass_factor: f64) {
        let (q, f, n) = (&self.q[l], &self.f[l], self.first + l);
        let place: [f64; 3] = std::array::from_fn(|k| held.points[n][k] + self.u[l][k]);
        let tangent = || self.tangent.each_ref().map(|t| t[l]);
        match held.role[n] {
            Role::Free => {}
            // The internal force on a held node is what its holder exerts on the tissue.
            Role::Instrument => sums.add_held(By::Instrument, &place, &f.map(|f| -f)),
            Role::Base => sums.add_held(By::Base, &place, &f.map(|f| -f)),
            Role::Surface => {
                let touch = &self.touch[l];
                let force = match touch.by {
                    By::Nobody => [0.0; 3],
                    By::Instrument | By::Base => touch.force(f),
                };
                sums.add_held(touch.by, &place, &force.map(|f| -f));
                let left = std::array::from_fn(|k| f[k] - force[k]);
                sums.add_free(held.mass[n] * mass_factor, q, tangent().each_ref(), &left);
            }
            Role::Dragged => {
                let node = (&self.u[l], q, &tangent(), f);
                aside::sums(sums, node, &place, held.mass[n] * mass_factor, held, &held.path[n]);
            }
            Role::Guided if held.path[n].is_oblique() => {
                let node = (&self.u[l], q, &tangent(), f);
                aside::guided_sums(sums, node, &place, held.mass[n] * mass_factor, &held.path[n]);
            }
            Role::Guided => {
                let (path, tangent) = (&held.path[n], tangent());
                let pulls: [f64; 2] = std::array::from_fn(|k| path.spring * (path.end[k] - self.u[l][k]));
                sums.add_held(By::Instrument, &place, &[-pulls[0], -pulls[1], -f[2]]);
                for (k, pull) in pulls.into_iter().enumerate() {
                    sums.kinetic += 0.5 * held.mass[n] * mass_factor * q[k] * q[k];
                    (0..3).for_each(|d| sums.learnt[d] += tangent[d][k] * (f[k] - pull));
                    sums.present += q[k] * (f[k] - pull);
                }
            }
        }
    }

    /// Moves the node at `l` of these, which is not free, through one step, from the force at its start.
    pub(super) fn integrate(&mut self, l: usize, held: &Held<'_>, step: u32, rule: &Rule) {
        let n = self.first + l;
        let path = &held.path[n];
        let share = f64::from(step) / f64::from(rule.steps);
        match held.role[n] {
            Role::Base => {}
            Role::Instrument => {
                for k in 0..3 {
                    let next = path.at(share, k);
                    let moved = next - self.u[l][k];
                    self.tangent.iter_mut().zip(rule.gain).for_each(|(t, gain)| t[l][k] = moved * gain);
                    self.u[l][k] = next;
                }
                self.q[l] = [0.0; 3];
            }
            _ => {
                let mut tangent = self.tangent.each_ref().map(|t| t[l]);
                self.move_on(l, &mut tangent, held, share, rule);
                self.tangent.iter_mut().zip(tangent).for_each(|(all, own)| all[l] = own);
            }
        }
    }

    fn move_on(&mut self, l: usize, tangent: &mut [[f64; 3]; 3], held: &Held<'_>, share: f64, rule: &Rule) {
        let n = self.first + l;
        let (u, q, f) = (&mut self.u[l], &mut self.q[l], &self.f[l]);
        let inverse = || 1.0 / (held.mass[n] * rule.mass_factor);
        let path = &held.path[n];
        match held.role[n] {
            Role::Dragged if path.spring == f64::INFINITY => {
                aside::place((u, q, tangent), held, path, share, rule);
            }
            Role::Dragged => {
                aside::pull((u, q, tangent), f, inverse(), held, path, share, rule);
                self.keep_on_axis(l, tangent, held);
            }
            Role::Guided if path.is_oblique() => aside::guide((u, q, tangent), f, inverse(), path, share, rule),
            Role::Guided => {
                let inverse = inverse();
                // the spring at the end of the step, so that it is stable however stiff it is
                let spring = path.spring * inverse;
                for k in 0..2 {
                    let drift = rule.drift(tangent, k);
                    let free = drift + rule.keep * q[k] - f[k] * inverse;
                    let v = (free + spring * (path.at(share, k) - u[k])) / (1.0 + spring);
                    u[k] += v;
                    q[k] = rule.teach(tangent, k, v - drift);
                }
                let next = path.at(share, 2);
                rule.set(tangent, 2, next - u[2]);
                (u[2], q[2]) = (next, 0.0);
                self.keep_on_axis(l, tangent, held);
            }
            Role::Surface => self.touch_or_go(l, tangent, held, rule),
            Role::Free | Role::Base | Role::Instrument => {}
        }
    }

    /// The radial parameter of a node on the axis drops out of the field and has no force but round-off, with which it would drift.
    #[inline]
    fn keep_on_axis(&mut self, l: usize, tangent: &mut [[f64; 3]; 3], held: &Held<'_>) {
        if held.keeps_on_axis(self.first + l) {
            (self.u[l][0], self.q[l][0]) = (0.0, 0.0);
            tangent.iter_mut().for_each(|t| t[0] = 0.0);
        }
    }

    /// Moves a node that may meet a surface (see [`super::contact`]).
    fn touch_or_go(&mut self, l: usize, tangent: &mut [[f64; 3]; 3], held: &Held<'_>, rule: &Rule) {
        let n = self.first + l;
        let (u, q, f) = (&mut self.u[l], &mut self.q[l], &self.f[l]);
        let mass = held.mass[n] * rule.mass_factor;
        let mut deviation: [f64; 3] = std::array::from_fn(|k| rule.keep * q[k] - f[k] / mass);
        if held.keeps_on_axis(n) {
            // the radial parameter of a node on the axis has no force
            deviation[0] = 0.0;
        }
        let mut way: [f64; 3] = std::array::from_fn(|k| rule.drift(tangent, k) + deviation[k]);
        let mut touch = Touch::default();
        let x: [f64; 3] = std::array::from_fn(|k| held.points[n][k] + u[k]);
        for (surface, by) in held.surfaces.iter().zip([By::Instrument, By::Base]) {
            let trial = std::array::from_fn(|k| x[k] + way[k]);
            if let Some((out, met)) = surface.as_ref().and_then(|s| s.meet(&x, &trial)) {
                (0..3).for_each(|k| (way[k], deviation[k]) = (way[k] + out[k], deviation[k] + out[k]));
                touch = Touch { by, friction: met.friction.map(|x| mass * x), ..met };
            }
        }
        self.touch[l] = touch;
        (0..3).for_each(|k| u[k] += way[k]);
        if touch.by != By::Nobody {
            // what is held moves with the surface
            let slides = touch.free(&way);
            for (tangent, gain) in tangent.iter_mut().zip(rule.gain) {
                let known = touch.free(tangent);
                *tangent = std::array::from_fn(|k| known[k] + (way[k] - slides[k]) * gain);
            }
            deviation = touch.free(&deviation);
        }
        (0..3).for_each(|k| q[k] = rule.teach(tangent, k, deviation[k]));
    }
}
