//! Parameter files: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/parameter_file.rs"]
mod parameter_file;

fuzz_target!(|data: &[u8]| parameter_file::exercise(data));
