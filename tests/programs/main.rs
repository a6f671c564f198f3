//! What a user types and what is written for him, run as programs.

mod accuracy_study;
mod bad_input;
mod batch;
mod bending;
mod calibrate;
mod cli;
mod cluster;
mod crossings;
mod demo;
mod determinism;
mod docs;
mod doctor;
mod ensemble;
mod forecast;
mod growth;
mod guarded;
mod import;
mod layers;
mod layers_found;
mod live_page;
mod markers;
mod matrix;
mod meshes;
mod packages;
mod phantoms;
mod plan;
mod python_module;
mod readme;
mod recorded;
mod replay;
mod report;
mod report_browser;
#[path = "../rig_bag/mod.rs"]
mod rig_bag;
mod shell;
mod strangers;
#[path = "../synthetic_run/mod.rs"]
mod synthetic_run;
mod tissues;
mod tune;
mod urdf;
mod verdict;
mod vtu;
#[path = "../wrong/mod.rs"]
mod wrong;
