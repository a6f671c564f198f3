//! What the twin computes: each contract a module, one program for all, since linking costs more than running.

mod abuse;
mod assimilation;
mod axisymmetric;
mod bricks;
#[path = "../../crates/mtled/tests/clouds/mod.rs"]
mod clouds;
#[path = "../coarse/mod.rs"]
mod coarse;
#[path = "../common/mod.rs"]
mod common;
mod contact;
mod correction;
mod coulomb_ball;
mod crossings;
mod deformation_coefficient;
mod determinism;
mod door;
mod ensemble;
mod folds;
mod force_balance;
mod frictional_oblique;
mod guarded;
mod half_plane;
mod invariance;
mod layer_calibration;
mod layers;
mod layers_found;
mod least_work;
mod mesh_files;
mod mesh_hexahedra;
mod mesh_import;
mod mirrored;
mod moved_cloud;
mod needle_capture;
mod needle_friction;
mod needle_motion;
mod needle_oblique;
mod needle_resistance;
mod needle_sideways;
mod needle_wall;
mod outline;
mod regions;
mod relaxation;
mod scene_properties;
mod scene_refusals;
mod scenes;
mod siblings;
mod stable_step;
mod support_nodes;
mod supports;
mod sweep;
mod symmetry;
#[path = "../synthetic_run/mod.rs"]
mod synthetic_run;
mod teams;
mod torque;
mod twin;
mod vector_fit;
mod verification;
