//! What comes in: depths, poses and forces, from messages of a recording.

mod recording;
mod series;

pub use recording::{DepthSample, ForceSample, PoseSample, Recording, TopicNames};
