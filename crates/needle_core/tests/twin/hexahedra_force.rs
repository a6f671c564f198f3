//! Contract of hexahedra as background cells: the force on them is that of tetrahedra.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use crate::mesh_hexahedra::{CELLS, Kinds, cells, msh};
use crate::mesh_import::on_mesh;
use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use tempfile::TempDir;
use testkit::coarse::{self, alone};

/// The same with one volume group.
fn of_one_material(cells: &[(u32, Vec<usize>)]) -> String {
    msh(cells).replace("2 0 0 10 20 20 20 1 4 0", "2 0 0 10 20 20 20 1 3 0")
}

const HEXAHEDRA: (&str, &str) = ("discretisation.cells", "hexahedra");
const ONE_POINT: (&str, &str) = ("discretisation.points_per_hexahedron", "1");

/// Force at 1 mm, N, and number of integration points.
fn pressed(scene: &Scene) -> (f64, usize) {
    alone(|| {
        let mut twin = Twin::new(scene).unwrap();
        let force = coarse::travel(&mut twin, 0.0, 0.001, 100).last().unwrap().force_n[2];
        (force, twin.integration_points())
    })
}

#[test]
fn a_cube_of_hexahedra_has_the_force_of_its_tetrahedra() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("cube.msh");
    for kinds in [Kinds::Hexahedra, Kinds::Mixed] {
        fs::write(&path, of_one_material(&cells(kinds))).unwrap();
        let scene = |more: &[(&str, &str)]| {
            let all = [&[("discretisation.dimension", "full"), ("motion.depth_m", "0.002")], more].concat();
            on_mesh("compression", Path::new(&path), &all)
        };
        let (tetrahedra, _) = pressed(&scene(&[("discretisation.cells_per_point", "1")]));
        for volume_ratio in ["projected", "averaged", "mixed"] {
            let (force, points) = pressed(&scene(&[HEXAHEDRA, ("discretisation.volume_ratio", volume_ratio)]));
            println!("{volume_ratio}: {points} points, {:+.2} % of tetrahedra", 100.0 * (force / tetrahedra - 1.0));
            assert!((force / tetrahedra - 1.0).abs() < 0.06, "{volume_ratio}: {force} N, of tetrahedra {tetrahedra} N");
        }
        let (_, points) = pressed(&scene(&[HEXAHEDRA, ONE_POINT]));
        assert!(kinds == Kinds::Mixed || points == CELLS.pow(3), "{points}");
    }
}

#[test]
fn volume_groups_of_hexahedra_are_regions() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("cube.msh");
    fs::write(&path, msh(&cells(Kinds::Hexahedra))).unwrap();
    let text =
        fs::read_to_string(testkit::root().join("crates/needle_core/src/scene/presets/compression.toml")).unwrap();
    let regions = "\n[materials.stiff]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 8000.0\npoisson_ratio = 0.49\n\
                   density_kg_per_m3 = 970.0\n[[regions]]\nname = \"half\"\nshape = \"group\"\ngroup = \"upper\"\nmaterial = \"stiff\"\n";
    let sample = format!("shape = \"mesh\"\nmesh = \"{}\"\nmesh_unit_m = 0.001", path.display());
    let text = text.replace("shape = \"cylinder\"\ndiameter_m = 0.030\nheight_m = 0.017", &sample);
    let graded = |line: &&str| ["spacing_m", "edge_refinement", "growth"].iter().any(|key| line.starts_with(key));
    let text = text.lines().filter(|line| !graded(line)).collect::<Vec<_>>().join("\n") + regions;
    let of = |more: &[(&str, &str)]| {
        let full = [("discretisation.dimension", "full"), ("motion.depth_m", "0.002")];
        let all = full.iter().chain(more).map(|(key, value)| Override::text(key, value, "test"));
        Scene::from_toml(&text, "test").unwrap().with(&all.collect::<Vec<_>>()).unwrap()
    };
    let (tetrahedra, _) = pressed(&of(&[("discretisation.cells_per_point", "1")]));
    let (hexahedra, _) = pressed(&of(&[HEXAHEDRA]));
    println!("two materials: hexahedra {hexahedra} N, tetrahedra {tetrahedra} N");
    assert!((hexahedra / tetrahedra - 1.0).abs() < 0.06, "{hexahedra} N, {tetrahedra} N");
}

#[test]
fn generated_grids_have_the_force_of_the_half_plane_up_to_incompressibility() {
    for nu in ["0.49", "0.499", "0.4999"] {
        let scene = |more: &[(&str, &str)]| {
            let all = [("material.poisson_ratio", nu)]
                .into_iter()
                .chain(more.iter().copied())
                .map(|(k, v)| Override::text(k, v, "test"));
            Scene::preset("compression").unwrap().with(&all.collect::<Vec<_>>()).unwrap()
        };
        let coarse = [
            ("discretisation.spacing_m", "0.003"),
            ("discretisation.edge_refinement", "0.3"),
            ("discretisation.dimension", "full"),
        ];
        // at 0.4999 and 10 mm/s its force swings by 6 % with the steps that it takes by itself
        let (plane, _) = pressed(&scene(&[("stepping.tolerance", "0.001")]));
        let (grid, points) = pressed(&scene(&[&coarse[..], &[HEXAHEDRA]].concat()));
        let off = grid / plane - 1.0;
        println!("nu {nu}: {points} points, {:+.2} % of the half plane", 100.0 * off);
        assert!(off.abs() < 0.05, "nu {nu}: {grid} N, half plane {plane} N");
    }
}

#[test]
fn scenes_that_have_no_hexahedra_are_refused() {
    let set = |preset: &str, changes: &[(&str, &str)]| {
        let all = changes.iter().chain(&[HEXAHEDRA]).map(|(key, value)| Override::text(key, value, "test"));
        Scene::preset(preset).unwrap().with(&all.collect::<Vec<_>>()).map(|_| ()).map_err(|e| e.to_string())
    };
    let full = ("discretisation.dimension", "full");
    for (said, part) in [
        (set("compression", &[]), "discretisation.dimension = full"),
        (set("compression", &[full, ("discretisation.method", "tet4")]), "mmls or mls"),
    ] {
        let said = said.unwrap_err();
        assert!(said.contains("discretisation.cells") && said.contains(part), "\"{part}\" is not named in: {said}");
    }
    assert!(set("indentation", &[full]).is_ok());
    assert!(set("needle_insertion", &[full]).is_ok());
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("cube.msh");
    let tetrahedra: Vec<(u32, Vec<usize>)> = cells(Kinds::Hexahedra)
        .into_iter()
        .flat_map(|(_, c)| {
            let numbers: Vec<u32> = c.iter().map(|n| *n as u32).collect();
            mtled::cloud::hexahedron::cut(&numbers).into_iter().map(|t| (4, t.map(|n| n as usize).to_vec()))
        })
        .collect();
    fs::write(&path, of_one_material(&tetrahedra)).unwrap();
    let scene = on_mesh("compression", &path, &[full, HEXAHEDRA, ("motion.depth_m", "0.002")]);
    assert!(Twin::new(&scene).unwrap_err().to_string().contains("the mesh has no hexahedra"));
}
