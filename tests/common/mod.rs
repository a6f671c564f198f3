//! What several tests need: a Python with the packages of independent implementations, and random messages.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)] // each test file takes what it needs; a test may fail loudly

pub mod python;
pub mod random;
