//! What tests of several crates share. Not published.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)] // a test may fail loudly
#![warn(unreachable_pub)] // what is pub is for another crate

pub mod coarse;
pub mod python;
pub mod random;

use std::path::{Path, PathBuf};

/// Root of the checkout.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap()
}

/// Folder of everything that is built in the running test's profile: `target/release`.
pub fn profile() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    // target/release/deps/name-hash
    test.ancestors().nth(2).unwrap().to_path_buf()
}
