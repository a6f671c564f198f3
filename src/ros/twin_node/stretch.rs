//! Collects poses whose stamps are long before the present ones: late poses, or a restarted time.
//!
//! A looped bag, or a driver that was restarted with another clock, sends only such poses, in order, from one
//! publisher. A few are not enough: otherwise anyone could reset the tissue with two forged stamps.

use std::time::{Duration, Instant};

use super::inbox::PoseInput;
use ros2_node::origin::Guid;

/// A stretch is long with this many poses ...
const POSES: usize = 5;
/// ... received over this time.
const LONG: Duration = Duration::from_millis(500);
/// Number of stored poses; the oldest are dropped first.
const HELD: usize = 1024;

/// A pose that may be accepted.
#[derive(Clone, Copy)]
pub(super) struct Arrival {
    pub pose: PoseInput,
    pub age_s: f64,
    /// The node's time at reception, ns.
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
    /// Adds a pose, and returns the number of poses that do not belong to the stretch.
    pub(crate) fn add(&mut self, publisher: Guid, arrival: Arrival) -> usize {
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

    /// Whether it is long enough for a restarted time.
    pub(crate) fn is_long(&self) -> bool {
        let received = self.held.last().map(|last| last.pose.received);
        let lasted =
            received.zip(self.since).is_some_and(|(last, first)| last.saturating_duration_since(first) >= LONG);
        self.held.len() >= POSES && lasted
    }

    /// Ends it and returns its poses.
    pub(crate) fn end(&mut self) -> Vec<Arrival> {
        self.since = None;
        std::mem::take(&mut self.held)
    }
}
