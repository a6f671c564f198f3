//! Samples of several materials: against the references, against one material, and what a scene may say of regions.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Dimension, Override, Scene, SceneError};
use needle_core::twin::{Phase, StampedPose, Twin};
use testkit::coarse::{alone, travel};

const SAMPLE: &str = "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.030\nheight_m = 0.017\n[material]\nmodel = \
    \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n";
// The references know no wall.
const DISC: &str = "[instrument]\nkind = \"indenter\"\ndiameter_m = 0.010\nwall_contact = false\n[discretisation]\nspacing_m = 1.9e-3\n\
    edge_refinement = 0.08\ngrowth = 0.28\n";
const NEEDLE: &str = "[instrument]\nkind = \"needle\"\ndiameter_m = 0.001\ncapture_radius_m = 0.0005\n\
    deformation_coefficient = 0.4\n[discretisation]\nspacing_m = 2.33e-3\nedge_refinement = 0.11\ngrowth = 0.3\n";
const PLATE: &str =
    "[instrument]\nkind = \"plate\"\n[discretisation]\nspacing_m = 1.58e-3\nedge_refinement = 0.3\ngrowth = 0.3\n";

fn material(name: &str, shear_modulus_pa: f64) -> String {
    format!("[materials.{name}]\nmodel = \"neo_hookean\"\nshear_modulus_pa = {shear_modulus_pa}\n")
}

fn layer(name: &str, material: &str, from_m: f64, to_m: f64) -> String {
    format!(
        "[[regions]]\nname = \"{name}\"\nmaterial = \"{material}\"\nshape = \"layer\"\nfrom_depth_m = {from_m}\nto_depth_m = {to_m}\n"
    )
}

fn sphere(x_m: f64, z_m: f64) -> String {
    format!(
        "[[regions]]\nname = \"lump\"\nmaterial = \"hard\"\nshape = \"sphere\"\ncentre_m = [{x_m}, 0, {z_m}]\nradius_m = 0.003\n"
    )
}

fn three_layers() -> String {
    let materials = material("soft", 839.0) + &material("stiff", 5034.0);
    SAMPLE.to_owned() + &materials + &layer("top", "stiff", 0.0, 0.002) + &layer("middle", "soft", 0.002, 0.007)
}

fn scene(parts: &[&str]) -> Result<Scene, SceneError> {
    Scene::from_toml(&parts.concat(), "regions.toml")
}

fn targets(heights_mm: &[f64]) -> String {
    let one = |z: &f64| format!("[[targets]]\nname = \"z{z}\"\nposition_m = [0, 0, {}]\n", z * 1e-3);
    heights_mm.iter().map(one).collect()
}

/// Rows of a reference: depth, force, uncertainty, displacements.
fn reference(case: &str) -> Vec<Vec<f64>> {
    let path = format!("{}/bags/reference/{case}.csv", testkit::root().display());
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect()
}

/// Moves through the depths of a reference; `force` and `displacement` are the bounds, of the force and of the depth.
fn compare(case: &str, scene: &Scene, force: impl Fn(f64) -> f64, displacement: f64) {
    let mut twin = alone(|| Twin::new(scene).unwrap());
    assert_eq!(twin.dimension(), Dimension::Axisymmetric, "{case}: {}", twin.dimension_because());
    let (mut depth, mut places) = (0.0, Vec::new());
    for row in reference(case) {
        let poses = ((row[0] - depth) / 1e-6).round() as u32;
        let predicted = travel(&mut twin, depth, row[0], poses).last().unwrap().force_n[2];
        depth = row[0];
        let error = predicted / row[1] - 1.0;
        println!("{case} at {:.2} mm: {:+.2} %", 1e3 * depth, 1e2 * error);
        assert!(error.abs() < force(depth), "{case} at {depth} m: {error:+.4}");
        twin.target_positions(&mut places);
        for ((target, place), wanted) in scene.targets.iter().zip(&places).zip(&row[3..]) {
            let off = (place[2] - target.position[2] - wanted) / depth;
            assert!(off.abs() < displacement, "{case} at {depth} m, {}: {off:+.4} of the depth", target.name);
        }
    }
}

#[test]
fn a_layered_sample_under_an_indenter_has_the_reference_force_and_displacements() {
    let scene = scene(&[&three_layers(), DISC, &targets(&[15.0, 10.0])]).unwrap();
    // the reference's pressure is continuous, and its force 1.2 % too small at 1 mm: layers.rs holds another to 1 %
    compare("layered_indentation", &scene, |_| 0.0125, 0.01);
}

#[test]
fn a_needle_through_layers_has_the_reference_force() {
    let scene = scene(&[&three_layers(), NEEDLE]).unwrap();
    compare("layered_needle", &scene, |depth| if depth < 0.003 { 0.03 } else { 0.015 }, 0.0);
}

#[test]
fn an_inclusion_under_an_indenter_has_the_reference_force_and_displacements() {
    let scene =
        scene(&[SAMPLE, &material("hard", 8390.0), &sphere(0.0, 0.01), DISC, &targets(&[13.0, 10.0, 7.0])]).unwrap();
    compare("inclusion_indentation", &scene, |_| 0.01, 0.01);
}

/// In three dimensions, in larger poses.
fn in_space(case: &str, scene: &Scene, deepest: f64, force: f64, displacement: f64) {
    let full = Override::text("discretisation.dimension", "full", "test");
    let mut twin = alone(|| Twin::new(&scene.with(&[full]).unwrap()).unwrap());
    let (mut depth, mut places, mut steps) = (0.0, Vec::new(), Vec::new());
    for row in reference(case).iter().filter(|row| row[0] <= deepest) {
        let poses = ((row[0] - depth) / 5e-6).round() as u32;
        let answers = travel(&mut twin, depth, row[0], poses);
        steps.extend(answers.iter().map(|a| f64::from(a.steps)));
        let predicted = answers.last().unwrap().force_n[2];
        depth = row[0];
        let error = predicted / row[1] - 1.0;
        println!("{case} in space at {:.2} mm: {:+.2} %", 1e3 * depth, 1e2 * error);
        assert!(error.abs() < force, "{case} at {depth} m: {error:+.4}");
        twin.target_positions(&mut places);
        for ((target, place), wanted) in scene.targets.iter().zip(&places).zip(&row[3..]) {
            let off = (place[2] - target.position[2] - wanted) / depth;
            assert!(off.abs() < displacement, "{case} at {depth} m, {}: {off:+.4} of the depth", target.name);
        }
    }
    // one material takes 3
    let steps = steps.iter().sum::<f64>() / steps.len() as f64;
    println!("{case} in space: {steps:.1} steps per pose");
    assert!(steps < 12.0, "{steps}");
}

#[test]
fn layers_in_space_have_the_reference_force_and_displacements() {
    let scene = scene(&[&three_layers(), DISC, &targets(&[15.0, 10.0])]).unwrap();
    in_space("layered_indentation", &scene, 0.001, 0.015, 0.015);
}

#[test]
fn an_inclusion_in_space_has_the_reference_force_and_displacements() {
    let scene =
        scene(&[SAMPLE, &material("hard", 8390.0), &sphere(0.0, 0.01), DISC, &targets(&[13.0, 10.0, 7.0])]).unwrap();
    in_space("inclusion_indentation", &scene, 0.001, 0.015, 0.015);
}

#[test]
fn an_inclusion_in_compression_has_the_reference_force() {
    let scene = scene(&[SAMPLE, &material("hard", 16_780.0), &sphere(0.0, 0.0085), PLATE]).unwrap();
    compare("inclusion_compression", &scene, |_| 0.01, 0.0);
}

#[test]
fn a_skin_under_a_blunt_needle_has_the_reference_force() {
    let skin = material("skin", 16_780.0) + &layer("skin", "skin", 0.0, 0.0005);
    let scene = scene(&[SAMPLE, &skin, &DISC.replace("0.010", "0.001")]).unwrap();
    // as above: 2.5 % too small at 0.25 mm
    compare("membrane_indentation", &scene, |_| 0.03, 0.0);
}

/// A layer of the same constants, against no layer: what the interface itself costs in accuracy.
#[test]
fn an_interface_between_equals_is_not_felt() {
    let force = |text: &str| {
        let mut twin = alone(|| Twin::new(&scene(&[text]).unwrap()).unwrap());
        travel(&mut twin, 0.0, 0.002, 2000).last().unwrap().force_n[2]
    };
    let rest = DISC.replace("1.9e-3", "0.8e-3");
    let layered = SAMPLE.to_owned() + &material("same", 1678.0) + &layer("middle", "same", 0.002, 0.007) + &rest;
    let ratio = force(&layered) / force(&(SAMPLE.to_owned() + &rest));
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
}

/// A hundred times softer or stiffer neighbours, to the depth that one material reaches.
#[test]
fn any_ratio_of_moduli_is_stable() {
    for modulus in [16.78, 167_800.0] {
        let scene = scene(&[SAMPLE, &material("hard", modulus), &sphere(0.0, 0.01), DISC]).unwrap();
        let mut twin = alone(|| Twin::new(&scene).unwrap());
        let answers = travel(&mut twin, 0.0, 0.010, 10_000);
        assert!(answers.iter().all(|a| a.force_n[2].is_finite() && a.health.min_jacobian > 0.05), "{modulus}");
    }
}

/// In space, the top layer of `study stability` that is a hundred times as soft: it is squeezed out from under the disc as in the half plane.
/// With one cell across and a point each the disc went through it from 3 mm on: 30 % too little force at 4 mm, and none at 6 mm.
#[test]
fn a_layer_a_hundred_times_as_soft_is_squeezed_out_in_space() {
    let sample = |modulus: f64, dimension: &str| {
        let text = SAMPLE.to_owned() + &material("soft", modulus) + &layer("top", "soft", 0.0, 0.002);
        let keys = [("discretisation.spacing_m", "0.00304"), ("discretisation.dimension", dimension)];
        let keys = keys.map(|(key, value)| Override::text(key, value, "test"));
        let walled = DISC.replace("wall_contact = false\n", "");
        alone(|| Twin::new(&scene(&[&text, &walled]).unwrap().with(&keys).unwrap()).unwrap())
    };
    let forces = |dimension: &str| {
        let mut twin = sample(16.78, dimension);
        let answers = travel(&mut twin, 0.0, 0.004, 1000);
        [749, 999].map(|i: usize| answers[i].force_n[2])
    };
    let ([half_3, half_4], [space_3, space_4]) = (forces("axisymmetric"), forces("full"));
    println!("at 3 and 4 mm: {half_3} {half_4} N in the half plane, {space_3} {space_4} N in space");
    assert!((space_3 / half_3 - 1.0).abs() < 0.12 && (space_4 / half_4 - 1.0).abs() < 0.06, "{space_3} {space_4}");
    // four points in each of its cells; a layer five times as soft has one
    for (modulus, more) in [(16.78, 3), (336.0, 0)] {
        let twin = sample(modulus, "full");
        let soft = twin.cell_regions().iter().filter(|r| **r == 1).count();
        assert_eq!(twin.integration_points(), twin.cells().len() + more * soft);
    }
}

/// Materials and regions that hold nothing change no bit.
#[test]
fn a_scene_of_one_material_computes_the_same_bits() {
    let bits = |text: &str| {
        let mut twin = alone(|| Twin::new(&scene(&[SAMPLE, text, DISC]).unwrap()).unwrap());
        travel(&mut twin, 0.0, 1e-4, 100).last().unwrap().force_n.map(f64::to_bits)
    };
    assert_eq!(bits(""), bits(&material("unused", 5.0)));
}

/// What is rigid stands still: tissue over it is thinner.
#[test]
fn bone_stands_still() {
    let force = |text: &str| {
        let mut twin = alone(|| Twin::new(&scene(&[SAMPLE, text, DISC]).unwrap()).unwrap());
        travel(&mut twin, 0.0, 0.001, 1000).last().unwrap().force_n[2]
    };
    let bone = "[materials.bone]\nrigid = true\n".to_owned() + &layer("bone", "bone", 0.010, 0.017);
    let thinner = SAMPLE.replace("0.017", "0.010");
    let mut twin = alone(|| Twin::new(&scene(&[&thinner, DISC]).unwrap()).unwrap());
    let expected = travel(&mut twin, 0.0, 0.001, 1000).last().unwrap().force_n[2];
    assert!((force(&bone) / expected - 1.0).abs() < 0.01, "{} {expected}", force(&bone));
}

/// Neither a plate on bone nor a needle into it has a force.
#[test]
fn no_instrument_goes_into_bone() {
    let bone = |from: f64, to: f64| "[materials.bone]\nrigid = true\n".to_owned() + &layer("bone", "bone", from, to);
    for (tool, from, reached) in [(DISC, 0.0, 0.0), (PLATE, 0.0, 0.0), (NEEDLE, 0.004, 0.0039)] {
        let coarse = tool.replace("0.08\n", "0.4\n").replace("0.11\n", "0.4\n");
        let mut twin = alone(|| Twin::new(&scene(&[SAMPLE, &bone(from, from + 0.002), &coarse]).unwrap()).unwrap());
        let mut step = |depth: f64| twin.step(StampedPose { time_s: 0.0, pose: twin.pose_at_depth(depth) });
        assert!(step(reached).is_ok(), "{tool}");
        let refused = step(from + 1e-4).unwrap_err().to_string();
        assert!(refused.contains("bone") && refused.contains("rigid"), "{refused}");
    }
}

#[test]
fn regions_on_the_axis_keep_the_half_plane_and_others_say_why_not() {
    let of = |region: &str| scene(&[SAMPLE, &material("hard", 8390.0), region, DISC]).unwrap().dimension();
    assert_eq!(of(&sphere(0.0, 0.01)).dimension, Dimension::Axisymmetric);
    assert_eq!(of(&layer("skin", "hard", 0.0, 0.001)).dimension, Dimension::Axisymmetric);
    let beside = of(&sphere(0.002, 0.01));
    assert_eq!(beside.dimension, Dimension::Mirrored);
    assert!(beside.because.contains("lump") && beside.because.contains("axis"), "{}", beside.because);
    let cuboid = "[[regions]]\nname = \"b\"\nmaterial = \"hard\"\nshape = \"box\"\ncentre_m = [0, 0, 0.01]\nsize_m = [0.002, 0.002, 0.002]\n";
    assert!(of(cuboid).because.contains("box"));
}

/// A needle's tip comes through the layers; an indenter's stays before the first one.
#[test]
fn the_tip_is_in_the_region_at_its_depth() {
    let along = |tool: &str| {
        let twin = alone(|| Twin::new(&scene(&[&three_layers(), tool]).unwrap()).unwrap());
        assert_eq!(twin.cell_regions().len(), twin.cells().len());
        twin.along().clone()
    };
    let (needle, disc) = (along(NEEDLE), along(DISC));
    let at = |depth: f64| needle.name(depth, Phase::Penetration);
    assert_eq!([0.0, 0.0019, 0.0021, 0.0069, 0.0071].map(at), ["top", "top", "middle", "middle", "sample"]);
    assert_eq!([needle.name(0.003, Phase::Indentation), needle.name(-0.001, Phase::Approach)], ["top", ""]);
    assert_eq!(disc.name(0.004, Phase::Indentation), "top");
}

#[test]
fn wrong_regions_are_refused_by_name() {
    let refused = |text: &str| {
        scene(&[SAMPLE, &material("fat", 500.0), &material("skin", 9e3), text, DISC]).unwrap_err().to_string()
    };
    let group = "[[regions]]\nname = \"t\"\nmaterial = \"fat\"\nshape = \"group\"\ngroup = \"tumour\"\n";
    for (text, wanted) in [
        (layer("top", "muscle", 0.0, 0.002), &["regions.top.material", "muscle", "fat, skin"][..]),
        (layer("top", "fat", 0.003, 0.002), &["regions.top.to_depth_m", "0.003"]),
        (layer("deep", "fat", 0.02, 0.03), &["regions.deep.from_depth_m", "below the sample"]),
        (layer("a.b", "fat", 0.0, 0.002), &["letters, digits"]),
        (layer("top", "fat", 0.0, 4e-8), &["regions.top.to_depth_m", "4.000e-8 m thick", "4.250e-5 m"]),
        (layer("top", "fat", 1e-5, 0.002), &["regions.top.to_depth_m", "0 and 0.00001 m"]),
        (
            layer("top", "fat", 0.0, 0.002) + &layer("low", "skin", 0.00201, 0.004),
            &["regions.top.to_depth_m", "between the depths 0.002 and 0.00201 m"],
        ),
        (layer("top", "fat", 0.0, 0.002).repeat(2), &["two regions"]),
        (group.to_owned(), &["regions.t.shape", "mesh"]),
        (layer("top", "fat", 0.0, 0.002).replace("to_depth_m", "to_dept_m"), &["to_dept_m", "regions.NAME.to_depth_m"]),
    ] {
        let message = refused(&text);
        assert!(wanted.iter().all(|w| message.contains(w)), "{message}");
    }
}

/// The first that fits wins, so a second layer may begin a little above the end of the first.
#[test]
fn layers_may_overlap_by_next_to_nothing() {
    let two = layer("top", "skin", 0.0, 0.002) + &layer("low", "fat", 0.00199, 0.004);
    scene(&[SAMPLE, &material("fat", 500.0), &material("skin", 9e3), &two, DISC]).unwrap();
}

#[test]
fn keys_of_materials_and_regions_are_set_by_their_dotted_paths() {
    let scene = scene(&[&three_layers(), DISC]).unwrap();
    let set = |path: &str, value: &str| scene.with(&[Override::text(path, value, "test")]);
    let changed = set("materials.soft.shear_modulus_pa", "900").unwrap();
    assert_eq!(changed.get("materials.soft.shear_modulus_pa").unwrap().as_real(), Some(900.0));
    assert_eq!(
        set("regions.top.to_depth_m", "0.001").unwrap().get("regions.top.to_depth_m").unwrap().as_real(),
        Some(0.001)
    );
    let yeoh = [("model", "yeoh"), ("c10_pa", "300"), ("c20_pa", "100")];
    let yeoh = yeoh.map(|(key, value)| Override::text(&format!("materials.soft.{key}"), value, "test"));
    assert_eq!(scene.with(&yeoh).unwrap().materials[0].material.shear_modulus(), 600.0);
    assert!(set("materials.bone.rigid", "true").unwrap_err().to_string().contains("soft, stiff"));
    assert!(set("regions.skin.material", "soft").unwrap_err().to_string().contains("top, middle"));
    assert!(set("material.c10_pa", "1").unwrap_err().to_string().contains("mooney_rivlin"));
    assert_eq!(Scene::from_toml(&scene.to_toml(), "again").unwrap().regions, scene.regions, "in their order");
}
