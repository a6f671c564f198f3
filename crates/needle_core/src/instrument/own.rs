//! Instruments of one's own: a rule from the pose of a tip to constraints of the solver. The twin adds pace, recovery, health and observation.

use std::any::Any;
use std::fmt::Debug;

use super::{Phase, Tip};
use mtled::solver::Solver;

/// Turns poses into constraints.
///
/// `Press` is the shortest one that ships; `examples/own_instrument.rs` has another. An instrument is copied with the twin's state when the twin
/// looks ahead or goes back to its last good state, so what it remembers from pose to pose lies in itself.
pub trait Instrument: Clone + Debug + Send + Sync + 'static {
    /// Says of each of its nodes what the solver is to do with it while the tip is here: [`Solver::prescribe`] a displacement, m, or
    /// [`Solver::set_role`] to [`mtled::solver::Role::Free`]. It says so at each call, since the solver may have gone back to an earlier state.
    fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase;

    /// Back to before the first contact: roles of its nodes, and what it remembers.
    fn reset(&mut self, solver: &mut Solver);
}

/// Some instrument.
#[derive(Debug)]
pub struct Own(Box<dyn Dynamic>);

impl Own {
    /// Of a user's type.
    pub(crate) fn new(instrument: impl Instrument) -> Self {
        Self(Box::new(instrument))
    }

    pub(super) fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase {
        self.0.impose(tip, solver)
    }

    pub(super) fn reset(&mut self, solver: &mut Solver) {
        self.0.reset(solver);
    }

    pub(super) fn take_over(&mut self, other: &Self) {
        self.0.copy_from(&*other.0);
    }
}

impl Clone for Own {
    fn clone(&self) -> Self {
        Self(self.0.copy())
    }
}

/// [`Instrument`] without a size.
trait Dynamic: Debug + Send + Sync {
    fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase;
    fn reset(&mut self, solver: &mut Solver);
    fn copy(&self) -> Box<dyn Dynamic>;
    fn copy_from(&mut self, other: &dyn Dynamic);
    fn any(&self) -> &dyn Any;
}

impl<I: Instrument> Dynamic for I {
    fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase {
        Instrument::impose(self, tip, solver)
    }

    fn reset(&mut self, solver: &mut Solver) {
        Instrument::reset(self, solver);
    }

    fn copy(&self) -> Box<dyn Dynamic> {
        Box::new(self.clone())
    }

    fn copy_from(&mut self, other: &dyn Dynamic) {
        // both are of one twin, so of one type
        if let Some(other) = other.any().downcast_ref::<I>() {
            self.clone_from(other);
        }
    }

    fn any(&self) -> &dyn Any {
        self
    }
}
