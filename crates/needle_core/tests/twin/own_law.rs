//! Contract of own laws: the built-in law as a user would write it has the built-in law's bits; the example's stiffens; it stays when keys
//! change, and what it has replaced can't be set.
#![allow(clippy::unwrap_used)]

use example::Demiray;
use mtled::material::{MooneyRivlin, Own};
use needle_core::scene::Scene;
use needle_core::twin::{Prediction, Twin};
use testkit::coarse::{alone, digits, scene, travel};

#[path = "../../examples/twin_of_own_law.rs"]
#[allow(dead_code)]
mod example;

fn pressed(scene: &Scene) -> Vec<Prediction> {
    travel(&mut Twin::new(scene).unwrap(), 0.0, 0.002, 40)
}

#[test]
fn a_law_as_a_user_writes_it_has_the_built_in_ones_bits() {
    alone(|| {
        let mooney = [("material.model", "mooney_rivlin"), ("material.c10_pa", "539"), ("material.c01_pa", "300")];
        for further in [&[][..], &[("material.prony_shares", "[0.4]"), ("material.prony_times_s", "[0.2]")]] {
            let built_in = scene("compression", &[&mooney[..], further].concat());
            let mut own = scene("compression", further);
            own.material.own = Some(Own::new(&MooneyRivlin { c10: 539.0, c01: 300.0 }));
            assert_eq!(own.material.shear_modulus(), built_in.material.shear_modulus());
            assert_eq!(digits(&pressed(&own)), digits(&pressed(&built_in)));
        }
    });
}

#[test]
fn the_examples_law_stiffens() {
    alone(|| {
        let neo_hookean = scene("compression", &[]);
        let force = |stiffening: f64| {
            let mut own = neo_hookean.clone();
            own.material.own = Some(Own::new(&Demiray { mu: neo_hookean.material.shear_modulus(), stiffening }));
            pressed(&own).last().unwrap().force_n[2]
        };
        let [plain, soft, stiff] = [pressed(&neo_hookean).last().unwrap().force_n[2], force(1e-3), force(10.0)];
        assert!((soft / plain - 1.0).abs() < 1e-3, "{soft} N, {plain} N");
        assert!(stiff > 1.05 * plain, "{stiff} N, {plain} N");
    });
}

#[test]
fn an_own_law_stays_when_keys_change_and_its_model_cannot_be_set() {
    let mut own = scene("compression", &[]);
    own.material.own = Some(Own::new(&Demiray { mu: 1000.0, stiffening: 3.0 }));
    own.set("material.poisson_ratio", "0.45").unwrap();
    assert_eq!((own.material.shear_modulus(), own.material.own.is_some()), (1000.0, true));
    for (key, value) in [("material.model", "yeoh"), ("material.shear_modulus_pa", "2000")] {
        assert!(own.set(key, value).unwrap_err().to_string().contains("law of the caller's own"), "{key}");
    }
    assert!(own.to_toml().starts_with("# "), "a file says that it has lost the law");
}
