//! Poses whose stamps are long before those of the present: late ones, or a time that starts again.
//!
//! A bag that is looped, or a driver that is started again with another clock, sends nothing but such poses, in their order, from
//! one publisher. A few that agree are not enough: whoever forges two stamps would reset the tissue.

use std::time::{Duration, Instant};

use super::inbox::PoseInput;
use ros2_node::origin::Guid;

/// A stretch is long after so many poses ...
const POSES: usize = 5;
/// ... that have come for so long.
const LONG: Duration = Duration::from_millis(500);
/// Poses that are held; the oldest go first.
const HELD: usize = 1024;

/// A pose that may be taken.
#[derive(Clone, Copy)]
pub(super) struct Arrival {
    pub pose: PoseInput,
    pub age_s: f64,
    /// The node's time when it came, ns.
    pub now: Option<i64>,
}

/// See the module.
#[derive(Default)]
pub(super) struct Stretch {
    publisher: Guid,
    held: Vec<Arrival>,
    since: Option<Instant>,
}

impl Stretch {
    /// Takes a pose, and gives the number of those that are none of the stretch.
    pub fn add(&mut self, publisher: Guid, arrival: Arrival) -> usize {
        let stamp = |a: &Arrival| a.pose.stamp.nanos();
        let last = self.held.last().map(stamp);
        if last == Some(stamp(&arrival)) && publisher == self.publisher {
            return 1;
        }
        let goes_on = publisher == self.publisher && last.is_some_and(|last| last < stamp(&arrival));
        let mut dropped = if goes_on { 0 } else { self.end().len() };
        if self.held.len() == HELD {
            self.held.remove(0);
            dropped += 1;
        }
        self.publisher = publisher;
        self.since.get_or_insert(arrival.pose.received);
        self.held.push(arrival);
        dropped
    }

    /// Whether it is long enough for a time that starts again.
    pub fn is_long(&self) -> bool {
        let received = self.held.last().map(|last| last.pose.received);
        let lasted =
            received.zip(self.since).is_some_and(|(last, first)| last.saturating_duration_since(first) >= LONG);
        self.held.len() >= POSES && lasted
    }

    /// Ends it and gives what it held.
    pub fn end(&mut self) -> Vec<Arrival> {
        self.since = None;
        std::mem::take(&mut self.held)
    }
}
