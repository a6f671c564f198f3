//! Contract of scenes that can't be: the message names the key, its value, what is allowed and where it stands.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::scenes::{assert_names, minimal_with, refusal};
use needle_core::scene::{InstrumentKind, Override, Scene, keys};

#[test]
fn unknown_keys_are_named_with_the_nearest() {
    let message = refusal(minimal_with("[instrument]\nkind = \"plate\"\n[stepping]\ntolerence = 0.1\n"));
    assert_names(&message, &["mine.toml:14", "stepping.tolerence", "0.1", "stepping.tolerance", "(0, 1)"]);
    let message = refusal(Scene::preset("indentation").unwrap().with(&[Override::text(
        "material.poison_ratio",
        "0.49",
        "--set",
    )]));
    assert_names(&message, &["--set", "material.poison_ratio", "0.49", "material.poisson_ratio", "(-1, 0.5)"]);
    // The right key in the wrong section, and without its unit.
    let near = |path: &str| keys::nearest(path).map(|key| key.path);
    assert_eq!(near("sample.poisson_ratio"), Some("material.poisson_ratio"));
    assert_eq!(near("material.shear_modulus"), Some("material.shear_modulus_pa"));
    assert_eq!(near("depth_m"), Some("motion.depth_m"));
    assert_eq!(near("xyzzy"), None);
    let message = refusal(minimal_with("[gravity]\nx = 1\n"));
    assert_names(&message, &["unknown key gravity"]);
}

#[test]
fn values_out_of_range_are_named_with_the_range() {
    let needle = Scene::preset("needle_insertion").unwrap();
    for (path, value, parts) in [
        ("material.poisson_ratio", "0.5", &["0.5", "(-1, 0.5)", "bulk modulus", "infinite"] as &[&str]),
        ("material.poisson_ratio", "-1", &["-1", "(-1, 0.5)"]),
        ("material.poisson_ratio", "nan", &["nan", "(-1, 0.5)"]),
        ("material.poisson_ratio", "0.49991", &["0.49991", "(-1, 0.4999]", "round-off"]),
        ("material.poisson_ratio", "0.49999999999999994", &["(-1, 0.4999]"]),
        ("material.shear_modulus_pa", "-5", &["-5", "(0, ", "Pa"]),
        ("material.shear_modulus_pa", "soft", &["soft", "text", "number in"]),
        ("discretisation.spacing_m", "0", &["0.0", "(0, "]),
        ("discretisation.spacing_m", "-0.001", &["-0.001", "(0, "]),
        ("discretisation.spacing_m", "inf", &["inf", "(0, "]),
        ("discretisation.points_per_cell", "2", &["2", "1, 4, 5"]),
        ("discretisation.method", "mlms", &["mlms", "mmls, mls, tet4", "did you mean"]),
        ("stepping.max_steps_per_pose", "0", &["0", "[1, "]),
        ("stepping.max_steps_per_pose", "1.5", &["1.5", "whole number"]),
        ("motion.retract", "perhaps", &["perhaps", "true or false"]),
        ("targets.0.position_m", "1, 2", &["1, 2", "three finite numbers"]),
        ("motion.depth_m", "-0.004", &["-0.004", "[0, "]),
        ("motion.depth_m", "NaN", &["nan", "[0, "]),
    ] {
        let message = refusal(needle.with(&[Override::text(path, value, "--set")]));
        assert_names(&message, &[&["--set", path], parts].concat());
    }
}

#[test]
fn parts_that_contradict_each_other_are_refused() {
    let needle = Scene::preset("needle_insertion").unwrap();
    for (changes, parts) in [
        (&[("motion.depth_m", "0.017")] as &[_], &["motion.depth_m", "sample.height_m", "0.017"] as &[&str]),
        (&[("targets.0.position_m", "[0.02, 0, 0]")], &["targets.0.position_m", "on_path", "outside"]),
        (&[("targets.1.name", "on_path")], &["targets.1.name", "on_path"]),
        (&[("targets.9.name", "a")], &["targets.9.name", "targets.3"]),
        (&[("instrument.kind", "indenter"), ("instrument.diameter_m", "0.031")], &["diameter_m", "0.031", "0.03 m"]),
        (&[("instrument.entry_x_m", "0.0149")], &["entry point", "beyond"]),
        (&[("instrument.capture_radius_m", "0.0004")], &["capture_radius_m", "0.0005"]),
        (&[("stepping.min_steps_per_pose", "9999")], &["min_steps_per_pose", "max_steps_per_pose"]),
        (&[("motion.speed_m_per_s", "1e-9")], &["motion.speed_m_per_s", "poses"]),
        (&[("discretisation.spacing_m", "0.009")], &["spacing_m", "too coarse", "0.0085"]),
        (
            &[("discretisation.dimension", "axisymmetric"), ("instrument.entry_y_m", "0.001")],
            &["discretisation.dimension", "axis"],
        ),
    ] {
        let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "--set")).collect();
        assert_names(&refusal(needle.with(&changes)), parts);
    }
}

#[test]
fn absurdly_small_spacing_says_what_it_would_need() {
    let scene = Scene::preset("indentation").unwrap();
    let message = refusal(scene.with(&[Override::text("discretisation.spacing_m", "1e-6", "--set")]));
    assert_names(&message, &["discretisation.spacing_m", "1e-6", "nodes", "GB", "at least"]);
    // What the message offers is then accepted.
    let offered = message.rsplit("at least ").next().and_then(|rest| rest.split(' ').next()).unwrap();
    scene.with(&[Override::text("discretisation.spacing_m", offered, "--set")]).unwrap_or_else(|e| panic!("{e}"));
}

#[test]
fn keys_of_another_kind_are_refused_in_a_file_and_fall_away_with_set() {
    let plate = "[instrument]\nkind = \"plate\"\ncapture_radius_m = 0.001\n";
    let message = refusal(minimal_with(plate));
    assert_names(&message, &["mine.toml:13", "instrument.capture_radius_m", "0.001", "plate", "needle"]);
    let needle = Scene::preset("needle_insertion").unwrap();
    let indenter = needle.with(&[Override::text("instrument.kind", "indenter", "--set")]).unwrap();
    assert!(matches!(indenter.instrument.map(|i| i.kind), Some(InstrumentKind::Indenter { .. })));
    let message = refusal(needle.with(&[
        Override::text("instrument.kind", "plate", "--set"),
        Override::text("instrument.capture_radius_m", "0.001", "--set"),
    ]));
    assert_names(&message, &["--set", "instrument.capture_radius_m", "plate"]);
    let message = refusal(needle.with(&[Override::text("sample.shape", "box", "--set")]));
    assert_names(&message, &["sample.size_x_m", "missing", "box"]);
}

#[test]
fn what_is_missing_is_named() {
    assert_names(&refusal(Scene::from_toml("", "empty.toml")), &["empty.toml", "sample.height_m", "missing"]);
    assert_names(&refusal(minimal_with("[motion]\n")), &["motion.depth_m", "missing"]);
    assert_names(&refusal(minimal_with("[instrument]\n")), &["instrument.kind", "missing", "plate, indenter, needle"]);
    assert_names(&refusal(minimal_with("[[targets]]\nname = \"a\"\n")), &["targets.0.position_m", "missing"]);
    assert_names(&refusal(minimal_with("[[targets]]\n")), &["targets.0.name", "missing"]);
}

#[test]
fn what_is_not_toml_is_named_with_its_line() {
    assert_names(
        &refusal(Scene::from_toml("name = \"a\"\nthis is not TOML\n", "bad.toml")),
        &["bad.toml:2:", "not TOML"],
    );
    assert_names(&refusal(Scene::from_toml("name = \"a\"\nname = \"b\"\n", "twice.toml")), &["twice.toml:2:"]);
    assert_names(&refusal(minimal_with("[sample]\n")), &["mine.toml:11"]);
    assert_names(&refusal(Scene::from_toml("sample = 3", "flat.toml")), &["flat.toml:1", "a table [sample]"]);
    assert_names(&refusal(Scene::from_toml("[targets]\nname = \"a\"", "t.toml")), &["t.toml:1", "[[targets]]"]);
    assert_names(&refusal(minimal_with("[stepping]\ntolerance = [1, 2]\n")), &["stepping.tolerance", "a list"]);
    assert_names(&refusal(minimal_with("[stepping]\ntolerance = 1979-05-27\n")), &["stepping.tolerance", "a date"]);
    assert_names(&refusal(minimal_with("[stepping.tolerance]\nx = 1\n")), &["stepping.tolerance", "a table"]);
}
