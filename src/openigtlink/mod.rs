//! What 3D Slicer and other programs for image-guided therapy see of a run, by OpenIGTLink over TCP: the instrument's transform,
//! the deformed surface, the targets.
//!
//! ```text
//! tissue thread ──newest surface, targets──► board ──► link thread ──► clients (TCP)
//!       newest answer ──instrument, 100 Hz──────────────────┘
//! ```
//! Clients read only: what they send is dropped. One that is slow gets the newest when it is ready, and nobody waits for it. Lengths are
//! mm, as in every program that speaks this protocol, in frame `sample` taken for right, anterior, superior. Nothing is to be made
//! while [`Board::is_watched`] says no.
//!
//! The crate `openigtlink-rust` (0.4.1) is not used: its POLYDATA has another layout than the protocol's, and it brings TLS in C
//! (docs/lab/libraries.md).

mod board;
mod error;
mod message;
mod server;

pub use board::{Board, CLIENTS};
pub use error::LinkError;
pub use message::Instrument;
pub use server::Server;
