//! What is shown at present. Whoever puts something on the board replaces what stood there, and never waits for a viewer.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use axum::extract::ws::Message;
use tokio::sync::watch;

use super::frame::{Frame, Model, unit_m};

/// Most viewers at a time.
pub const VIEWERS: usize = 16;
/// Time between the deadlines of two messages to a viewer: 30 Hz.
pub const PERIOD: Duration = Duration::from_nanos(33_333_333);

/// Places on the board, in the order in which they are sent.
#[derive(Clone, Copy)]
pub(super) enum Place {
    Model,
    Status,
    Figures,
    Tissue,
}

/// Number of places.
pub(super) const PLACES: usize = 4;

/// What stands in each place, and how often it was replaced.
pub(super) type Newest = [(u64, Option<Message>); PLACES];

/// See the module.
#[derive(Debug)]
pub struct Board {
    newest: watch::Sender<Newest>,
    viewers: watch::Sender<usize>,
    /// Length of a step of the tissue's displacements, m.
    unit_m: Mutex<f64>,
}

impl Default for Board {
    fn default() -> Self {
        let (newest, viewers) = (watch::Sender::new(Newest::default()), watch::Sender::new(0));
        Self { newest, viewers, unit_m: Mutex::new(1.0) }
    }
}

impl Board {
    /// Whether anybody looks.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        *self.viewers.borrow() > 0
    }

    /// Shows a sample, undeformed.
    pub fn model(&self, model: &Model<'_>) {
        let unit = unit_m(model.points);
        *self.unit_m.lock().unwrap_or_else(PoisonError::into_inner) = unit;
        self.put(Place::Model, Message::Binary(model.encode(unit)));
    }

    /// Shows the sample at a moment.
    pub fn tissue(&self, frame: &Frame<'_>) {
        let unit = *self.unit_m.lock().unwrap_or_else(PoisonError::into_inner);
        self.put(Place::Tissue, Message::Binary(frame.encode(unit)));
    }

    /// Shows phase, pace, latency, health: an object of JSON with `"kind": "status"`.
    pub fn status(&self, json: String) {
        self.put(Place::Status, Message::Text(json.into()));
    }

    /// Shows the present point of the curves, and the events: an object of JSON with `"kind": "figures"`.
    pub fn figures(&self, json: String) {
        self.put(Place::Figures, Message::Text(json.into()));
    }

    /// What is as before is not sent again.
    fn put(&self, place: Place, message: Message) {
        self.newest.send_if_modified(|newest| {
            let (version, stands) = &mut newest[place as usize];
            let changed = stands.as_ref() != Some(&message);
            if changed {
                (*version, *stands) = (*version + 1, Some(message));
            }
            changed
        });
    }

    /// Hears of everything that is put.
    pub(super) fn listen(&self) -> watch::Receiver<Newest> {
        self.newest.subscribe()
    }

    /// The number of viewers, as it changes.
    pub(super) fn count(&self) -> watch::Receiver<usize> {
        self.viewers.subscribe()
    }

    /// A seat, if one is free. It has to be given back by [`Self::leave`].
    pub(super) fn enter(&self) -> bool {
        self.viewers.send_if_modified(|n| {
            let free = *n < VIEWERS;
            *n += usize::from(free);
            free
        })
    }

    /// Gives a seat back.
    pub(super) fn leave(&self) {
        self.viewers.send_modify(|n| *n = n.saturating_sub(1));
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_newest_replaces_what_stood_there_and_the_same_again_is_no_news() {
        let board = Board::default();
        let mut news = board.listen();
        board.status("a".to_owned());
        board.status("b".to_owned());
        assert!(news.has_changed().unwrap());
        assert_eq!(news.borrow_and_update()[Place::Status as usize], (2, Some(Message::Text("b".into()))));
        board.status("b".to_owned());
        assert!(!news.has_changed().unwrap());
    }

    #[test]
    fn there_are_so_many_seats() {
        let board = Board::default();
        assert!((0..VIEWERS).all(|_| board.enter()) && !board.enter());
        board.leave();
        assert!(board.is_watched() && board.enter() && !board.enter());
    }
}
