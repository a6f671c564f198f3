//! A batch's manifest: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/manifest.rs"]
mod manifest;

fuzz_target!(|data: &[u8]| manifest::exercise(data));
