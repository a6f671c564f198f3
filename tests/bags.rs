//! Bags: independent programs read ours field by field; the shipped ones are what they say; damage is contained.

#[path = "bags/damage.rs"]
mod damage;
#[path = "bags/interchange.rs"]
mod interchange;
#[path = "bags/recorder.rs"]
mod recorder;
#[path = "bags/recordings.rs"]
mod recordings;
