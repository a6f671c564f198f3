//! Contract of imported meshes: what Gmsh and meshio write is read, the same indentation gives the same force as the
//! own cloud, and a file that can't be used is refused with what, where and what to do.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::{Path, PathBuf};
use testkit::coarse;

use needle_core::mesh::{self, Wanted};
use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use tempfile::TempDir;
use testkit::python::run_script;

pub const WANTED: Wanted<'_> = Wanted { unit_m: 0.001, base: "base", contact: Some("contact") };

/// A preset on a mesh in mm.
pub fn on_mesh(preset: &str, mesh: &Path, changes: &[(&str, &str)]) -> Scene {
    let of_mesh = [("sample.shape", "mesh"), ("sample.mesh", mesh.to_str().unwrap()), ("sample.mesh_unit_m", "0.001")];
    let all = of_mesh.iter().chain(changes).map(|(path, value)| Override::text(path, value, "test"));
    Scene::preset(preset).unwrap().with(&all.collect::<Vec<_>>()).unwrap()
}

/// Makes a mesh with one of the example scripts.
fn gmsh(script: &str, folder: &TempDir, size: &str) -> PathBuf {
    let out = folder.path().join(script).with_extension("msh");
    run_script(&format!("../examples/meshes/{script}"), &[&out, Path::new(size)]);
    out
}

/// Forces at every half millimetre down to 2 mm, N.
fn forces(scene: &Scene) -> Vec<f64> {
    let mut twin = Twin::new(scene).unwrap();
    println!("{} nodes, {} cells", twin.nodes(), twin.cells().len());
    let answers = coarse::travel(&mut twin, 0.0, 0.002, 200);
    answers.iter().skip(49).step_by(50).map(|a| a.force_n[2]).collect()
}

#[test]
fn a_gmsh_cylinder_has_the_force_of_the_own_cloud() {
    let folder = TempDir::new().unwrap();
    let mesh = gmsh("cylinder.py", &folder, "1.45");
    // tight, so that what is compared is the clouds and not the inertia of large steps
    let tight = ("stepping.tolerance", "0.002");
    let own = Scene::preset("indentation").unwrap().with(&[Override::text(tight.0, tight.1, "test")]).unwrap();
    let own = forces(&own);
    let imported = forces(&on_mesh("indentation", &mesh, &[tight]));
    for (i, (a, b)) in imported.iter().zip(&own).enumerate() {
        let off = 100.0 * (a / b - 1.0);
        println!("{:.1} mm: mesh {a:.5} N, own cloud {b:.5} N, {off:+.2} %", 0.5 * (i + 1) as f64);
        assert!(off.abs() < 3.0, "{off} %");
    }
    assert_eq!(imported.len(), 4);
}

#[test]
fn an_organ_is_solved() {
    let folder = TempDir::new().unwrap();
    let mesh = gmsh("organ.py", &folder, "3");
    let text = fs::read_to_string(testkit::root().join("examples/meshes/organ.toml")).unwrap();
    let read = Scene::from_toml(&text, "organ.toml").unwrap();
    let mut twin =
        Twin::new(&read.with(&[Override::text("sample.mesh", mesh.to_str().unwrap(), "test")]).unwrap()).unwrap();
    assert!((twin.pose_at_depth(0.0).tip[2] - 0.015).abs() < 5e-5, "the top of the ellipsoid");
    let answers = coarse::travel(&mut twin, 0.0, 0.001, 50);
    let force = answers.last().unwrap().force_n[2];
    // Between a punch of radius a on a half space, 4 mu a U / (1 - nu), and a few times that for the thin body.
    let half_space = 4.0 * 1678.0 * 0.004 * 0.001 / 0.51;
    println!("organ: {force:.4} N at 1 mm; half space {half_space:.4} N");
    assert!(force > 0.8 * half_space && force < 4.0 * half_space, "{force} against {half_space}");
    assert!(answers.iter().all(|a| a.force_n.iter().all(|f| f.is_finite())));
}

#[test]
fn a_mesh_of_three_volume_groups_is_shipped_and_its_regions_are_met_by_the_needle() {
    let path = testkit::root().join("examples/meshes/lesion.toml");
    let scene = needle_core::scene::file::load(path.to_str().unwrap()).unwrap();
    let mut twin = Twin::new(&scene).unwrap();
    let name = |depth: f64| twin.along().name(depth, needle_core::twin::Phase::Penetration).to_owned();
    assert_eq!([0.005, 0.015, 0.0205].map(name), ["sample", "tumour", "sample"]);
    let regions: std::collections::BTreeSet<u8> = twin.cell_regions().iter().copied().collect();
    assert_eq!(regions.len(), 3, "organ, tumour and vessel");
    assert!(twin.reach_m() > 0.020, "to 20 mm: {}", twin.reach_m());
    let answers = coarse::travel(&mut twin, 0.0, 2e-4, 40);
    assert!(answers.last().unwrap().force_n[2] > 0.0);
}

/// The preset's targets, moved into both meshes of these tests, whose units are mm.
pub const TARGETS: [(&str, &str); 3] = [
    ("targets.0.position_m", "[0.002, 0.001, 0.009]"),
    ("targets.1.position_m", "[0.003, 0.001, 0.005]"),
    ("targets.2.position_m", "[0.004, 0.001, 0.001]"),
];

#[test]
fn a_needle_goes_into_an_organ() {
    let folder = TempDir::new().unwrap();
    let mesh = gmsh("organ.py", &folder, "3");
    let changes = [("motion.depth_m", "0.003"), ("instrument.capture_radius_m", "0.0012")];
    let mut twin = Twin::new(&on_mesh("needle_insertion", &mesh, &[&TARGETS[..], &changes].concat())).unwrap();
    let answers = coarse::travel(&mut twin, 0.0, 0.003, 150);
    let forces: Vec<f64> = answers.iter().skip(49).step_by(50).map(|a| a.force_n[2]).collect();
    println!("needle into the organ at 1, 2 and 3 mm: {forces:.5?} N");
    assert!(answers.iter().any(|a| a.event.is_some()), "punctured");
    assert!(forces[0] > 0.0 && forces[1] > 1.2 * forces[0] && forces[2] > 1.2 * forces[1], "{forces:?}");
    let deep =
        on_mesh("needle_insertion", &mesh, &[&TARGETS[..], &changes[1..], &[("motion.depth_m", "0.019")]].concat());
    let message = Twin::new(&deep).unwrap_err().to_string();
    assert!(message.contains("motion.depth_m") && message.contains("too deep"), "{message}");
}

#[test]
fn vtu_of_meshio_is_the_same_cloud() {
    let folder = TempDir::new().unwrap();
    let msh = gmsh("organ.py", &folder, "6");
    run_script("meshes/to_vtu.py", &[&msh, folder.path()]);
    let (cloud, _) = mesh::load(&msh, &WANTED).unwrap();
    for form in ["plain", "zlib", "cells"] {
        let (other, _) = mesh::load(&folder.path().join(format!("{form}.vtu")), &WANTED).unwrap();
        assert_eq!(other, cloud, "{form}");
    }
    // text has fewer digits
    let (ascii, _) = mesh::load(&folder.path().join("ascii.vtu"), &WANTED).unwrap();
    assert_eq!((&ascii.cells, &ascii.faces, &ascii.surface), (&cloud.cells, &cloud.faces, &cloud.surface));
    let off = ascii.points.as_flattened().iter().zip(cloud.points.as_flattened()).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f64::max) < 1e-11);
}
