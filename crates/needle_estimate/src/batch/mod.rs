//! Processes many recordings. Each is replayed or calibrated independently with each candidate model. Estimates for
//! samples and kinds of samples are then computed from the rows alone.
//!
//! A row depends only on the recording's manifest entry, its file and its scene. So a shard of a manifest can run on
//! any machine, twice, or after a crash: the rows are the same to the last bit.

mod choice;
mod fit;
mod job;
mod manifest;
mod merge;
mod mixed;
mod pool;
mod row;
mod tables;
mod together;

pub use job::Job;
pub use manifest::{Candidate, Entry, Manifest, ManifestError};
pub use merge::{MergeError, Merged, ROWS, SAMPLES, merge, read, read_sample, sealed};
pub use pool::{Group, Pooled, Sample};
pub use row::{Fit, HeldOut, Key, Row};
pub use tables::{Needed, Tables};
pub use together::JointFit;
pub use together::{SampleJob, SampleRow};
