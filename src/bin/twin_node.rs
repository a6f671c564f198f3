//! The twin as a ROS 2 node.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(needle_twin::ros::twin_node::run(std::env::args_os().skip(1)))
}
