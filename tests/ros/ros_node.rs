//! What a ROS user expects of a running node beside its topics, seen by an independent DDS implementation.

mod bending;
mod dump;
mod events;
mod frames;
mod lifecycle;
mod members;
mod outputs;
mod recording;
mod services;
mod time;
mod voice;
