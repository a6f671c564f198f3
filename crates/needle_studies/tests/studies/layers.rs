//! Layers and a skin against finite elements whose pressure jumps at interfaces as it does in the tissue (`tests/references/layers.py`).
//!
//! The elements of `bags/reference` have a continuous pressure, which costs them about 1 % of the force there (docs/lab/layers.md).
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use needle_estimate::compare::Cancel;
use needle_studies::verification::Verification;
use testkit::coarse::{self, alone, rest, travel};

const EQUAL_LAYERS: &str = r#"
[materials.same]
model = "neo_hookean"
shear_modulus_pa = 1678.0
[[regions]]
name = "top"
material = "same"
shape = "layer"
from_depth_m = 0.0
to_depth_m = 0.002
"#;

fn within(case: &'static str, bound: f64) {
    let path = format!("{}/tests/references/layers.csv", testkit::root().display());
    let table = std::fs::read_to_string(path).unwrap();
    let rows = table.lines().filter_map(|line| line.strip_prefix(&format!("{case},")));
    let rows: Vec<[f64; 2]> = rows
        .map(|row| row.split_once(',').map(|(depth, force)| [depth, force].map(|x| x.parse().unwrap())).unwrap())
        .collect();
    let deepest = rows.last().unwrap()[0];
    let run = alone(|| Verification::run(case, &[], Some(deepest), &mut Cancel::default()).unwrap()).run;
    for [depth, wanted] in rows {
        let predicted = run.answers.iter().find(|a| a.depth_m >= depth * (1.0 - 1e-9)).unwrap().predicted_n;
        let error = predicted / wanted - 1.0;
        println!("{case} at {:.2} mm: {:+.2} %", 1e3 * depth, 1e2 * error);
        assert!(error.abs() < bound, "{case} at {depth} m: {error:+.4}");
    }
}

#[test]
fn an_indented_layered_sample_is_within_1_percent() {
    within("layered_indentation", 0.01);
}

#[test]
fn a_needle_through_layers_is_within_1_percent() {
    within("layered_needle", 0.01);
}

#[test]
fn a_skin_under_a_blunt_needle_is_within_2_percent() {
    within("membrane_indentation", 0.02);
}

/// What a region is called, and when it is named, is no matter of its force.
#[test]
fn the_order_of_materials_moves_no_force() {
    let of = |first: [&str; 2]| {
        let text =
            needle_studies::composites::Composite::find("layered_indentation").unwrap().scene().unwrap().to_toml();
        let mut scene = Scene::from_toml(&text, "layers").unwrap();
        scene.materials.sort_by_key(|m| first.iter().position(|f| *f == m.name));
        let mut twin = alone(|| Twin::new(&scene).unwrap());
        coarse::press(&mut twin, 0.001).force_n[2]
    };
    let (one, other) = (of(["stiff", "soft"]), of(["soft", "stiff"]));
    assert!((one / other - 1.0).abs() < 1e-3, "{one} {other}");
}

/// In three dimensions, against the given reference, whose pressure is continuous.
#[test]
fn a_needle_through_layers_in_space_is_within_3_percent() {
    let full = Override::text("discretisation.dimension", "full", "test");
    let found = alone(|| Verification::run("layered_needle", &[full], Some(0.004), &mut Cancel::default()).unwrap());
    assert_eq!(found.compared.len(), 2);
    for row in found.compared {
        println!("in space at {:.0} mm: {:+.2} %", 1e3 * row.depth_m, 1e2 * row.error());
        assert!(row.error().abs() < 0.03, "{row:?}");
    }
}

/// Where the modulus does not jump, an interface is none: this is what the radii next to one are chosen by.
#[test]
fn regions_of_one_modulus_have_the_force_of_no_regions_in_space() {
    // at rest; the needle's tip is at the interface, where what is captured changes sides: 2.5 % on this cloud
    for (preset, depth_m, bound) in [("indentation", 5e-4, 0.006), ("needle_insertion", 2e-3, 0.03)] {
        // supports of their own are wider where there is no region, and sums consistent
        let cloud = [("discretisation.spacing_m", "0.0025"), ("discretisation.edge_refinement", "0.1")];
        let none = coarse::scene(
            preset,
            &[&cloud[..], &[("discretisation.support_factor", "1.8"), ("discretisation.integration", "plain")]]
                .concat(),
        );
        let text = none.to_toml() + EQUAL_LAYERS;
        let layers = Scene::from_toml(&text, "equal").unwrap();
        let [none, layers] = [none, layers].map(|scene| {
            let mut twin = alone(|| Twin::new(&scene).unwrap());
            travel(&mut twin, 0.0, depth_m, (depth_m / 5e-6) as u32);
            // on the way the force of a single pose is good to 1 %
            let pose = twin.pose_at_depth(depth_m);
            rest(&mut twin, pose).force_n[2]
        });
        println!("{preset}: {:+.2} %", 1e2 * (layers / none - 1.0));
        assert!((layers / none - 1.0).abs() < bound, "{preset}: {layers} {none}");
    }
}
