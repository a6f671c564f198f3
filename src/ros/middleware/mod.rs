//! The middleware in a process of its own.
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

mod graph;
mod health;
mod keeper;
mod link;
mod process;
mod services;
mod uplink;
mod watch;
mod wire;

pub(super) use health::Health;
pub(super) use keeper::Middleware;
pub(super) use link::{Delivery, Inlets, Link, Mailbox, Unsent, cdr, publication};
pub(super) use wire::{Endpoint, Head, Kind, Plan, Quality, Role, Stamp, times_of};

pub use process::serve;

/// First argument of the program when it is to be a middleware process.
const ARGUMENT: &str = "__middleware";
