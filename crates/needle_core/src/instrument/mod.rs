//! Plate, indenter and needle: from a pose to prescribed displacements.

mod bevel;
mod capture;
mod flexible;
mod frictional;
mod needle;
mod own;
mod phase;
mod press;
mod puncture;
pub mod reading;
pub mod surface;

pub(crate) use flexible::Bending;
pub use frictional::Resistance;
pub use frictional::Shaft;
pub(crate) use frictional::{Frictional, start_and_slow};
pub use needle::Insertion;
pub use needle::NeedlePath;
pub use own::{Instrument, Own};
pub use phase::{Event, Phase};
pub(crate) use press::Press;

use crate::scene::{self, InstrumentKind};
use mtled::cloud::{Axis, BASE, TOP};
use mtled::solver::Solver;

/// An instrument in contact with a solver's nodes.
#[derive(Clone, Debug)]
pub(crate) enum Contact {
    /// Plate or indenter.
    Press(Press),
    /// Kinematic needle.
    Needle(Box<NeedlePath>),
    /// Needle with friction, cutting and puncture.
    Frictional(Box<Frictional>),
    /// An instrument of the user's own.
    Own(Own),
}

/// Where the tip is relative to the scene's entry point on the undeformed top face, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// Displacement of the tip from the entry point in frame `sample`; z is negative inside the sample.
    pub offset: [f64; 3],
    /// Depth along the instrument's axis.
    pub depth: f64,
    /// Where the instrument's axis goes: lateral way per metre upwards from the tip; zero for a vertical instrument.
    pub slope: [f64; 2],
    /// How far the instrument is turned about its axis from where the scene has it, rad.
    pub roll: f64,
}

impl Tip {
    /// Lateral place of the instrument's axis at a reference depth below the top, relative to the entry point, m.
    #[must_use]
    pub(crate) fn axis_at(&self, z: f64) -> [f64; 2] {
        let rise = -self.offset[2] - z;
        std::array::from_fn(|k| self.offset[k] + self.slope[k] * rise)
    }
}

impl Contact {
    /// Nodes that an instrument can hold: all of the contact face, or all of the needle's path; never those of the base.
    #[must_use]
    pub(crate) fn nodes(points: &[[f64; 3]], faces: &[u8], top: f64, instrument: &scene::Instrument) -> Vec<u32> {
        let axis = Axis { entry: instrument.entry.map(|m| m.get()), slope: instrument.slope() };
        let radius = match &instrument.kind {
            InstrumentKind::Plate => f64::INFINITY,
            InstrumentKind::Indenter { diameter, .. } => 0.5 * diameter.get(),
            InstrumentKind::Needle(n) => n.capture_radius.get(),
        };
        let on_top = !matches!(instrument.kind, InstrumentKind::Needle(_));
        let held = |n: &u32| {
            let (p, faces) = (points[*n as usize], faces[*n as usize]);
            axis.distance(top, p) <= radius * (1.0 + 1e-9) && (!on_top || faces & TOP != 0) && faces & BASE == 0
        };
        (0..points.len() as u32).filter(held).collect()
    }

    /// The shaft of a needle that bends.
    #[must_use]
    pub(crate) fn shaft(&self) -> Option<&Bending> {
        match self {
            Self::Needle(needle) => needle.shaft(),
            Self::Frictional(needle) => needle.bending(),
            Self::Press(_) | Self::Own(_) => None,
        }
    }

    /// Prescribes the nodes for a tip and returns the phase and what happened.
    pub(crate) fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> (Phase, Option<Event>) {
        match self {
            Self::Press(p) => (p.impose(tip, solver), None),
            Self::Needle(n) => n.impose(tip, solver),
            Self::Frictional(n) => n.impose(tip, solver),
            Self::Own(own) => (own.impose(tip, solver), None),
        }
    }

    /// Takes over the state of another instrument of the same model.
    pub(crate) fn take_over(&mut self, other: &Self) {
        match (self, other) {
            (Self::Needle(own), Self::Needle(other)) => own.take_over(other),
            (Self::Frictional(own), Self::Frictional(other)) => own.take_over(other),
            (Self::Own(own), Self::Own(other)) => own.take_over(other),
            _ => {}
        }
    }

    /// Goes back to an earlier state of the same contact, and the solver's roles with it. The solver's own state is to have gone
    /// back already.
    pub(crate) fn return_to(&mut self, earlier: &Self, solver: &mut Solver) {
        match (self, earlier) {
            (Self::Needle(own), Self::Needle(earlier)) => own.return_to(earlier, solver),
            (Self::Frictional(own), Self::Frictional(earlier)) => own.return_to(earlier, solver),
            (Self::Own(own), Self::Own(earlier)) => own.take_over(earlier),
            _ => {}
        }
    }

    /// Back to before the first contact.
    pub(crate) fn reset(&mut self, solver: &mut Solver) {
        match self {
            Self::Press(p) => p.reset(solver),
            Self::Needle(n) => n.reset(solver),
            Self::Frictional(n) => n.reset(solver),
            Self::Own(own) => own.reset(solver),
        }
    }
}
