//! Studies against independent solutions: each contract a module, one program for all, since linking costs more than running.

mod assimilation;
mod correction;
mod layer_calibration;
mod layers;
mod moved_cloud;
mod siblings;
mod verification;
