//! The twin, the rig and the guard as ROS 2 nodes, with their own DDS (no ROS installation needed).
//!
//! The functions that every ROS 2 program needs are in the crate `ros2_node`.

pub(crate) mod guard_node;
pub(crate) mod observer;
pub mod rig_node;
mod scene_parameters;
pub mod twin_node;

use clap::Parser;
use ros2_node::start::{SUCCESS, Start, USAGE};

/// The program's own arguments, or the exit code where they ask for help or are wrong.
fn own_arguments<C: Parser>(program: &str, start: &mut Start) -> Result<C, u8> {
    C::try_parse_from(std::iter::once(program.to_owned()).chain(start.own.drain(..))).map_err(|help| {
        let _ = help.print();
        if help.use_stderr() { USAGE } else { SUCCESS }
    })
}
