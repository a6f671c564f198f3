//! How the front goes on: cutting, membranes, regions.

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
const REST: f64 = 0.003;
/// Kinetic over strain energy below which it stands: motion of a hundredth of the displacements in a relaxation time.
const STANDS: f64 = 1e-4;

impl Frictional {
    /// Takes over how far the tip has cut in the last advance, and what it has broken.
    pub(super) fn advance_front(&mut self, solver: &mut Solver) -> Option<Event> {
        let broken = solver.slip().broken;
        let cut = solver.cut();
        let springs = self.progress.released.is_some();
        self.progress.front = if springs { cut } else { self.progress.front.max(cut) };
        let [depth_m, force] = broken?;
        let layer = self.next_boundary()?;
        solver.mend();
        // the tissue goes another way now
        solver.forget_motion();
        self.progress.entered = Some(layer);
        self.progress.released = Some((force, 0));
        Some(Event::Puncture { depth_m, region: self.shaft.under[layer].region })
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
        let z = &self.shaft.depths;
        let reached = self.progress.front >= z[next] - AT * (z[1] - z[0]);
        if !reached || self.shaft.under[next].puncture > 0.0 {
            return None;
        }
        let first = self.progress.entered.is_none();
        self.progress.entered = Some(next);
        let region = self.shaft.under[next].region;
        Some(if first { Event::Puncture { depth_m, region } } else { Event::Entered { depth_m, region } })
    }

    /// The beginning of slip along the whole shaft, seen from the last advance.
    pub(super) fn slip(&mut self, depth_m: f64, solver: &Solver) -> Option<Event> {
        let [pull, _] = solver.slip().forces();
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
        let mu = self.shaft.under[self.shaft.place(self.shoulder(self.progress.front)).0].shear_modulus;
        let springs = self.progress.released.is_some();
        let inside = self.progress.entered.map(|k| self.shaft.under[k]);
        let limit = inside.map_or(f64::INFINITY, |r| r.cutting);
        let membrane = self.next_boundary().filter(|&k| self.shaft.under[k].puncture > 0.0);
        let (mut stop, mut puncture, mut beyond) = (f64::INFINITY, f64::INFINITY, limit);
        if let Some(k) = membrane {
            stop = z[k];
            let next = &self.shaft.under[k];
            // only the front at the membrane breaks it
            if self.progress.front >= z[k] - 0.1 * (z[1] - z[0]) {
                puncture = next.puncture;
                beyond = next.cutting;
            }
        }
        let radius = self.shaft.radius;
        let cutting = if limit.is_finite() { limit.max(beyond) } else { 0.0 };
        let spring = (STICKING * mu * 0.5 * radius).max(cutting / (GIVES * radius));
        let stiff = TIP_STIFFNESS * spring;
        let exponent = inside.map_or(0.0, |r| r.rate_exponent);
        let rate = Rate { exponent, slow: self.slow * self.progress.elapsed };
        End { first, shares, spring, stiff, limit, stop, puncture, beyond, rate, lag: LAG * self.shaft.radius, springs }
    }

    /// Whether the tissue springs back along the needle, with a residual force of so many N and so much kinetic over strain energy: then
    /// the pose is worth further steps. Forces alone balance in the middle of a swing, too.
    pub fn springs_back(&mut self, solver: &Solver, residual: f64, energies: f64) -> bool {
        let runs = solver.cut() - self.progress.front > RUNS * self.shaft.radius;
        self.progress.released = self
            .progress
            .released
            .filter(|(force, looks)| (residual >= REST * force || energies >= STANDS) && *looks < PATIENCE)
            .map(|(force, looks)| (force, looks + 1));
        // what has broken is seen within the same pose
        runs || solver.slip().broken.is_some() || self.progress.released.is_some()
    }
}
