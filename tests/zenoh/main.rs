//! Contract: with the feature `zenoh` and RMW_IMPLEMENTATION=rmw_zenoh_cpp the nodes do over Zenoh what they do over DDS, on the wire of
//! ROS 2's rmw_zenoh_cpp. The tests of topics, parameters, services, lifecycle, recordings and the rig are those of `tests/ros`, seen by
//! another peer.

/// Over Zenoh.
const ZENOH: bool = true;

#[path = "../ros/ros_node/events.rs"]
mod events;
mod faults;
mod latency;
#[path = "../ros/ros_node/lifecycle.rs"]
mod lifecycle;
#[path = "../ros/look_ahead.rs"]
mod look_ahead;
#[path = "../ros/ros_node/outputs.rs"]
mod outputs;
#[path = "../ros/ros_node/recording.rs"]
mod recording;
#[path = "../ros/rig_peer.rs"]
mod rig_peer;
#[path = "../common/ros.rs"]
mod ros;
#[path = "../ros/ros_peer.rs"]
mod ros_peer;
#[path = "../ros/ros_node/time.rs"]
mod time;
mod wire;
