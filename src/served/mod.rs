//! Common part of a run's servers: a thread with its own runtime, and the newest content for connected clients.

mod news;
mod service;

#[cfg(feature = "page")]
pub use news::Newest;
pub use news::{News, Seat};
pub use service::{Service, accept, bind};
