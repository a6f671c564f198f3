//! Central difference with mass scaling, and damping that follows the motion.
//!
//! ```text
//! v_{n+1} = t d + (1 - c) q_n - M^-1 f(u_n),   u_{n+1} = u_n + v_{n+1},   q_{n+1} = v_{n+1} - t d
//! ```
//!
//! d is the instrument's travel in the step, a vector, and t the tangent motions, the tissue's displacement per metre of travel along
//! x, y and z; t d is the sum of the three.
//! Damping acts on q, the deviation from the tangent motion: mass-proportional damping of the velocity itself would
//! drag on the moving tissue and turn into force. When the instrument stops or turns, t d follows at once, so the
//! tissue neither overshoots nor has to be set in motion again. t is learnt on the way at a rate a below the slowest frequency, as a least-mean-squares filter: t_k += a q d_k / (d^2 + e^2), so that steps with next to no
//! travel teach next to nothing. c is critical for the slowest mode.

use crate::approximation::Form;
use crate::vector::dot;

use super::aside::aside;
use super::disjoint::Each;
use super::explicit::Solver;
use super::inertia::Sums;
use super::model::{Model, Workspace, with_kernel};
use super::nodes::{Held, Nodes, Rule, nodes};
use super::state::{Constraints, Control, Moving, Role, State};

/// Damping per step over the slowest frequency: critical.
const DAMPING: f64 = 2.0;
/// Learning rate of the tangent motion over the slowest frequency.
const LEARNING: f64 = 0.3;
/// e over the usual travel per step.
const FLOOR: f64 = 0.2;
/// How fast the memory of the usual travel fades, per advance.
const USUAL_DECAY: f64 = 0.995;
/// Advances between two updates of masses and largest eigenvalue, and steps in an advance of many: one evaluation more in so many.
pub(super) const REFRESH: u32 = 24;
/// Travel of the instrument after which they are due before that, over the height of the body. It is travel that deforms the tissue, and all
/// who take the same poses are due at the same ones, whatever their numbers of steps: a [`super::Team`] updates its members at once.
const REFRESH_TRAVEL: f64 = 0.004;
/// Share of the present velocities in the probe.
const MOTION_SHARE: f64 = 0.05;
/// Amplitude of the probe over the height of the body: small against any spacing, large against round-off.
const PROBE_AMPLITUDE: f64 = 6e-6;

/// One pose's worth of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// Explicit steps, at least 1.
    pub steps: u32,
    /// Way that the instrument travels in all of them, x and y sideways and z into the body, m.
    pub travel: [f64; 3],
}

/// Forces and energies after an advance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Balance {
    /// Force of the tissue on the instrument, less what inertia and damping add along its way (see `solver::inertia`), N.
    pub instrument: [f64; 3],
    /// Estimate of its distance from the force at rest in this position, N (see `solver::inertia`).
    pub error_estimate: f64,
    /// Sum of both forces before that correction, N: zero at rest.
    pub gap: f64,
    /// Force of the tissue on the base, N: cancels the former at rest.
    pub base: [f64; 3],
    /// Moment of the force on the instrument about the frame's origin, N m.
    pub moment: [f64; 3],
    /// Kinetic energy of the scaled masses, J.
    pub kinetic: f64,
    /// Strain energy, J.
    pub strain: f64,
}

impl Solver {
    /// Takes the steps that bring the prescribed nodes to the ends of their paths. After every `REFRESH` steps masses
    /// and step follow the deformation; between advances that is [`Solver::refresh_if_due`].
    ///
    /// How many steps were taken: fewer than asked for once there are no numbers left, or [`Solver::stop_on`] ends it. Then the
    /// balance is not finite, and the state is good for nothing but a return to an earlier one.
    pub fn advance(&mut self, advance: &Advance) -> u32 {
        self.told = None;
        let Self { model, state, work, .. } = self;
        let travel = model.set_out(state, advance);
        let mut first = 1;
        while first <= advance.steps {
            if first > 1 {
                model.refresh_step(state, work);
            }
            let last = advance.steps.min(first - 1 + REFRESH);
            let rule = state.rule([first, last, advance.steps], travel);
            model.march(state, work, &rule);
            first = last + 1;
            let strain = with_kernel!((&model.kernel, &work.scratch) => (k, scratch) { k.energy(scratch) });
            if first <= advance.steps && (!strain.is_finite() || work.is_stopped()) {
                // no further step brings numbers back: the balance says so
                state.control.sums.fill(Sums::LOST);
                break;
            }
        }
        state.arrive();
        first - 1
    }

    /// Forces and energies after the last advance.
    #[must_use]
    pub fn balance(&self) -> Balance {
        let strain = match self.told {
            Some(told) => told.energy,
            None => with_kernel!((&self.model.kernel, &self.work.scratch) => (k, scratch) { k.energy(scratch) }),
        };
        self.model.balance_of(&self.state, strain)
    }

    /// [`Solver::refresh_step`] if the last one is `REFRESH` advances ago, or less where the instrument has travelled far.
    pub fn refresh_if_due(&mut self) {
        self.leave_team();
        if self.state.control.is_due() {
            self.state.control.since_refresh = 0.0;
            self.refresh_step();
        }
    }

    /// Brings masses and step up to date: each point's own bound goes into the masses (see `solver::mass`), and one
    /// power iteration on M^-1 K of the present state, which sees what the bounds don't, into the factor on all of
    /// them. Costs 1.3 evaluations of the internal force.
    pub fn refresh_step(&mut self) {
        self.leave_team();
        self.model.refresh_step(&mut self.state, &mut self.work);
    }

    /// Angular frequency of the fastest mode of the present state, rad per step, by so many power iterations. The
    /// central difference is stable below 2. For tests and studies: costs as many evaluations of the internal force.
    pub fn fastest(&mut self, iterations: usize) -> f64 {
        self.leave_team();
        let Self { model, state, work, .. } = self;
        let before = (state.control.probe.clone(), state.control.largest);
        state.control.probe.clone_from(&model.rest.control.probe);
        state.mix_motion_into_probe();
        let mut largest = 0.0_f64;
        for _ in 0..iterations {
            model.probe(state, work);
            // an estimate from below at each iteration
            largest = largest.max(state.control.largest);
        }
        (state.control.probe, state.control.largest) = before;
        model.evaluate(state, work);
        (largest / state.moving.mass_factor).sqrt()
    }
}

impl Model {
    /// Begins an advance; its travel per step, m.
    pub(super) fn set_out(&self, state: &mut State, advance: &Advance) -> [f64; 3] {
        let travel = advance.travel.map(|d| d / f64::from(advance.steps));
        self.note_motion(state, advance.travel);
        if advance.travel != [0.0; 3] {
            state.control.damping.forget();
        }
        // what a rod drags may take many steps for a small way
        let steps = if state.constraints.drag.nodes.is_empty() { 1 } else { advance.steps };
        let of_travel = dot(advance.travel, advance.travel).sqrt() / (REFRESH_TRAVEL * self.mode.height());
        let learn = LEARNING * state.slowest();
        let control = &mut state.control;
        control.since_refresh += of_travel.max(f64::from(steps) / f64::from(REFRESH));
        control.usual_travel = dot(travel, travel).sqrt().max(USUAL_DECAY * control.usual_travel);
        let square = dot(travel, travel) + (FLOOR * control.usual_travel).powi(2);
        let motion = &mut control.motion;
        motion.gain = if square > 0.0 { travel.map(|d| d / square) } else { [0.0; 3] };
        for k in 0..3 {
            motion.unpredicted[k] *= (-learn * motion.gain[k] * travel[k] * f64::from(advance.steps)).exp();
        }
        travel
    }

    /// What holds the nodes in a step of so many.
    pub(super) fn held<'a>(&'a self, constraints: &'a Constraints, mass: &'a [f64], step: u32, steps: u32) -> Held<'a> {
        Held {
            mass,
            role: &constraints.role,
            path: &constraints.path,
            rod: constraints.drag.axis,
            points: &self.points,
            revolved: self.form == Form::Axisymmetric,
            surfaces: constraints.surfaces(step, steps),
        }
    }

    /// Takes the steps from `rule.first` to `rule.last`.
    fn march(&self, state: &mut State, work: &mut Workspace, rule: &Rule) {
        let modes = self.light_modes(&state.control);
        let State { moving, constraints, control: Control { mass, sums, dragged, .. }, points: shares } = state;
        let (constraints, mass) = (&*constraints, &*mass);
        let drag = &constraints.drag;
        let held = |step| self.held(constraints, mass, step, rule.steps);
        let pool = &mut work.pool;
        pool.each(nodes(moving), |i, part| {
            let mut part = Nodes::new(i, part);
            let held = held(rule.first);
            part.integrate_all(&held, rule.first, rule);
        });
        drag.step(moving, mass, rule.first, rule);
        if let Some(modes) = modes {
            modes.step(moving, constraints, rule);
        }
        with_kernel!((&self.kernel, shares, &mut work.scratch) => (k, shares, scratch) {
            for step in rule.first..=rule.last {
                k.force(shares, &moving.memory, scratch, pool, &moving.u);
                let scratch = &*scratch;
                let held = held(step + 1);
                pool.each((nodes(moving), Each::new(sums)), |i, (part, sums)| {
                    let mut part = Nodes::new(i, part);
                    for (f, n) in part.f.iter_mut().zip(part.first..) {
                        *f = self.of_node(n, k.node_force(scratch, n));
                    }
                    if step < rule.last {
                        part.integrate_all(&held, step + 1, rule);
                    }
                    if step == rule.steps {
                        *sums = part.sums(&held, rule.mass_factor);
                    }
                });
                if step < rule.last {
                    drag.step(moving, mass, step + 1, rule);
                    if let Some(modes) = modes {
                        modes.step(moving, constraints, rule);
                    }
                }
            }
        });
        if rule.last == rule.steps {
            *dragged = drag.sums(moving, &self.points, mass, rule.mass_factor);
            if let Some(modes) = modes {
                dragged.kinetic -= 0.5 * rule.mass_factor * modes.inertia_saved(&moving.q, mass, moving, constraints);
            }
        }
    }

    /// Forces and energies after an advance with this strain energy, J.
    pub(super) fn balance_of(&self, state: &State, mut strain: f64) -> Balance {
        let mut sums = state.control.sums.iter().fold(state.control.dragged, |all, chunk| all + *chunk);
        if let Some(half) = &self.half {
            (sums, strain) = (half.whole(&sums), 2.0 * strain);
        }
        let mut b = Balance {
            instrument: sums.instrument,
            base: sums.base,
            moment: sums.moment,
            kinetic: sums.kinetic,
            strain,
            ..Balance::default()
        };
        if self.form == Form::Axisymmetric {
            // the radial forces round a ring cancel
            (b.instrument[0], b.base[0]) = (0.0, 0.0);
            b.moment = [0.0; 3];
        }
        let Constraints { instrument, base, .. } = &state.constraints;
        state.control.motion.take_out_inertia(&mut b, &sums, instrument.is_some() || base.is_some());
        b
    }

    /// [`Solver::refresh_step`].
    pub(super) fn refresh_step(&self, state: &mut State, work: &mut Workspace) {
        self.refresh_masses(state, work);
        state.mix_motion_into_probe();
        self.probe(state, work);
        self.follow_largest(state);
    }

    /// Brings the factor on all masses up to date with the largest eigenvalue.
    pub(super) fn follow_largest(&self, state: &mut State) {
        let limit = 4.0 * self.step_factor * self.step_factor;
        let needed = (state.control.largest / limit).max(1.0);
        let factor = &mut state.moving.mass_factor;
        *factor = if needed > *factor { needed } else { (0.98 * *factor).max(needed) };
    }

    /// Forces and masses after a return to an earlier state, whose mass factor stands.
    pub(super) fn recover(&self, state: &mut State, work: &mut Workspace) {
        // the estimate of the largest eigenvalue may have followed the trouble beyond all numbers
        if !state.control.probe.iter().flatten().all(|e| e.is_finite()) {
            state.control.probe.clone_from(&self.rest.control.probe);
        }
        // masses are to be those of the earlier state: the one that was left may have had enormous ones
        self.evaluate(state, work);
        state.control.damping.forget();
        with_kernel!((&self.kernel, &work.scratch) => (k, scratch) {
            let f = &mut state.moving.f;
            k.node_forces(scratch, &mut work.pool, f);
            f.iter_mut().enumerate().for_each(|(n, f)| *f = self.of_node(n, *f));
        });
        state.control.mass.fill(0.0);
        self.refresh_masses(state, work);
        let Constraints { role, path, drag, .. } = &mut state.constraints;
        for ((path, role), u) in path.iter_mut().zip(role).zip(&state.moving.u) {
            path.start = if *role == Role::Dragged { aside(u, &drag.axis) } else { *u };
        }
        state.constraints.way.start = state.moving.offset;
        state.constraints.drag.way[0] = state.moving.slip.at;
    }

    /// One power iteration: largest <- e.Ke / e.Me, e <- M^-1 K e, with K e = (f(u + h e) - f(u)) / h.
    pub(super) fn probe(&self, state: &mut State, work: &mut Workspace) {
        let Workspace { pool, scratch, image, .. } = work;
        if !self.move_aside(state, image) {
            return;
        }
        with_kernel!((&self.kernel, &state.points, scratch) => (k, points, scratch) {
            k.force(points, &state.moving.memory, scratch, pool, image);
            k.node_forces(scratch, pool, image);
        });
        match self.light_modes(&state.control) {
            Some(modes) => modes.learn_largest(state, image),
            None => self.learn_largest(state, image),
        }
    }

    /// Scales the probe to h e, and moves `image` to u + h e; false, and to u, where there is no probe.
    pub(super) fn move_aside(&self, state: &mut State, image: &mut [[f64; 3]]) -> bool {
        let (u, probe) = (&state.moving.u, &mut state.control.probe);
        let largest = probe.iter().flatten().fold(0.0_f64, |a, b| a.max(b.abs()));
        if !(largest > 0.0 && largest.is_finite()) {
            image.copy_from_slice(u);
            return false;
        }
        let h = PROBE_AMPLITUDE * self.mode.height() / largest;
        for ((s, u), e) in image.iter_mut().zip(u).zip(probe) {
            for k in 0..3 {
                e[k] *= h;
                s[k] = u[k] + e[k];
            }
        }
        true
    }

    /// Ends a power iteration with the forces at u + h e in `image`.
    pub(super) fn learn_largest(&self, state: &mut State, image: &[[f64; 3]]) {
        let State { moving: Moving { f, .. }, constraints, control, .. } = state;
        let (mut up, mut down) = (0.0, 0.0);
        for n in 0..image.len() {
            let there = self.of_node(n, image[n]);
            for k in 0..3 {
                let e = control.probe[n][k];
                // of a node that is guided along an oblique line no component is held alone: with all of them the bound is on the safe side
                let free = constraints.role[n].frees(k) || constraints.path[n].is_oblique();
                let image = if free { there[k] - f[n][k] } else { 0.0 };
                up += e * image;
                down += control.mass[n] * e * e;
                control.probe[n][k] = image / control.mass[n];
            }
        }
        if down > 0.0 && (up / down).is_finite() {
            control.largest = up / down;
        }
    }
}

impl State {
    /// What the steps from `first` to `last` of so many have in common.
    pub(super) fn rule(&self, [first, last, steps]: [u32; 3], travel: [f64; 3]) -> Rule {
        let slowest = self.slowest();
        Rule {
            first,
            last,
            steps,
            travel,
            gain: self.control.motion.gain,
            keep: (1.0 - DAMPING * self.control.damping.share() * slowest).max(0.0),
            learn: LEARNING * slowest,
            mass_factor: self.moving.mass_factor,
        }
    }

    /// Ends an advance: further steps at the same pose must not travel the path again.
    pub(super) fn arrive(&mut self) {
        let Constraints { role, path, way, drag, .. } = &mut self.constraints;
        way.start = way.end;
        drag.way[0] = drag.way[1];
        self.moving.offset = way.end;
        for (path, _) in path
            .iter_mut()
            .zip(role)
            .filter(|(_, role)| matches!(role, Role::Instrument | Role::Guided | Role::Dragged))
        {
            path.start = path.end;
        }
    }

    /// An oscillation that the step can't hold grows in the velocities first: a share of them in the probe leads the
    /// power iteration to it.
    pub(super) fn mix_motion_into_probe(&mut self) {
        let Control { mass, probe, .. } = &mut self.control;
        let norm = |v: &[[f64; 3]]| -> f64 {
            v.iter().zip(&*mass).map(|(v, m)| m * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2])).sum::<f64>().sqrt()
        };
        let share = MOTION_SHARE * norm(probe) / norm(&self.moving.q);
        if share.is_finite() {
            for (e, q) in probe.iter_mut().zip(&self.moving.q) {
                (0..3).for_each(|k| e[k] += share * q[k]);
            }
        }
    }
}
