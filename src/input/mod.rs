//! What comes in: depths, poses and forces, from messages live or recorded.

mod adapter;
mod order;
mod recording;
mod series;

pub use adapter::{Adapter, Refusal};
pub use recording::{DepthSample, ForceSample, PoseSample, Recording, TopicNames};
