//! Input of a twin: depths, poses and forces, from live or recorded messages and from tables.
#![forbid(unsafe_code)]

mod adapter;
mod align;
mod clocks;
mod force_series;
mod foreign;
mod frame;
mod holes;
mod order;
mod reading;
mod readings;
mod recording;
mod selection;
mod series;
mod table;
mod topics;
mod unit;
mod write;

pub use adapter::{Adapter, Refusal};
pub use force_series::ForceSeries;
pub use foreign::{ForceSource, ForeignError, PositionSource};
pub use frame::FrameError;
pub use reading::{At, Reading};
pub use recording::{
    DepthSample, ForceSample, MarkerSample, PoseSample, Recording, RecordingError, TopicNames, is_bag, tables,
};
pub use selection::{Quantity, Selection, TableLayout, UnknownUnit};
pub use table::{Clock, Column, Columns, Table, TableError, blocks};
pub use unit::Dimension;
