//! rosbag2 folders with MCAP storage: reading, salvage of what is damaged, writing, checking.
//!
//! A bag is a folder with `metadata.yaml` and one or more `.mcap` files, or one such file alone. [`BagReader`] opens it
//! and says what of it is lost, [`BagWriter`] makes one, [`check()`] looks for what other readers would refuse.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod check;
mod checksum;
mod chunk;
mod error;
mod folder;
mod index;
mod messages;
mod metadata;
mod options;
mod qos;
mod reader;
mod record;
mod segment;
mod source;
mod space;
mod writer;

pub use check::{CheckReport, Finding, Severity, check};
pub use error::{BagError, Loss};
pub use messages::Messages;
pub use metadata::Metadata;
pub use options::WriterOptions;
pub use qos::Qos;
pub use qos::QosTime;
pub use reader::{BagReader, Message, Topic};
pub use writer::{BagWriter, TopicId, Written};

/// The examples of README.md.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
