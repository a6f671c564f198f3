//! Origin of a message, and selection of one publisher of a measurement at a time.

use std::time::{Duration, Instant};

pub use ros2_guarded::Guid;
use ros2_guarded::{Delivery, publisher_of, times_of};

use super::clock::wall_nanos;

/// Origin of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Its publisher.
    pub publisher: Guid,
    /// Time at which the middleware process received it. A message in the queue of a suspended process keeps this
    /// time; it is not the time at which it is taken out.
    pub received: Instant,
}

impl Origin {
    /// Origin of a message that is taken now.
    #[must_use]
    pub(crate) fn of(delivery: &Delivery) -> Self {
        let [received_nanos, _] = times_of(&delivery.stamp);
        let waited = u64::try_from(wall_nanos().saturating_sub(received_nanos)).unwrap_or(0);
        let now = Instant::now();
        let received = now.checked_sub(Duration::from_nanos(waited)).unwrap_or(now);
        Self { publisher: publisher_of(&delivery.stamp), received }
    }
}

/// Follows one source until it has been silent for a time: alternating between two sensors would make a needle jump.
#[derive(Clone, Copy, Debug)]
pub struct Followed<S> {
    followed: Option<(S, Instant)>,
    other: Option<(S, Instant)>,
}

impl<S> Default for Followed<S> {
    fn default() -> Self {
        Self { followed: None, other: None }
    }
}

impl<S: Copy + PartialEq> Followed<S> {
    /// Whether a message of `source` is accepted. The first source is followed; another one is accepted only after
    /// the first has been silent for `timeout`.
    pub fn takes(&mut self, source: S, now: Instant, timeout: Duration) -> bool {
        let taken = self
            .followed
            .is_none_or(|(followed, heard)| followed == source || now.saturating_duration_since(heard) >= timeout);
        *(if taken { &mut self.followed } else { &mut self.other }) = Some((source, now));
        taken
    }

    /// The source that is followed.
    pub fn source(&self) -> Option<S> {
        self.followed.map(|(source, _)| source)
    }

    /// Another source, if it has sent a message within `timeout`.
    pub fn other(&self, now: Instant, timeout: Duration) -> Option<S> {
        self.other.filter(|(_, heard)| now.saturating_duration_since(*heard) < timeout).map(|(source, _)| source)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_source_is_followed_and_another_is_known_until_it_is_silent() {
        let (mut followed, timeout) = (Followed::default(), Duration::from_millis(500));
        let begun = Instant::now();
        let at = |ms| begun + Duration::from_millis(ms);
        assert!(followed.takes('a', at(0), timeout) && followed.other(at(0), timeout).is_none());
        assert!(!followed.takes('b', at(10), timeout) && followed.takes('a', at(20), timeout));
        assert_eq!((followed.source(), followed.other(at(509), timeout)), (Some('a'), Some('b')));
        assert_eq!(followed.other(at(510), timeout), None);
        assert!(followed.takes('b', at(520), timeout), "a is silent");
        assert!(!followed.takes('a', at(530), timeout));
    }
}
