//! Compares predicted with measured forces, and estimates parameters from them.
//!
//! [`compare`] drives a twin with a recording and judges the result. [`mod@calibrate`] identifies the values of scene
//! keys from a recorded force, and [`layers`] the tissue's layers. [`batch`] does this for hundreds of recordings.
#![allow(non_snake_case)] // the code uses the formula's own symbols
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

pub mod baseline;
pub mod batch;
pub mod cache;
pub mod calibrate;
pub mod compare;
pub mod forecast;
pub mod layers;
pub mod learnt_law;
pub mod live_spring;
pub mod plan;
pub mod prior;
pub mod shortfall;
