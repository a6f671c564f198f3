//! ROS 2 over RustDDS, with the middleware in a process of its own.
//!
//! ```text
//! node: solver, state, tare, parameters, recording         middleware process: RustDDS
//!   Output, Service ──► link ──────── socket ────────────► publishers ──► network
//!   Input,  Service ◄── queues ◄── keeper ◄── socket ◄──── subscriptions, servers, who is matched
//! ```
//! RustDDS can be killed from outside: an interrupted poll ends its threads for good, a HEARTBEAT or DATA_FRAG that lies
//! about sizes makes it take gigabytes, a GAP that lies makes it deaf to a true writer. None of that may cost a twin
//! the state of its tissue. So the DDS lives in a child that has a limit of memory and is watched, by itself (`watch`)
//! and by the node (`keeper`). When it dies, goes deaf or was flooded, the next one makes the same endpoints.
//!
//! A program calls [`serve`] first of all in `main`, since a node starts its own program a second time. A node lists its
//! endpoints in a [`Plan`], one [`Inlets::mute`] or [`Inlets::mailbox`] for each in the same order, and
//! [`Middleware::start`]s. From then on [`Link::send`] never waits, and [`Mailbox`]es hold what has come.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod bell;
mod drops;
mod frames;
mod graph;
mod health;
pub mod hung;
mod keeper;
mod link;
mod loopback;
mod obituary;
mod outflow;
mod process;
mod prompt;
pub mod qos;
mod raw;
mod services;
mod session;
pub mod signals;
mod silence;
pub mod survey;
mod throttle;
mod uplink;
mod watch;
mod wire;
#[cfg(feature = "zenoh")]
mod zenoh;
#[cfg(not(feature = "zenoh"))]
#[path = "without_zenoh.rs"]
mod zenoh;

pub use bell::Bell;
pub use health::Health;
pub use keeper::Middleware;
pub use link::{Delivery, Inlets, Link, Mailbox, Unsent, cdr, publication};
pub use loopback::{is_own_machine_wide, whole_to_others};
pub use process::serve;
pub use raw::RawCdr;
pub use session::ZenohSession;
pub use throttle::Throttle;
pub use wire::{Endpoint, Guid, Head, Kind, Plan, Quality, Role, Stamp, publisher_of, times_of, wall_nanos};

use named_threads::ThreadError;

/// First argument of the program when it is to be a middleware process.
const ARGUMENT: &str = "__middleware";

/// Why the middleware can't be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GuardError {
    /// The system has no thread left.
    #[error(transparent)]
    Thread(#[from] ThreadError),
    /// The process could not make the endpoints; what and why, in full.
    #[error("{0}")]
    Refused(String),
}

/// The examples of README.md.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
