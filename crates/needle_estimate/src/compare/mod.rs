//! Predicted against measured force: the result of one run of the twin, and its figures of merit.

pub mod alignment;
mod coarse;
mod collector;
pub(crate) mod components;
pub mod crossing;
mod curve;
pub mod ensemble;
pub mod frozen;
pub mod identifier;
pub mod learning;
pub(crate) mod least_squares;
mod legs;
mod metrics;
pub mod path;
pub mod placement;
mod regions;
pub mod rows;
mod run;
pub mod scale;
mod session;
mod stability;
pub mod uncertainty;
pub mod verdict;
mod watch;

pub(crate) use collector::Collector;
pub use collector::Keep;
pub use curve::Curve;
pub use legs::{Legs, Pass, passes};
pub use metrics::{ForceMetrics, Latency, ModelError};
pub use regions::Depths;
pub use run::{Answer, FinalState, NeedleRow, Occurrence, Run, Snapshot, TargetRow};
pub use session::{Finished, Session, depths};
pub use stability::StabilityRow;
pub use verdict::{Explains, Verdict};
pub use watch::{Cancel, Watch};
