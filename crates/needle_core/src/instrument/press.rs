//! Plate and indenter: they press on the top face, which sticks to them or meets their surface.
//!
//! *Bonded*: every node of the face moves with the instrument. Below the undeformed top face the bond holds in every direction; at
//! and above it the instrument has lifted off and the face is free of displacement (the bond carries no tension beyond the
//! undeformed state). *Contact* (see [`super::surface`]): free nodes may not pass the instrument's surface, which follows every tip.

use super::{Instrument, Phase};
use mtled::solver::{Role, Solver};

use super::Tip;

/// What a plate or indenter holds.
#[derive(Clone, Debug)]
pub(crate) struct Press {
    bonded: Vec<u32>,
}

impl Press {
    /// An instrument to which these nodes stick.
    #[must_use]
    pub(crate) fn new(bonded: Vec<u32>) -> Self {
        Self { bonded }
    }

    /// Nodes that stick to it; none where it meets its surface in contact.
    #[must_use]
    pub(crate) fn bonded(&self) -> &[u32] {
        &self.bonded
    }
}

impl Instrument for Press {
    fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase {
        let inside = tip.depth > 0.0;
        let displacement = if inside { tip.offset } else { [0.0; 3] };
        for &n in &self.bonded {
            solver.prescribe(n as usize, displacement);
        }
        // what is bonded keeps its place while the instrument is above, and the wall beside it stays with it
        solver.move_surface(if self.bonded.is_empty() { tip.offset } else { displacement });
        if inside { Phase::Indentation } else { Phase::Approach }
    }

    fn reset(&mut self, solver: &mut Solver) {
        for &n in &self.bonded {
            solver.set_role(n as usize, Role::Instrument);
        }
    }
}
