//! The twin as a ROS 2 node.

use std::process::ExitCode;

fn main() -> ExitCode {
    ros2_guarded::serve(std::env::args_os())
        .unwrap_or_else(|| ExitCode::from(needle_twin::ros::twin_node::run(std::env::args_os().skip(1))))
}
