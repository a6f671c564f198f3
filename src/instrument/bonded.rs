//! Plate and flat indenter that stick to the top face: every node of the face moves with the instrument.
//!
//! Below the undeformed top face the bond holds in every direction; at and above it the instrument has lifted off and
//! the face is free of displacement (the bond carries no tension beyond the undeformed state).

use super::Phase;
use mtled::solver::{Role, Solver};

use super::Tip;

/// Nodes of the contact face.
#[derive(Clone, Debug)]
pub struct Bonded {
    nodes: Vec<u32>,
}

impl Bonded {
    /// A bond of the given nodes.
    #[must_use]
    pub fn new(nodes: Vec<u32>) -> Self {
        Self { nodes }
    }

    pub(super) fn impose(&self, tip: &Tip, solver: &mut Solver) -> Phase {
        let inside = tip.depth > 0.0;
        let displacement = if inside { tip.offset } else { [0.0; 3] };
        for &n in &self.nodes {
            solver.prescribe(n as usize, displacement);
        }
        if inside { Phase::Indentation } else { Phase::Approach }
    }

    pub(super) fn reset(&self, solver: &mut Solver) {
        for &n in &self.nodes {
            solver.set_role(n as usize, Role::Instrument);
        }
    }
}
