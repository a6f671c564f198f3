//! Messages: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/cdr.rs"]
mod cdr;

fuzz_target!(|data: &[u8]| cdr::exercise(data));
