//! The content that viewers see at present. A writer replaces the previous content and never waits for a viewer.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::frame::{Frame, Model, unit_m};
use axum::extract::ws::Message;
use served::News;

/// Largest number of simultaneous viewers.
pub const VIEWERS: usize = 16;
/// Period of the messages to a viewer: 30 Hz.
pub(super) const PERIOD: Duration = Duration::from_nanos(33_333_333);

/// Slots on the board, in the order in which they are sent.
#[derive(Clone, Copy)]
pub(super) enum Place {
    Model,
    Status,
    Figures,
    Tissue,
}

/// Number of slots.
pub(super) const PLACES: usize = 4;

/// Content of each slot, and a count of its replacements.
pub(super) type Newest = served::Newest<Message, PLACES>;
/// The connection of one viewer.
pub(super) type Seat = served::Seat<Message, PLACES>;

/// See the module.
#[derive(Debug)]
pub struct Board {
    pub(super) news: Arc<News<Message, PLACES>>,
    /// Quantisation step of the tissue's displacements, m.
    unit_m: Mutex<f64>,
}

impl Default for Board {
    fn default() -> Self {
        Self { news: Arc::new(News::new(VIEWERS)), unit_m: Mutex::new(1.0) }
    }
}

impl Board {
    /// Whether there is a viewer.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        self.news.is_watched()
    }

    /// Shows an undeformed sample.
    pub fn model(&self, model: &Model<'_>) {
        let unit = unit_m(model.points);
        *self.unit_m.lock().unwrap_or_else(PoisonError::into_inner) = unit;
        self.put(Place::Model, Message::Binary(model.encode(unit)));
    }

    /// Shows the sample at one time.
    pub fn tissue(&self, frame: &Frame<'_>) {
        let unit = *self.unit_m.lock().unwrap_or_else(PoisonError::into_inner);
        self.put(Place::Tissue, Message::Binary(frame.encode(unit)));
    }

    /// Shows phase, pace, latency, health: a JSON object with `"kind": "status"`.
    pub(crate) fn status(&self, json: String) {
        self.put(Place::Status, Message::Text(json.into()));
    }

    /// Shows the present point of the curves, and the events: a JSON object with `"kind": "figures"`.
    pub(crate) fn figures(&self, json: String) {
        self.put(Place::Figures, Message::Text(json.into()));
    }

    fn put(&self, place: Place, message: Message) {
        self.news.put(place as usize, message);
    }
}
