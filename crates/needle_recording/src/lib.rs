//! Input of a twin: depths, poses and forces, from live or recorded messages and from tables.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod adapter;
mod align;
mod clocks;
mod error;
mod force_series;
mod foreign;
mod frame;
mod holes;
mod import;
mod middle;
mod order;
mod reading;
mod readings;
mod recording;
mod sample;
mod selection;
mod series;
mod table;
mod thin;
mod topics;
mod unit;
mod write;
mod zigzag;

pub use adapter::{Adapter, Refusal, Tools, orientation};
pub use error::RecordingError;
pub use force_series::ForceSeries;
pub use foreign::ForeignError;
pub use foreign::{ForceSource, Holds, POSES, Posed, PositionSource, WRENCHES};
pub use frame::FrameError;
pub use import::{Extent, Import, Imported};
pub use reading::{At, Reading};
pub use recording::{Recording, is_bag, tables};
pub use sample::{DepthSample, ForceSample, MarkerSample, PoseSample};
pub use selection::{NotHere, Quantity, Selection, TableLayout, TopicNames, UnknownUnit};
pub use table::TableError;
pub use table::{Clock, Column, Columns, Table, blocks};
pub use unit::Dimension;
