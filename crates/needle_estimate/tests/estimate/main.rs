//! Runs, calibration, ensembles: each contract a module, one program for all, since linking costs more than running.

mod crossings;
mod determinism;
mod ensemble;
mod folds;
mod imbalance;
mod layers;
mod least_work;
mod teams;
mod vector_fit;
mod verdicts;
