#![doc = include_str!("../README.md")]
#![allow(non_snake_case)] // the code uses the formula's own symbols: F, P, J
#![warn(unreachable_pub)] // public is what another crate can name
#![deny(unsafe_code, clippy::undocumented_unsafe_blocks, clippy::multiple_unsafe_ops_per_block)]

pub mod approximation;
pub mod material;
#[allow(unsafe_code)] // vector instructions
pub mod number;
mod shares;
pub mod solver;

pub use mtled_cloud as cloud;
pub use mtled_cloud::mirror;
use mtled_cloud::{grid, vector};
