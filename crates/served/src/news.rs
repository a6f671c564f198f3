//! The newest content in several slots. A writer replaces the previous content and never waits for readers.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

/// Content of each slot, and a count of its replacements.
pub type Newest<T, const PLACES: usize> = [(u64, Option<T>); PLACES];

/// See the module.
#[derive(Debug)]
pub struct News<T, const PLACES: usize> {
    newest: watch::Sender<Newest<T, PLACES>>,
    taken: watch::Sender<usize>,
    seats: usize,
}

impl<T: Clone + PartialEq, const PLACES: usize> News<T, PLACES> {
    /// Empty, with a limited number of seats (connections) for readers.
    #[must_use]
    pub fn new(seats: usize) -> Self {
        let newest = watch::Sender::new(std::array::from_fn(|_| (0, None)));
        Self { newest, taken: watch::Sender::new(0), seats }
    }

    /// Whether there is a reader.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        *self.taken.borrow() > 0
    }

    /// Puts content into a slot. Unchanged content does not notify readers.
    pub fn put(&self, place: usize, shown: T) {
        self.newest.send_if_modified(|newest| {
            let Some((version, stands)) = newest.get_mut(place) else { return false };
            let changed = stands.as_ref() != Some(&shown);
            if changed {
                (*version, *stands) = (*version + 1, Some(shown));
            }
            changed
        });
    }

    /// Receives all changes from now on.
    #[must_use]
    pub(crate) fn listen(&self) -> watch::Receiver<Newest<T, PLACES>> {
        self.newest.subscribe()
    }

    /// Waits until there is no reader.
    pub async fn left(&self) {
        // an error means that the content was dropped, and all readers with it
        let _ = self.taken.subscribe().wait_for(|n| *n == 0).await;
    }

    /// Calls `act` periodically while there is a reader; never returns.
    pub async fn while_watched(&self, period: Duration, mut act: impl FnMut()) {
        let mut taken = self.taken.subscribe();
        let mut beat = interval(period);
        beat.set_missed_tick_behavior(MissedTickBehavior::Skip);
        while taken.wait_for(|n| *n > 0).await.is_ok() {
            beat.tick().await;
            act();
        }
    }
}

/// A seat for one reader; it is returned when dropped.
#[derive(Debug)]
pub struct Seat<T, const PLACES: usize>(Arc<News<T, PLACES>>);

impl<T: Clone + PartialEq, const PLACES: usize> Seat<T, PLACES> {
    /// Takes a seat, if one is free.
    #[must_use]
    pub fn take(news: &Arc<News<T, PLACES>>) -> Option<Self> {
        let sat = news.taken.send_if_modified(|n| {
            let free = *n < news.seats;
            *n += usize::from(free);
            free
        });
        sat.then(|| Self(Arc::clone(news)))
    }

    /// Receives all changes, and the present content.
    #[must_use]
    pub fn listen(&self) -> watch::Receiver<Newest<T, PLACES>> {
        let mut news = self.0.listen();
        news.mark_changed();
        news
    }
}

impl<T, const PLACES: usize> Drop for Seat<T, PLACES> {
    fn drop(&mut self) {
        self.0.taken.send_modify(|n| *n = n.saturating_sub(1));
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_newest_replaces_what_stood_there_and_the_same_again_is_no_news() {
        let news = News::<&str, 2>::new(1);
        let mut heard = news.listen();
        news.put(1, "a");
        news.put(1, "b");
        assert!(heard.has_changed().unwrap());
        assert_eq!(heard.borrow_and_update()[1], (2, Some("b")));
        news.put(1, "b");
        assert!(!heard.has_changed().unwrap());
    }

    #[test]
    fn there_are_so_many_seats() {
        let news = Arc::new(News::<&str, 1>::new(3));
        let mut seats: Vec<_> = (0..3).map(|_| Seat::take(&news).unwrap()).collect();
        assert!(Seat::take(&news).is_none());
        drop(seats.pop());
        assert!(news.is_watched() && Seat::take(&news).is_some());
        drop(seats);
        assert!(!news.is_watched());
    }
}
