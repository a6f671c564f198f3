//! Meshes of VTK: no input panics, hangs or takes much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/fuzz/mesh.rs"]
mod mesh;

fuzz_target!(|data: &[u8]| mesh::exercise("fuzz.vtu", data));
