//! What the servers of a run share: a thread with a runtime of its own, and the newest of what is shown, for whoever has a seat.

mod news;
mod service;

#[cfg(feature = "page")]
pub use news::Newest;
pub use news::{News, Seat};
pub use service::{Service, accept, bind};
