//! What the servers of a run share: a thread with a runtime of its own, and the newest of what is shown, for whoever has a seat.

mod news;
mod service;

pub use news::{Newest, News, Seat};
pub use service::{Service, accept, bind};
