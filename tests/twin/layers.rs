//! Layers and a skin against finite elements whose pressure jumps at interfaces as it does in the tissue (`tests/references/layers.py`).
//!
//! The elements of `bags/reference` have a continuous pressure, which costs them about 1 % of the force there (docs/lab/layers.md).
#![allow(clippy::unwrap_used)]

use crate::coarse::{Quiet, alone};
use needle_twin::study::verification::Verification;

fn within(case: &'static str, bound: f64) {
    let path = format!("{}/tests/references/layers.csv", env!("CARGO_MANIFEST_DIR"));
    let table = std::fs::read_to_string(path).unwrap();
    let rows = table.lines().filter_map(|line| line.strip_prefix(&format!("{case},")));
    let rows: Vec<[f64; 2]> = rows
        .map(|row| row.split_once(',').map(|(depth, force)| [depth, force].map(|x| x.parse().unwrap())).unwrap())
        .collect();
    let deepest = rows.last().unwrap()[0];
    let run = alone(|| Verification::run(case, &[], Some(deepest), &mut Quiet).unwrap()).run;
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
            needle_twin::study::composites::Composite::find("layered_indentation").unwrap().scene().unwrap().to_toml();
        let mut scene = needle_twin::scene::Scene::from_toml(&text, "layers").unwrap();
        scene.materials.sort_by_key(|m| first.iter().position(|f| *f == m.name));
        let mut twin = alone(|| needle_twin::twin::Twin::new(&scene).unwrap());
        crate::coarse::press(&mut twin, 0.001).force_n[2]
    };
    let (one, other) = (of(["stiff", "soft"]), of(["soft", "stiff"]));
    assert!((one / other - 1.0).abs() < 1e-3, "{one} {other}");
}
