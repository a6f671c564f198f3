//! The command line of needle_twin; `needle_twin --help` says what it does.

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(feature = "ros")]
    if let Some(code) = ros2_guarded::serve(std::env::args_os()) {
        return code;
    }
    needle_twin::cli::run(std::env::args_os())
}
