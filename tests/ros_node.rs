//! What a ROS user expects of a running node beside its topics, seen by an independent DDS implementation.

#[path = "ros_node/lifecycle.rs"]
mod lifecycle;
#[path = "ros_node/outputs.rs"]
mod outputs;
#[path = "ros_node/recording.rs"]
mod recording;
#[path = "common/ros.rs"]
mod ros;
#[path = "ros_node/services.rs"]
mod services;
#[path = "ros_node/time.rs"]
mod time;
#[path = "ros_node/voice.rs"]
mod voice;
