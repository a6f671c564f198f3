//! What the twin computes: each contract a module, one program for all, since linking costs more than running.

mod abuse;
mod accuracy;
mod axisymmetric;
#[cfg(feature = "research")]
mod bricks;
#[path = "../../../mtled/tests/clouds/mod.rs"]
mod clouds;
mod contact;
mod coulomb_ball;
mod deformation_coefficient;
mod door;
mod force_balance;
mod frictional_oblique;
mod half_plane;
#[cfg(feature = "research")]
mod hexahedra_force;
mod invariance;
mod membranes;
mod mesh_files;
mod mesh_hexahedra;
mod mesh_import;
mod mirrored;
mod needle_bending;
mod needle_capture;
mod needle_friction;
mod needle_motion;
mod needle_oblique;
mod needle_resistance;
mod needle_sideways;
mod needle_wall;
mod outline;
mod own_instrument;
mod own_law;
mod plain_scenes;
mod regions;
mod relaxation;
mod research;
mod scene_properties;
mod scene_refusals;
mod scenes;
mod stable_step;
mod support_nodes;
mod supports;
mod sweep;
mod symmetry;
mod torque;
mod twin;
