//! OpenIGTLink server over TCP: sends the instrument's transform, the deformed surface and the targets of a run to 3D
//! Slicer and other programs for image-guided therapy.
//!
//! ```text
//! tissue thread ──newest surface, targets──► board ──► link thread ──► clients (TCP)
//!       newest answer ──instrument, 100 Hz──────────────────┘
//! ```
//! Clients only receive: what they send is discarded. A slow client gets the newest content when it is ready, and
//! nobody waits for it. Lengths are in mm, as in all programs with this protocol, in frame `sample` taken as right,
//! anterior, superior. No content needs to be produced while [`Board::is_watched`] is false.
//!
//! The crate `openigtlink-rust` (0.4.1) is not used: its POLYDATA has another layout than the protocol's, and it
//! depends on TLS in C (docs/lab/libraries.md).
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod board;
mod error;
mod message;
mod server;

pub use board::Board;
pub use error::LinkError;
pub use message::Instrument;
pub use server::Server;
