//! Scenes on a mesh from the command line: the mesh is found from anywhere, and what is written is read back.
#![allow(clippy::unwrap_used)]

use crate::synthetic_run;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use needle_core::mesh;
use tempfile::TempDir;
use testkit::python::run_script;

#[test]
fn the_scene_of_a_mesh_can_be_moved() {
    let folder = TempDir::new().unwrap();
    let scene = folder.path().join("organ.toml");
    run_script("../examples/meshes/organ.py", &[&folder.path().join("organ.msh"), Path::new("3")]);
    fs::copy(testkit::root().join("examples/meshes/organ.toml"), &scene).unwrap();
    let needle_twin = || Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    let out = needle_twin().args(["scene", "check"]).arg(&scene).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(said.contains("ok, about "), "{said}");
    // also after `show --set` has moved the scene
    let shown = needle_twin().args(["scene", "show", "--set", "motion.depth_m=0.001"]).arg(&scene).output().unwrap();
    let elsewhere = TempDir::new().unwrap();
    fs::write(elsewhere.path().join("moved.toml"), shown.stdout).unwrap();
    needle_twin().args(["scene", "check"]).arg(elsewhere.path().join("moved.toml")).assert().success();
}

#[test]
fn our_own_vtu_is_read_back() {
    let folder = TempDir::new().unwrap();
    let run = synthetic_run::needle(10.0);
    let path = folder.path().join("final.vtu");
    fs::write(&path, needle_report::final_vtu(&run).unwrap()).unwrap();
    let mesh = mesh::read(&path, &[]).unwrap();
    assert_eq!((mesh.points, mesh.cells), (run.final_state.points, run.final_state.cells));
    assert_eq!(mesh.known_groups, ["jacobian", "von_mises_pa"]);
}
