//! Nodes on a ROS 2 graph, seen by independent peers.

/// Over DDS.
const ZENOH: bool = false;

#[path = "../common/chromium.rs"]
mod chromium;
#[path = "../fuzz/command_line.rs"]
mod command_line;
mod fast_dds;
mod faults;
mod identify;
mod idle;
mod live_page;
mod long_run;
mod look_ahead;
mod middleware_process;
mod openigtlink;
mod package;
mod rig_foreign;
mod rig_peer;
#[path = "../common/ros.rs"]
mod ros;
mod ros2_control;
mod ros_arguments;
mod ros_node;
mod ros_peer;
mod ros_two_hosts;
mod strangers;
