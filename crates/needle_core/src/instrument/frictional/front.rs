//! How the front goes on: cutting, membranes, regions.
//!
//! ```text
//! membrane    breaks once F - T >= P    F: force along the needle, N; T: friction of its shaft, N; P: puncture force, N
//! ```
//!
//! F - T is what the face of the tip passes on, and so what the membrane carries: whatever lies between the two passes it on. F is that at
//! rest, without inertia, where a pose has come to it. The tip's own push also accelerates tissue, whose masses are not those of tissue.
//! Judged by it a membrane broke at once where the front stopped at it, and wherever a cell beside the edge gave way: a tenth too early.

use super::{Frictional, LAG, STICKING, TIP_STIFFNESS};
use crate::instrument::Event;
use mtled::solver::{End, Rate, Solver};

/// What counts as having come to a boundary, in layers.
const AT: f64 = 1e-3;
/// Way of the front in one advance, in radii, from which the tissue springs back and further steps are due.
const RUNS: f64 = 0.05;
/// Looks after which the tissue has sprung back in any case.
const PATIENCE: u32 = 512;

/// Share of the shaft's whole friction from which on all of it slips, and below which it sticks again.
const SLIPS: [f64; 2] = [0.98, 0.5];
/// How far the tip's spring gives at its cutting force at most, in radii.
const GIVES: f64 = 0.1;
/// Length of shaft in the tissue below which its slip is no event, in radii.
const SHORT: f64 = 2.0;
/// Force that is not at rest, over that of the puncture, below which the tissue has sprung back.
const REST: f64 = 0.01;
/// The same from which on it swings no more: the slow modes have less inertia again ([`Solver::lighten_slow_modes`]). With 0.1, 0.2 and 0.3 a puncture
/// of 656 steps takes 416, 350 and 288, with 0.6 cells turn over.
const SWUNG: f64 = 0.2;
/// Kinetic over strain energy below which it stands: motion of a hundredth of the displacements in a relaxation time.
const STANDS: f64 = 1e-4;

impl Frictional {
    /// Takes over how far the tip has cut in the last advance, and enters the region behind a membrane that has broken.
    pub(super) fn advance_front(&mut self, solver: &mut Solver) -> Option<Event> {
        let cut = solver.cut();
        let springs = self.progress.released.is_some();
        self.progress.front = if springs { cut } else { self.progress.front.max(cut) };
        let force = self.progress.broken.take()?;
        let layer = self.next_boundary()?;
        // the tissue goes another way now
        solver.forget_motion();
        self.progress.entered = Some(layer);
        self.progress.released = Some((force, 0));
        Some(Event::Puncture { depth_m: self.progress.depth, region: self.shaft.under[layer].region })
    }

    /// Whether the membrane that the front is at breaks: force of the tissue on the needle as near to rest as it comes at this pose, and
    /// friction of the whole shaft, N.
    pub(crate) fn breaks(&mut self, force: &[f64; 3], friction: f64) -> bool {
        let push = -(0..3).map(|k| force[k] * self.shaft.axis[k]).sum::<f64>() - friction;
        let broken = self.membrane().is_some_and(|layer| self.is_at(layer) && push >= self.shaft.under[layer].puncture);
        if broken && self.progress.released.is_none() {
            self.progress.broken = Some(push);
        }
        self.progress.broken.is_some()
    }

    /// The layer of the next boundary, where a membrane closes it.
    fn membrane(&self) -> Option<usize> {
        self.next_boundary().filter(|&k| self.shaft.under[k].puncture > 0.0)
    }

    /// Whether the front has come to a layer.
    fn is_at(&self, layer: usize) -> bool {
        let z = &self.shaft.depths;
        self.progress.front >= z[layer] - AT * (z[1] - z[0])
    }

    /// The layer where the next region begins.
    fn next_boundary(&self) -> Option<usize> {
        let z = &self.shaft.depths;
        match self.progress.entered {
            None => Some(0),
            Some(k) => self.shaft.boundary_below(z[k]),
        }
    }

    /// Enters a region that has no membrane once the front is there.
    pub(super) fn enter_without_membrane(&mut self, depth_m: f64) -> Option<Event> {
        let next = self.next_boundary()?;
        if !self.is_at(next) || self.shaft.under[next].puncture > 0.0 {
            return None;
        }
        let first = self.progress.entered.is_none();
        self.progress.entered = Some(next);
        let region = self.shaft.under[next].region;
        Some(if first { Event::Puncture { depth_m, region } } else { Event::Entered { depth_m, region } })
    }

    /// The beginning of slip along the whole shaft, seen from the last advance.
    pub(super) fn slip(&mut self, depth_m: f64, solver: &Solver) -> Option<Event> {
        let [pull, _] = solver.drag_forces();
        let p = &mut self.progress;
        let share = if p.friction > 0.0 { pull / p.friction } else { 0.0 };
        let (before, long) = (p.slips, p.shoulder > SHORT * self.shaft.radius);
        if share.abs() < SLIPS[1] {
            p.slips = 0.0;
        } else if share.abs() > SLIPS[0] && long {
            p.slips = share.signum();
        }
        let begins = p.slips != 0.0 && p.slips != before;
        begins.then(|| Event::Slip { depth_m, region: self.region().unwrap_or(0) })
    }

    /// The tip at the front.
    pub(super) fn end(&self, (first, shares): (usize, [f64; 3])) -> End {
        let z = &self.shaft.depths;
        let springs = self.progress.released.is_some();
        let inside = self.progress.entered.map(|k| self.shaft.under[k]);
        // Of the region that the front is in, which it does not leave again. By what stands at the tip's shoulder the spring changed at each look
        // where the front came to rest beside a boundary: 2000 steps at each of several poses, to and fro by 15 um.
        let mu = inside.unwrap_or(self.shaft.under[0]).shear_modulus;
        let limit = inside.map_or(f64::INFINITY, |r| r.cutting);
        let (mut stop, mut beyond) = (f64::INFINITY, limit);
        if let Some(k) = self.membrane() {
            stop = z[k];
            if self.is_at(k) {
                beyond = self.shaft.under[k].cutting;
            }
        }
        let radius = self.shaft.radius;
        let cutting = if limit.is_finite() { limit.max(beyond) } else { 0.0 };
        let spring = (STICKING * mu * 0.5 * radius).max(cutting / (GIVES * radius));
        let stiff = TIP_STIFFNESS * spring;
        let exponent = inside.map_or(0.0, |r| r.rate_exponent);
        let rate = Rate { exponent, slow: self.slow * self.progress.elapsed };
        End { first, shares, spring, stiff, limit, stop, rate, lag: LAG * self.shaft.radius, springs }
    }

    /// Whether the tissue springs back but does not swing far any more, with a residual force of so many N.
    pub(crate) fn has_swung(&self, residual: f64) -> bool {
        self.progress.released.is_some_and(|(force, _)| residual < SWUNG * force)
    }

    /// Whether the tissue springs back along the needle, with a residual force of so many N and so much kinetic over strain energy: then
    /// the pose is worth further steps. Forces alone balance in the middle of a swing, too.
    pub(crate) fn springs_back(&mut self, solver: &Solver, residual: f64, energies: f64) -> bool {
        let runs = solver.cut() - self.progress.front > RUNS * self.shaft.radius;
        self.progress.released = self
            .progress
            .released
            .filter(|(force, looks)| (residual >= REST * force || energies >= STANDS) && *looks < PATIENCE)
            .map(|(force, looks)| (force, looks + 1));
        runs || self.progress.released.is_some()
    }
}
