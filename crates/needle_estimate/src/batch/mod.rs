//! Many recordings, one answer: each is replayed or calibrated on its own, with each of some candidate models; what the samples have
//! in common is then taken from the rows alone.
//!
//! A recording's row depends on nothing but its line of the manifest, its file and its scene, so a shard of a manifest can run
//! anywhere, twice, or after a crash: the rows are the same to the last bit.

mod choice;
mod curve;
mod fit;
mod job;
mod manifest;
mod merge;
mod mixed;
mod pool;
mod row;
mod tables;
mod together;

pub use curve::Curve;
pub use job::Job;
pub use manifest::{Candidate, Entry, Manifest, ManifestError};
pub use merge::{MergeError, Merged, ROWS, SAMPLES, merge, read, read_sample, sealed};
pub use pool::{Group, Pooled, Sample};
pub use row::{Fit, HeldOut, Key, Row};
pub use tables::{Needed, Tables};
pub use together::{JointFit, SampleJob, SampleRow};
