//! The newest of what is shown, in a few places. Whoever puts something replaces what stood there, and never waits for who looks.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

/// What stands in each place, and how often it was replaced.
pub type Newest<T, const PLACES: usize> = [(u64, Option<T>); PLACES];

/// See the module.
#[derive(Debug)]
pub struct News<T, const PLACES: usize> {
    newest: watch::Sender<Newest<T, PLACES>>,
    taken: watch::Sender<usize>,
    seats: usize,
}

impl<T: Clone + PartialEq, const PLACES: usize> News<T, PLACES> {
    /// Nothing yet, and nobody in so many seats.
    #[must_use]
    pub fn new(seats: usize) -> Self {
        let newest = watch::Sender::new(std::array::from_fn(|_| (0, None)));
        Self { newest, taken: watch::Sender::new(0), seats }
    }

    /// Whether anybody has a seat.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        *self.taken.borrow() > 0
    }

    /// Puts something in a place. What is as before is no news.
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

    /// Hears of everything that is put.
    #[must_use]
    pub fn listen(&self) -> watch::Receiver<Newest<T, PLACES>> {
        self.newest.subscribe()
    }

    /// Waits until nobody has a seat.
    #[cfg(feature = "page")]
    pub async fn left(&self) {
        // an error is that the news are gone, and with them whoever looked
        let _ = self.taken.subscribe().wait_for(|n| *n == 0).await;
    }

    /// Does something again and again, a period apart, while somebody has a seat; for ever.
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

/// A seat, given back when it is dropped.
#[derive(Debug)]
pub struct Seat<T, const PLACES: usize>(Arc<News<T, PLACES>>);

impl<T: Clone + PartialEq, const PLACES: usize> Seat<T, PLACES> {
    /// If one is free.
    #[must_use]
    pub fn take(news: &Arc<News<T, PLACES>>) -> Option<Self> {
        let sat = news.taken.send_if_modified(|n| {
            let free = *n < news.seats;
            *n += usize::from(free);
            free
        });
        sat.then(|| Self(Arc::clone(news)))
    }

    /// Hears of everything that is put, and of what stands there already.
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
