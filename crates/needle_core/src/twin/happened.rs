//! What happened to the tissue in the last pose, with the force on either side of it.

use super::along::Along;
use crate::instrument::{Contact, Event, Phase, Tip};

/// Events of one pose that there is room for without an allocation.
const ROOM: usize = 16;

/// An event, and the force of the tissue on the instrument in frame `sample` at the places that the model computed before and after
/// it. A pose that is far from the last one is walked to in many places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Happening {
    /// What happened.
    pub event: Event,
    /// N.
    pub force_before_n: [f64; 3],
    /// N.
    pub force_after_n: [f64; 3],
}

/// The events of the last pose, in their order.
#[derive(Debug)]
pub(super) struct Happened {
    list: Vec<Happening>,
    /// Events whose force after is known.
    closed: usize,
    /// Force at the last place, N.
    force_n: [f64; 3],
    /// Deepest that a kinematic needle's tip was inside, m.
    inside_m: f64,
}

impl Default for Happened {
    fn default() -> Self {
        Self { list: Vec::with_capacity(ROOM), closed: 0, force_n: [0.0; 3], inside_m: 0.0 }
    }
}

impl Happened {
    /// Forgets the events of the pose before.
    pub(crate) fn begin(&mut self) {
        self.list.clear();
        self.closed = 0;
    }

    fn note(&mut self, event: Event) {
        self.list.push(Happening { event, force_before_n: self.force_n, force_after_n: self.force_n });
    }

    /// The events in their order.
    pub(crate) fn list(&self) -> &[Happening] {
        &self.list
    }

    /// Notes what the instrument has seen, and the regions that a kinematic needle came into: its tip stands before the material
    /// that lay at its depth.
    pub(crate) fn see(
        &mut self,
        event: Option<Event>,
        tip: &Tip,
        phase: Phase,
        contact: Option<&Contact>,
        along: &Along,
    ) {
        if let Some(Contact::Needle(_)) = contact {
            if let Some(Event::Puncture { depth_m, .. }) = event {
                let region = along.region(depth_m, Phase::Penetration).unwrap_or(0);
                self.note(Event::Puncture { depth_m, region });
                self.inside_m = self.inside_m.max(depth_m);
            }
            if phase == Phase::Penetration && tip.depth > self.inside_m {
                for (depth_m, region) in along.boundaries(self.inside_m, tip.depth) {
                    self.note(Event::Entered { depth_m, region });
                }
                self.inside_m = tip.depth;
            }
        } else if let Some(event) = event {
            self.note(event);
        }
    }

    /// The force at a place at which the model has come to an answer.
    pub(crate) fn close(&mut self, force_n: [f64; 3]) {
        self.list[self.closed..].iter_mut().for_each(|h| h.force_after_n = force_n);
        (self.closed, self.force_n) = (self.list.len(), force_n);
    }

    /// The event that stands for all: the first puncture, or else the first.
    pub fn first(&self) -> Option<Event> {
        let mut events = self.list.iter().map(|h| h.event);
        events.clone().find(|e| e.puncture_depth().is_some()).or_else(|| events.next())
    }

    /// Back to before the first pose.
    pub fn reset(&mut self) {
        self.begin();
        (self.force_n, self.inside_m) = ([0.0; 3], 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forces_stand_on_either_side_and_a_puncture_comes_first() {
        let mut happened = Happened::default();
        let at = |depth_m: f64| Event::Entered { depth_m, region: 1 };
        happened.close([0.0, 0.0, 1.0]);
        happened.begin();
        happened.note(at(1e-3));
        happened.close([0.0, 0.0, 2.0]);
        happened.note(Event::Puncture { depth_m: 2e-3, region: 2 });
        happened.note(at(2e-3));
        happened.close([0.0, 0.0, 3.0]);
        let sides = |h: &Happening| [h.force_before_n[2], h.force_after_n[2]];
        assert_eq!(happened.list.iter().map(sides).collect::<Vec<_>>(), [[1.0, 2.0], [2.0, 3.0], [2.0, 3.0]]);
        assert_eq!(happened.first().map(Event::kind), Some("puncture"));
        happened.begin();
        assert_eq!(happened.first(), None);
    }
}
