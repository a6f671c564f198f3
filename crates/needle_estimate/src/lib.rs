//! Predicted against measured.
//!
//! [`compare`] drives a twin with a recording and judges what comes out; [`mod@calibrate`] finds the values of scene keys with
//! which a recorded force is met, and [`layers`] the tissue's layers; [`batch`] does so for hundreds of recordings.
#![allow(non_snake_case)] // the code uses the formula's own symbols
#![forbid(unsafe_code)]

pub mod batch;
pub mod cache;
pub mod calibrate;
pub mod compare;
pub mod layers;
