//! Several solvers of one cloud, stepped together: their internal forces are evaluated at once, with members in the lanes.
//!
//! All else is each member's own, as it is alone: what holds its nodes, its masses, its damping, the number of its steps. So a member
//! that leaves the team for a while, to find out of trouble, needs nothing but its own solver. Every sum is taken in the order in which a
//! solver alone takes it, so a member has the bits of its single run.

mod force;
mod passes;
mod point;
mod projection;
mod table;
mod transfer;

use crate::number::LANES;

use super::explicit::{Solver, Told};
use super::inertia::Sums;
use super::model::{Model, Precise, with_kernel};
use super::nodes::{Nodes, Rule};
use super::state::{Control, State};
use super::step::{Advance, REFRESH};
use force::Lockstep;

/// Members of a team by their places; `None` where one takes no part.
pub type Members<'a> = [Option<&'a mut Solver>; LANES];

/// What up to eight solvers of one cloud share to be stepped together, on the caller's thread.
#[derive(Debug)]
pub struct Team {
    lanes: Precise<Lockstep<f32>, Lockstep<f64>>,
    /// Whether the last evaluation of each place was of the member that stands there.
    holds: [bool; LANES],
}

impl Team {
    /// Most members of a team.
    pub const MOST: usize = LANES;

    /// A team for up to eight solvers; `None` where they are not of one cloud ([`Model::is_like`]), have different laws in a
    /// region, or where one relaxes or has the logarithmic energy of volume. Of another team of the same cloud it shares what it can.
    #[must_use]
    pub fn new(solvers: &[&Solver], beside: Option<&Self>) -> Option<Self> {
        let models = || solvers.iter().map(|s| &*s.model);
        let lanes = match models().next()?.kernel {
            Precise::F32(_) => {
                let kernels: Vec<_> = models().map(single).collect::<Option<_>>()?;
                let common =
                    beside.and_then(|b| if let Precise::F32(l) = &b.lanes { Some(l.common.clone()) } else { None });
                Precise::F32(Lockstep::new(&kernels, common)?)
            }
            Precise::F64(_) => {
                let kernels: Vec<_> = models().map(double).collect::<Option<_>>()?;
                let common =
                    beside.and_then(|b| if let Precise::F64(l) = &b.lanes { Some(l.common.clone()) } else { None });
                Precise::F64(Lockstep::new(&kernels, common)?)
            }
        };
        Some(Self { lanes, holds: [false; LANES] })
    }

    /// Takes every member's own advance, each in its own number of steps ([`Solver::refresh_if_due`] and [`Solver::advance`]); one without
    /// steps is to take no part. A member whose numbers are lost says so in its balance.
    pub fn advance(&mut self, members: &mut Members<'_>, steps: &[u32; LANES], travel: &[[f64; 3]; LANES]) {
        let Some(any) = members.iter().flatten().next() else { return };
        debug_assert!(members.iter().flatten().all(|m| m.model.is_like(&any.model)));
        let steps = std::array::from_fn(|k| if members[k].is_some() { steps[k] } else { 0 });
        let most = steps.into_iter().max().unwrap_or(0);
        let mut due = [false; LANES];
        for (k, solver) in present(members).filter(|(k, m)| steps[*k] > 0 && m.state.control.is_due()) {
            due[k] = true;
            solver.state.control.since_refresh = 0.0;
        }
        self.refresh(members, &due);
        let mut travels = [[0.0; 3]; LANES];
        for (k, solver) in present(members) {
            travels[k] = solver.model.set_out(&mut solver.state, &Advance { steps: steps[k], travel: travel[k] });
        }
        self.set_active(members);
        let mut first = 1;
        while first <= most {
            let going = steps.map(|steps| steps >= first);
            if first > 1 {
                self.refresh(members, &going);
            }
            let last = most.min(first - 1 + REFRESH);
            self.march(members, [first, last], &steps, &travels);
            first = last + 1;
            if first <= most && members.iter().flatten().any(|m| m.work.is_stopped()) {
                let left = present(members).filter(|(k, _)| steps[*k] >= first);
                left.for_each(|(_, m)| m.state.control.sums.fill(Sums::LOST));
                break;
            }
        }
        for (k, solver) in present(members) {
            solver.state.arrive();
            solver.told = Some(self.told(k));
        }
    }

    fn set_active(&mut self, members: &mut Members<'_>) {
        for (k, solver) in present(members) {
            with_kernel!((&mut self.lanes, &solver.state.points) => (lanes, points) { lanes.set_active(k, points) });
        }
    }

    /// What an evaluation leaves of a member.
    fn told(&self, k: usize) -> Told {
        with_kernel!((&self.lanes) => (lanes) { Told { energy: lanes.energy(k), min_jacobian: lanes.min_jacobian(k) } })
    }

    /// Takes the steps from `first` to `last` of those that each member has. One that has no more stays where it is.
    fn march(
        &mut self,
        members: &mut Members<'_>,
        [first, last]: [u32; 2],
        steps: &[u32; LANES],
        travels: &[[f64; 3]; LANES],
    ) {
        for step in first - 1..=last {
            if step >= first {
                self.evaluate(members);
            }
            for (k, solver) in present(members).filter(|(k, _)| steps[*k] >= step.max(first)) {
                let own_last = last.min(steps[k]);
                let rule = solver.state.rule([first, own_last, steps[k]], travels[k]);
                if step < own_last {
                    solver.model.integrate(&mut solver.state, step + 1, &rule);
                }
                if step == steps[k] {
                    solver.model.sum_up(&mut solver.state, &rule);
                }
            }
        }
    }

    /// Internal force of each member at its nodal parameters.
    fn evaluate(&mut self, members: &mut Members<'_>) {
        self.deform(members, |m| &m.state.moving.u);
        let mut f = members.each_mut().map(|m| m.as_mut().map(|m| &mut m.state.moving.f[..]));
        with_kernel!((&mut self.lanes) => (lanes) { lanes.force(&mut f) });
        for solver in members.iter_mut().flatten() {
            if let Some(half) = &solver.model.half {
                solver.state.moving.f.iter_mut().enumerate().for_each(|(n, f)| *f = half.of_node(n, *f));
            }
        }
    }

    fn deform(&mut self, members: &Members<'_>, u: fn(&Solver) -> &[[f64; 3]]) {
        let Some(any) = members.iter().flatten().next() else { return };
        let u = members.each_ref().map(|m| u(m.as_deref().unwrap_or(any)));
        with_kernel!((&mut self.lanes) => (lanes) { lanes.deform(&u) });
        self.holds = members.each_ref().map(Option::is_some);
    }

    /// [`Solver::refresh_step`] of those that are due.
    fn refresh(&mut self, members: &mut Members<'_>, due: &[bool; LANES]) {
        if *due == [false; LANES] {
            return;
        }
        if members.iter().zip(self.holds).any(|(m, held)| m.as_ref().is_some_and(|m| !held || m.told.is_none())) {
            self.deform(members, |m| &m.state.moving.u);
        }
        // the bounds are of the last evaluation, the probe is of the points that are tissue now
        self.set_active(members);
        with_kernel!((&mut self.lanes) => (lanes) { lanes.bound(&mut images(members)) });
        for (_, solver) in present(members).filter(|(k, _)| due[*k]) {
            let (model, control) = (&solver.model, &mut solver.state.control);
            for (mass, bound) in control.mass.iter_mut().zip(&solver.work.image) {
                model.follow_bound(mass, bound[0]);
            }
            control.slowest = model.slowest(&control.mass);
            solver.state.mix_motion_into_probe();
        }
        self.probe(members, due);
        present(members).filter(|(k, _)| due[*k]).for_each(|(_, m)| m.model.follow_largest(&mut m.state));
    }

    /// One power iteration of each that is due.
    fn probe(&mut self, members: &mut Members<'_>, due: &[bool; LANES]) {
        let mut aside = [false; LANES];
        for (k, solver) in present(members) {
            let Solver { model, state, work, .. } = solver;
            if due[k] {
                aside[k] = model.move_aside(state, &mut work.image);
            } else {
                work.image.copy_from_slice(&state.moving.u);
            }
        }
        self.deform(members, |m| &m.work.image);
        with_kernel!((&mut self.lanes) => (lanes) { lanes.force(&mut images(members)) });
        for (_, solver) in present(members).filter(|(k, _)| aside[*k]) {
            solver.model.learn_largest(&mut solver.state, &solver.work.image);
        }
    }
}

/// The members that take part, with their places.
fn present<'m>(members: &'m mut Members<'_>) -> impl Iterator<Item = (usize, &'m mut Solver)> {
    members.iter_mut().enumerate().filter_map(|(k, m)| Some((k, &mut **m.as_mut()?)))
}

fn images<'m>(members: &'m mut Members<'_>) -> [Option<&'m mut [[f64; 3]]>; LANES] {
    members.each_mut().map(|m| m.as_mut().map(|m| &mut m.work.image[..]))
}

fn single(model: &Model) -> Option<&super::Kernel<f32>> {
    if let Precise::F32(kernel) = &model.kernel { Some(kernel) } else { None }
}

fn double(model: &Model) -> Option<&super::Kernel<f64>> {
    if let Precise::F64(kernel) = &model.kernel { Some(kernel) } else { None }
}

impl Model {
    /// Moves every node through a step, from the force at its start.
    fn integrate(&self, state: &mut State, step: u32, rule: &Rule) {
        let State { moving, constraints, control, .. } = state;
        let held = self.held(constraints, &control.mass, step, rule.steps);
        Nodes::all(moving).integrate_all(&held, step, rule);
        constraints.drag.step(moving, &control.mass, step, rule);
    }

    /// What the last step leaves for the balance.
    fn sum_up(&self, state: &mut State, rule: &Rule) {
        let State { moving, constraints, control: Control { mass, sums, dragged, .. }, .. } = state;
        let held = self.held(constraints, mass, rule.steps + 1, rule.steps);
        for (sums, part) in sums.iter_mut().zip(Nodes::parts(moving)) {
            *sums = part.sums(&held, rule.mass_factor);
        }
        *dragged = constraints.drag.sums(moving, &self.points, mass, rule.mass_factor);
    }
}
