//! `--ros-args` and parameter files: no input panics, hangs or gives a name that is none.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/command_line.rs"]
mod command_line;

fuzz_target!(|data: &[u8]| command_line::exercise(data));
