//! How the front goes on: cutting, membranes, regions.

use super::{Frictional, LAG, STICKING, TIP_STIFFNESS};
use crate::instrument::Event;
use mtled::solver::{End, Solver};

/// What counts as having come to a boundary, in layers.
const AT: f64 = 1e-3;
/// Way of the front in one advance, in layers, from which the tissue springs back and further steps are due.
const RUNS: f64 = 0.1;

/// Force that is not at rest, over that of the puncture, below which the tissue has sprung back.
const REST: f64 = 0.05;

impl Frictional {
    /// Depth of the material that all of the tip's rings have cut, m.
    fn cut(solver: &Solver) -> f64 {
        solver.slip().end.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Takes over how far the tip has cut in the last advance, and what it has broken.
    pub(super) fn advance_front(&mut self, solver: &mut Solver) -> Option<Event> {
        let broken = solver.slip().broken;
        let cut = Self::cut(solver);
        self.progress.front = self.progress.front.max(cut);
        let [depth_m, force] = broken?;
        let layer = self.next_boundary()?;
        solver.mend();
        self.progress.entered = Some(layer);
        self.progress.released = Some(force);
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

    /// The tip at the front.
    pub(super) fn end(&self, upper: usize, share: f64) -> End {
        let z = &self.shaft.depths;
        let mu = self.shaft.under[upper].shear_modulus;
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
        let spring = TIP_STIFFNESS * STICKING * mu * 0.5 * self.shaft.radius;
        End { upper, share, spring, limit, stop, puncture, beyond, lag: LAG * self.shaft.radius }
    }

    /// Whether the tissue springs back along the needle, with a residual force of so many N: then the pose is worth further steps.
    pub fn springs_back(&mut self, solver: &Solver, residual: f64) -> bool {
        let z = &self.shaft.depths;
        let runs = Self::cut(solver) - self.progress.front > RUNS * (z[1] - z[0]);
        if self.progress.released.is_some_and(|force| residual < REST * force) {
            self.progress.released = None;
        }
        runs || self.progress.released.is_some()
    }
}
