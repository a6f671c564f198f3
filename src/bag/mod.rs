//! rosbag2 folders with MCAP storage: reading, writing, checking, and making synthetic recordings of the rig.

mod check;
mod chunk;
pub mod embedded;
mod error;
mod folder;
mod index;
pub mod make;
mod messages;
mod metadata;
mod qos;
mod reader;
mod record;
mod recording;
mod schema;
mod segment;
mod series;
mod source;
mod space;
mod writer;

pub use check::{CheckReport, Finding, Severity, check};
pub use error::{BagError, Loss};
pub use messages::Messages;
pub use metadata::Metadata;
pub use qos::{Qos, QosTime};
pub use reader::{BagReader, Message, Topic};
pub use recording::{DepthSample, ForceSample, PoseSample, Recording, TopicNames};
pub use schema::{Schema, missing_types, recorded_types, schema};
pub use writer::{BagWriter, TopicId, WriterOptions, Written};
