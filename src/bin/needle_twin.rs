//! The command line of needle_twin; `needle_twin --help` says what it does.

use std::process::ExitCode;

fn main() -> ExitCode {
    ros2_guarded::serve(std::env::args_os()).unwrap_or_else(|| needle_twin::cli::run(std::env::args_os()))
}
