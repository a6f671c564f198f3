//! The live page: a run in a browser, while it happens.
//!
//! ```text
//! other threads ──newest model, status, figures, tissue──► board ──► page thread ──► viewers (WebSocket)
//! who runs the twin ◄──────tare, reset, mark────────────── desk ◄──────┘
//! ```
//! Who shows something puts it on the [`Board`] and goes on; it replaces what stood there before. A viewer says when it is ready and
//! gets the newest of what it has not seen, so one that is slow sees less often and nobody waits for it. Nothing is to be made while
//! [`Board::is_watched`] says no.

mod board;
mod door;
mod error;
mod frame;
mod page;
mod request;
mod server;
mod viewer;

pub use board::{Board, PERIOD, VIEWERS};
pub use error::LiveError;
pub use frame::{Frame, Model};
pub use request::{Command, LONGEST_MARK, LONGEST_REQUEST, Request};
pub use server::{Asked, Server};
