//! Contract of hexahedra inside a body that tetrahedra fill: the cells are the body, a linear field and a linear patch come out as they are,
//! and forces are those of tetrahedra alone, with the same bits on one thread and two.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene, file};
use needle_core::twin::{Body, Twin};
use testkit::coarse;

const LESION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/meshes/lesion.toml");
const HEXAHEDRA: (&str, &str) = ("discretisation.cells", "hexahedra");
const ONE_POINT: (&str, &str) = ("discretisation.points_per_hexahedron", "1");

fn with(scene: &Scene, changes: &[(&str, &str)]) -> Scene {
    let changes: Vec<Override> = changes.iter().map(|(key, value)| Override::text(key, value, "test")).collect();
    scene.with(&changes).unwrap()
}

/// The organ of three materials, filled.
fn lesion(changes: &[(&str, &str)]) -> Scene {
    let outline = [
        ("sample.shape", "outline"),
        ("discretisation.dimension", "full"),
        ("discretisation.spacing_m", "0.005"),
        ("discretisation.edge_refinement", "0.1"),
        ("discretisation.growth", "0.4"),
        ("discretisation.support_factor", "1.6"),
        ("motion.depth_m", "0.010"),
    ];
    with(&file::load(LESION).unwrap(), &[&outline, changes].concat())
}

/// Poses on the way to a depth.
const POSES: u32 = 40;

/// Answers on the way to a depth, m, on so many threads, and the number of integration points.
fn pressed(scene: &Scene, depth_m: f64, threads: usize) -> (Vec<f64>, Vec<String>, usize) {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
        let mut twin = Twin::new(scene).unwrap();
        let answers = coarse::travel(&mut twin, 0.0, depth_m, POSES);
        let forces = answers.iter().map(|a| a.force_n[2]).collect();
        (forces, coarse::digits(&answers), twin.integration_points())
    })
}

#[test]
fn an_organ_with_bricks_has_its_volume_and_each_brick_one_material() {
    let (scene, plain) = (lesion(&[HEXAHEDRA]), lesion(&[]));
    let (body, tetrahedra) = (Body::new(&scene).unwrap(), Body::new(&plain).unwrap());
    let whole = |body: &Body| body.cloud.volumes().iter().sum::<f64>();
    let (volumes, region) = (body.cloud.volumes(), body.regions(&scene));
    let bricks = &body.cloud.hexahedra;
    let within: f64 = bricks.iter().flat_map(|h| &h.cells).map(|&c| volumes[c as usize]).sum();
    println!("{} bricks, {:.2} of the volume, {} cells", bricks.len(), within / whole(&body), body.cloud.cells.len());
    assert!(within > 0.1 * whole(&body), "{within} m^3");
    assert!((whole(&body) / whole(&tetrahedra) - 1.0).abs() < 0.005, "{} m^3", whole(&body));
    for h in bricks {
        assert!(h.cells.iter().all(|&c| region[c as usize] == region[h.cells[0] as usize]));
        assert!(h.cells.iter().all(|&c| body.cloud.cells[c as usize].iter().all(|n| h.corners.contains(n))));
    }
    assert!(tetrahedra.cloud.hexahedra.is_empty());
}

#[test]
fn an_organ_with_bricks_has_the_force_of_its_tetrahedra_on_any_number_of_threads() {
    let depth_m = 0.006;
    let (plain, _, cells) = pressed(&lesion(&[("discretisation.cells_per_point", "1")]), depth_m, 1);
    let eight = lesion(&[HEXAHEDRA]);
    let (force, digits, points) = pressed(&eight, depth_m, 1);
    assert_eq!(pressed(&eight, depth_m, 2).1, digits);
    let (of_one, _, fewer) = pressed(&lesion(&[HEXAHEDRA, ONE_POINT]), depth_m, 1);
    assert!(fewer < points && fewer < cells, "{fewer}, {points}, {cells} points");
    for k in [POSES as usize / 2 - 1, POSES as usize - 1] {
        let [eight, one] = [&force, &of_one].map(|f| f[k] / plain[k] - 1.0);
        println!("pose {k}: 8 points {:+.2} %, 1 point {:+.2} %", 100.0 * eight, 100.0 * one);
        assert!(eight.abs() < 0.02 && one.abs() < 0.04, "{eight}, {one}");
    }
}

/// Force along the instrument at rest, N.
fn at_rest(scene: &Scene, depth_m: f64) -> f64 {
    coarse::alone(|| coarse::press(&mut Twin::new(scene).unwrap(), depth_m).force_n[2])
}

#[test]
fn a_needle_has_bricks_beside_its_path_and_in_half_a_sample() {
    const TILTED: [(&str, &str); 2] = [("instrument.tilt_rad", "0.15"), ("discretisation.dimension", "mirrored")];
    let preset = with(&Scene::preset("needle_insertion").unwrap(), &[("discretisation.dimension", "full")]);
    for changes in [&[][..], &TILTED] {
        let (plain, scene) = (with(&preset, changes), with(&preset, &[changes, &[HEXAHEDRA]].concat()));
        let body = Body::new(&scene).unwrap();
        let own = body.cloud.hexahedra.len();
        let off = at_rest(&scene, 0.002) / at_rest(&plain, 0.002) - 1.0;
        println!("{own} bricks, {:+.2} % of tetrahedra", 100.0 * off);
        assert!(own > 50 && off.abs() < 0.02, "{own} bricks, {off}");
        if body.mirror.is_some() {
            let whole = body.whole().cloud;
            assert_eq!(whole.hexahedra.len(), 2 * own);
            for h in &whole.hexahedra {
                assert!(h.cells.iter().all(|&c| whole.cells[c as usize].iter().all(|n| h.corners.contains(n))));
            }
        }
    }
}

#[test]
fn a_body_without_room_for_a_brick_is_refused() {
    let scene = coarse::scene("needle_insertion", &[HEXAHEDRA, ("discretisation.spacing_m", "0.008")]);
    let said = Twin::new(&scene).unwrap_err().to_string();
    assert!(said.contains("discretisation.cells") && said.contains("spacing_m"), "{said}");
}
