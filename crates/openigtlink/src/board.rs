//! The newest content for clients.

use std::sync::{Arc, Mutex, PoisonError};

use crate::message::{Instrument, Packet, Surface, packet, points, transform};
use served::News;

/// Largest number of simultaneous clients.
pub(crate) const CLIENTS: usize = 16;

/// Slots, in the order in which they are sent.
#[derive(Clone, Copy)]
enum Place {
    Instrument,
    Surface,
    Targets,
}

pub(super) const PLACES: usize = 3;

/// The connection of one client.
pub(super) type Seat = served::Seat<Packet, PLACES>;

/// The constant data of a sample.
#[derive(Debug, Default)]
struct Model {
    surface: Surface,
    targets: Vec<String>,
}

/// See the module.
#[derive(Debug)]
pub struct Board {
    pub(super) news: Arc<News<Packet, PLACES>>,
    model: Mutex<Model>,
}

impl Default for Board {
    fn default() -> Self {
        Self { news: Arc::new(News::new(CLIENTS)), model: Mutex::default() }
    }
}

impl Board {
    /// Whether a client is connected.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        self.news.is_watched()
    }

    /// Sets another sample and shows it undeformed: points, m, outward triangles among them, names of its targets.
    pub fn model(&self, points: &[[f64; 3]], triangles: &[[u32; 3]], targets: &[String]) {
        let model = Model { surface: Surface::new(points, triangles), targets: targets.to_vec() };
        *self.model.lock().unwrap_or_else(PoisonError::into_inner) = model;
        self.tissue(0, &[], &[]);
    }

    /// Shows the sample at one time: displacement of each of the model's points and position of each target, m.
    pub fn tissue(&self, stamp_nanos: i64, displacements: &[[f64; 3]], targets: &[[f64; 3]]) {
        let model = self.model.lock().unwrap_or_else(PoisonError::into_inner);
        let surface = packet("POLYDATA", "Sample", stamp_nanos, &model.surface.message(displacements));
        let named = (!targets.is_empty()).then(|| points(&model.targets, targets));
        drop(model);
        self.put(Place::Surface, surface);
        if let Some(body) = named {
            self.put(Place::Targets, packet("POINT", "Targets", stamp_nanos, &body));
        }
    }

    /// Shows the instrument. An unchanged instrument is not sent again.
    pub(super) fn instrument(&self, at: &Instrument) {
        self.put(Place::Instrument, packet("TRANSFORM", "NeedleToSample", at.stamp_nanos, &transform(at)));
    }

    fn put(&self, place: Place, packet: Packet) {
        self.news.put(place as usize, packet);
    }
}
