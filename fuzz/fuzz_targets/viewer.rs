//! A viewer's message to the live page: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/viewer.rs"]
mod viewer;

fuzz_target!(|data: &[u8]| viewer::exercise(data));
