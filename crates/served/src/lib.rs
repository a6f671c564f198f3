//! Common part of a run's servers: a thread with its own runtime, and the newest content for connected clients.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod news;
mod service;

pub use news::{Newest, News, Seat};
pub use service::{Service, accept, bind};
