//! Bags and their metadata: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/mcap.rs"]
mod mcap;
#[path = "../../tests/fuzz/selection.rs"]
mod selection;

fuzz_target!(|data: &[u8]| mcap::exercise(data));
