//! What the needle asks of the cells round its path: how far they are strained, and which of their points it fills.

use mtled::solver::Solver;

use super::NeedlePath;
use crate::instrument::capture::Hold;
use crate::instrument::puncture::largest_strain;

impl NeedlePath {
    /// The needle takes the place of the tissue in the cells that it fills.
    pub(super) fn fill(&mut self, depth: f64, solver: &mut Solver) {
        let holds = self.progress.hold.iter().zip(&self.window);
        for (along, (hold, window)) in self.along.iter_mut().zip(holds) {
            *along = match hold {
                Hold::Captured(c) if self.revolved => c.share(depth, *window),
                Hold::Captured(c) => c.passed,
                Hold::Free | Hold::Indented | Hold::Left(_) => 0.0,
            };
        }
        for ((point, corners), filled) in self.inner.iter().zip(&mut self.progress.filled) {
            let share = corners.iter().map(|&n| self.along[n as usize]).fold(1.0, f64::min);
            if share != *filled {
                *filled = share;
                solver.set_active(*point as usize, 1.0 - share);
            }
        }
    }

    /// Largest principal Green-Lagrange strain round the entry point.
    pub(super) fn strain(&self, solver: &Solver) -> f64 {
        self.watched.iter().map(|&p| largest_strain(&solver.deformation(p as usize))).fold(0.0, f64::max)
    }
}
