//! What a twin keeps for the case that its solution is lost.

use super::answer::Halt;
use crate::instrument::{Contact, Phase};

/// Where the instrument was when the solver's state was saved.
#[derive(Clone, Debug)]
pub(super) struct Saved {
    pub contact: Option<Contact>,
    /// Tip relative to the entry point, m.
    pub tip: [f64; 3],
    /// Where the axis met the undeformed top, relative to the entry point, m.
    pub shaft: [f64; 2],
    /// Depth of the tip, m.
    pub depth_m: f64,
    pub phase: Phase,
}

impl Saved {
    /// Before the first contact.
    pub(crate) fn new(contact: Option<Contact>) -> Self {
        Self { contact, tip: [0.0; 3], shaft: [0.0; 2], depth_m: 0.0, phase: Phase::Approach }
    }

    /// Of another contact from now on.
    pub(crate) fn contact_of(&mut self, contact: &Option<Contact>) {
        self.contact.clone_from(contact);
    }
}

/// A solution that was lost.
#[derive(Clone, Debug)]
pub(super) struct Lost {
    pub halt: Halt,
    /// Deepest pose that is tried once the tries are spent, m.
    pub deepest_m: f64,
    /// Tries so far.
    pub tries: u32,
}
