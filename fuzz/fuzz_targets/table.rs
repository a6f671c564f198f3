//! Tables as text: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/selection.rs"]
mod selection;
#[path = "../../tests/fuzz/table.rs"]
mod table;

fuzz_target!(|data: &[u8]| table::exercise(data));
