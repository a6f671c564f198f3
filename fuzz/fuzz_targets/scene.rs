//! Scenes and changes to them: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/scene.rs"]
mod scene;

fuzz_target!(|data: &[u8]| scene::exercise(data));
