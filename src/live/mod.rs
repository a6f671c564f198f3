//! The live page: shows a run in a browser while it happens.
//!
//! ```text
//! other threads ──newest model, status, figures, tissue──► board ──► page thread ──► viewers (WebSocket)
//! who runs the twin ◄──────tare, reset, mark────────────── desk ◄──────┘
//! ```
//! A writer puts its content on the [`Board`], replacing the previous content, and continues. A viewer reports when
//! it is ready and gets the newest content that it has not received. So a slow viewer gets fewer updates, and nobody
//! waits for it. No content needs to be produced while [`Board::is_watched`] is false.

mod board;
mod door;
mod error;
mod frame;
mod page;
mod request;
mod server;

pub use board::{Board, VIEWERS};
pub use error::LiveError;
pub use frame::{Frame, Model};
pub use request::{Command, LONGEST_MARK, Request};
pub use server::{Asked, Server};
