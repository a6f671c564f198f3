//! The newest of what clients see.

use std::sync::{Mutex, PoisonError};

use tokio::sync::watch;

use super::message::{Instrument, Packet, Surface, packet, points, transform};

/// Most clients at a time.
pub const CLIENTS: usize = 16;

/// In the order in which they are sent.
#[derive(Clone, Copy)]
enum Place {
    Instrument,
    Surface,
    Targets,
}

pub(super) const PLACES: usize = 3;

/// What stands in each place, and how often it was replaced.
pub(super) type Newest = [(u64, Option<Packet>); PLACES];

/// What does not change of a sample.
#[derive(Debug, Default)]
struct Model {
    surface: Surface,
    targets: Vec<String>,
}

/// See the module.
#[derive(Debug)]
pub struct Board {
    newest: watch::Sender<Newest>,
    clients: watch::Sender<usize>,
    model: Mutex<Model>,
}

impl Default for Board {
    fn default() -> Self {
        let (newest, clients) = (watch::Sender::new(Newest::default()), watch::Sender::new(0));
        Self { newest, clients, model: Mutex::default() }
    }
}

impl Board {
    /// Whether anybody is connected.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        *self.clients.borrow() > 0
    }

    /// Takes another sample and shows it undeformed: points, m, outward triangles among them, names of its targets.
    pub fn model(&self, points: &[[f64; 3]], triangles: &[[u32; 3]], targets: &[String]) {
        let model = Model { surface: Surface::new(points, triangles), targets: targets.to_vec() };
        *self.model.lock().unwrap_or_else(PoisonError::into_inner) = model;
        self.tissue(0, &[], &[]);
    }

    /// Shows the sample at a moment: displacement of each of the model's points and place of each target, m.
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

    /// Shows the instrument. The same again is no news.
    pub(super) fn instrument(&self, at: &Instrument) {
        self.put(Place::Instrument, packet("TRANSFORM", "NeedleToSample", at.stamp_nanos, &transform(at)));
    }

    fn put(&self, place: Place, packet: Packet) {
        self.newest.send_if_modified(|newest| {
            let (version, stands) = &mut newest[place as usize];
            let changed = stands.as_ref() != Some(&packet);
            if changed {
                (*version, *stands) = (*version + 1, Some(packet));
            }
            changed
        });
    }

    pub(super) fn listen(&self) -> watch::Receiver<Newest> {
        self.newest.subscribe()
    }

    /// The number of clients, as it changes.
    pub(super) fn count(&self) -> watch::Receiver<usize> {
        self.clients.subscribe()
    }

    /// A seat, if one is free. It has to be given back by [`Self::leave`].
    pub(super) fn enter(&self) -> bool {
        self.clients.send_if_modified(|n| {
            let free = *n < CLIENTS;
            *n += usize::from(free);
            free
        })
    }

    /// Gives a seat back.
    pub(super) fn leave(&self) {
        self.clients.send_modify(|n| *n = n.saturating_sub(1));
    }
}
