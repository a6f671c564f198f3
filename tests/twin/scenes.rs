//! Contract of scene files: presets load, every key can be set, a scene survives being written and read,
//! and nothing that a user can write makes the reader panic.
#![allow(clippy::unwrap_used, clippy::panic)]

use mtled::solver::{Precision, VolumeRatio};
use needle_twin::scene::keys::{self, KEYS};
use needle_twin::scene::{
    Dimension, InstrumentKind, Kind, Method, Override, PRESETS, Scene, SceneError, Shape, Value, Word,
};
use proptest::prelude::*;

const MINIMAL: &str = r#"
[sample]
diameter_m = 0.03
height_m = 0.017
[material]
shear_modulus_pa = 1678
poisson_ratio = 0.49
density_kg_per_m3 = 970
[discretisation]
spacing_m = 2e-3
"#;

fn minimal_with(more: &str) -> Result<Scene, SceneError> {
    Scene::from_toml(&format!("{MINIMAL}{more}"), "mine.toml")
}

/// The message of a scene that must be refused.
fn refusal(result: Result<Scene, SceneError>) -> String {
    match result {
        Ok(scene) => panic!("accepted: {scene:?}"),
        Err(error) => error.to_string(),
    }
}

fn assert_names(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "\"{part}\" is not named in: {message}");
    }
}

#[test]
fn presets_hold_what_the_paper_states() {
    assert_eq!(
        PRESETS.iter().map(|p| p.name).collect::<Vec<_>>(),
        ["compression", "indentation", "needle_insertion", "layered_tissue"]
    );
    for preset in &PRESETS[..3] {
        let scene = preset.scene().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(scene.name, preset.name);
        assert!(!scene.description.is_empty());
        assert_eq!(scene.material.shear_modulus(), 1678.0);
        assert_eq!(scene.material.poisson_ratio.get(), 0.49);
        assert_eq!(scene.material.density.get(), 970.0);
        assert!(
            matches!(scene.sample.shape, Shape::Cylinder { diameter, height } if diameter.get() == 0.03 && height.get() == 0.017)
        );
        assert_eq!(scene.discretisation.method, Method::Mmls);
        assert_eq!(scene.discretisation.dimension, Dimension::Auto);
    }
}

#[test]
fn presets_carry_their_instrument_and_depth() {
    let depth = |scene: &Scene| scene.motion.map(|m| m.depth.get());
    let compression = Scene::preset("compression").unwrap();
    assert_eq!(compression.instrument.map(|i| i.kind), Some(InstrumentKind::Plate));
    assert_eq!(depth(&compression), Some(0.0025));
    let indentation = Scene::preset("indentation").unwrap();
    assert_eq!(indentation.get("instrument.diameter_m"), Some(Value::Real(0.01)));
    assert_eq!(depth(&indentation), Some(0.01));
    let needle = Scene::preset("needle_insertion").unwrap();
    for (path, value) in [
        ("instrument.diameter_m", 1e-3),
        ("instrument.capture_radius_m", 5e-4),
        ("instrument.deformation_coefficient", 0.4),
        ("instrument.puncture_strain", 1e-6),
        ("motion.speed_m_per_s", 1e-3),
        ("motion.depth_m", 0.01),
    ] {
        assert_eq!(needle.get(path), Some(Value::Real(value)), "{path}");
    }
    assert!(needle.description.contains("Assumed"), "what is assumed is said: {}", needle.description);
    assert!(needle.targets.len() >= 2);
}

#[test]
fn what_is_absent_is_not_modelled() {
    let scene = minimal_with("").unwrap();
    assert_eq!(scene.name, "mine", "called after its file");
    assert_eq!(scene.instrument, None);
    assert_eq!(scene.motion, None);
    assert!(scene.targets.is_empty());
    assert_eq!(scene.material.shear_modulus(), 1678.0, "an integer is taken for a double");
}

#[test]
fn every_key_can_be_set_to_what_it_is() {
    let whole = Scene::preset("needle_insertion").unwrap();
    let cuboid = whole
        .with(&[
            Override::text("sample.shape", "box", "test"),
            Override::text("sample.size_x_m", "0.03", "test"),
            Override::text("sample.size_y_m", "0.02", "test"),
            Override::text("sample.base", "coulomb", "test"),
            Override::text("sample.base_friction_coefficient", "0.4", "test"),
            Override::text("instrument.kind", "indenter", "test"),
            Override::text("instrument.contact", "coulomb", "test"),
            Override::text("instrument.friction_coefficient", "0.2", "test"),
            Override::text("material.model", "ogden", "test"),
            Override::text("material.ogden_shear_moduli_pa", "1000, 678.5, 0.25", "test"),
            Override::text("material.ogden_exponents", "[2, -4.7, 10]", "test"),
            Override::text("material.prony_shares", "0.25", "test"),
            Override::text("material.prony_times_s", "[1.5]", "test"),
        ])
        .unwrap();
    let mesh = whole
        .with(&[
            Override::text("sample.shape", "mesh", "test"),
            Override::text("sample.mesh", "organs/liver.msh", "test"),
            Override::text("sample.mesh_unit_m", "0.001", "test"),
        ])
        .unwrap();
    assert_eq!(mesh.get("discretisation.spacing_m"), None, "the mesh brings its nodes");
    let laws: [&[(&str, &str)]; 3] = [
        &[("model", "mooney_rivlin"), ("c10_pa", "500.0"), ("c01_pa", "300.0")],
        &[("model", "yeoh"), ("c10_pa", "500.0"), ("c20_pa", "10.0")],
        &[("model", "veronda_westmann"), ("shear_modulus_pa", "500.0"), ("stiffening_exponent", "2.0")],
    ];
    let of_law = |law: &&[(&str, &str)]| {
        let keys: Vec<_> = law.iter().map(|(k, v)| Override::text(&format!("material.{k}"), v, "test")).collect();
        whole.with(&keys).unwrap()
    };
    let mut scenes: Vec<Scene> = laws.iter().map(of_law).collect();
    let frictional = whole.with(&[Override::text("instrument.interaction", "frictional", "test")]).unwrap();
    scenes.extend([whole.clone(), cuboid, mesh, frictional]);
    scenes.extend(scenes.clone().iter().map(with_regions));
    for key in KEYS.iter() {
        let path = match key.section() {
            "targets" => format!("targets.1.{}", key.field()),
            "materials" => format!("materials.skin.{}", key.field()),
            "regions" => format!("regions.{}.{}", if key.field() == "group" { "group" } else { "inner" }, key.field()),
            _ => key.path.to_owned(),
        };
        let known = |scene: &&Scene| scene.get(&path).is_some();
        let outer = path.replace("inner", "outer");
        let path = if scenes.iter().any(|s| known(&s)) { path.clone() } else { outer };
        let scene = scenes.iter().find(|scene| scene.get(&path).is_some());
        let scene = scene.unwrap_or_else(|| panic!("{path} applies to no scene"));
        let value = scene.get(&path).unwrap();
        let mut set = scene.clone();
        set.set(&path, &value.to_string()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(&set, scene, "{path} = {value}");
    }
}

/// The scene with its own material as `skin`, and regions of every shape.
fn with_regions(scene: &Scene) -> Scene {
    let text = scene.to_toml();
    let own =
        text.split("\n[").find(|part| part.starts_with("material]")).unwrap().replace("material]", "[materials.skin]");
    let region = |name: &str, keys: &str| format!("[[regions]]\nname = \"{name}\"\nmaterial = \"skin\"\n{keys}\n");
    let mut regions =
        region("inner", "shape = \"cylinder\"\ncentre_m = [0, 0, 0.005]\nradius_m = 0.001\nheight_m = 0.002")
            + &region("outer", "shape = \"layer\"\nto_depth_m = 0.001")
            + &region("ball", "shape = \"sphere\"\ncentre_m = [0, 0, 0.005]\nradius_m = 0.003");
    if text.contains("shape = \"mesh\"") {
        regions += &region("group", "shape = \"group\"\ngroup = \"tumour\"");
    } else if text.contains("shape = \"box\"") {
        regions = regions.replace("cylinder\"", "box\"\nsize_m = [0.002, 0.002, 0.002]");
        regions = regions.replacen("\nradius_m = 0.001\nheight_m = 0.002", "", 1);
    }
    Scene::from_toml(&(text + "\n" + &own + "\n" + &regions), "regions.toml").unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn every_key_can_be_changed() {
    let whole = Scene::preset("needle_insertion").unwrap();
    for key in KEYS.iter() {
        let path = match key.section() {
            "targets" => format!("targets.1.{}", key.field()),
            _ => key.path.to_owned(),
        };
        let Some(old) = whole.get(&path) else { continue };
        if path == "motion.start_depth_m" {
            continue; // for a needle with friction only, which tests/twin/needle_friction.rs starts within the tissue
        }
        let new = match (&key.kind, &old) {
            (Kind::Text, _) => Value::from("another"),
            (Kind::Word(words), Value::Text(old)) => match words.iter().find(|word| *word != old) {
                Some(word) if !["sample.shape", "instrument.kind", "material.model"].contains(&path.as_str()) => {
                    Value::from(*word)
                }
                _ => continue, // one word only, or a change of kind, which has its own test
            },
            (Kind::Real(_), Value::Real(x)) if path.ends_with("radius_m") => Value::Real(x * 1.5),
            (Kind::Real(_), Value::Real(x)) => Value::Real(if *x == 0.0 { 0.001 } else { x * 0.9990234375 }),
            (Kind::Integer(..), Value::Integer(i)) => Value::Integer(i + 1),
            (Kind::OneOf(choices), Value::Integer(i)) => {
                Value::Integer(*choices.iter().find(|choice| *choice != i).expect("a key with one value is none"))
            }
            (Kind::Boolean, Value::Boolean(yes)) => Value::Boolean(!yes),
            (Kind::Point, _) => Value::Point([0.001, 0.002, 0.003]),
            (Kind::List(..), _) => continue, // comes in pairs, which have a test of their own
            (kind, value) => panic!("{path}: {value} in {kind:?}"),
        };
        let changed = whole.with(&[Override::typed(&path, new.clone(), "test")]).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(changed.get(&path), Some(new), "{path}");
        assert_ne!(changed, whole, "{path} reaches the scene");
    }
}

#[test]
fn lists_of_a_material_come_in_pairs() {
    let change = |pairs: &[(&str, &str)]| {
        let changes: Vec<_> = pairs.iter().map(|(path, value)| Override::text(path, value, "--set")).collect();
        Scene::preset("compression").unwrap().with(&changes)
    };
    let ogden = |moduli, exponents| {
        [
            ("material.model", "ogden"),
            ("material.ogden_shear_moduli_pa", moduli),
            ("material.ogden_exponents", exponents),
        ]
    };
    let scene = change(&ogden("1000, 678", "[2, -4]")).unwrap();
    assert_eq!(scene.material.shear_modulus(), 1678.0, "the sum of the terms");
    assert_eq!(scene.get("material.ogden_exponents"), Some(Value::List(vec![2.0, -4.0])));
    assert_eq!(scene.get("material.shear_modulus_pa"), None, "said by the terms");
    let relaxing = change(&[("material.prony_shares", "[0.3, 0.2]"), ("material.prony_times_s", "0.5, 10")]).unwrap();
    assert_eq!(
        (relaxing.material.prony.shares(), relaxing.material.prony.times()),
        (&[0.3, 0.2][..], &[0.5, 10.0][..])
    );
    for (changes, parts) in [
        (&ogden("1000, 678", "2")[..], &["material.ogden_exponents", "1 numbers", "has 2"] as &[&str]),
        (&ogden("1678", "0"), &["material.ogden_exponents", "0.0", "0.01"]),
        (&ogden("[]", "[]"), &["material.ogden_exponents", "at least one term"]),
        (&ogden("1678, -10", "2, 4"), &["ogden_shear_moduli_pa", "-10", "(0, ", "unstable", "a_k / 2"]),
        (&ogden("1678", "31"), &["ogden_exponents", "31", "[-30, 30]"]),
        (&ogden("1,1,1,1,1,1,1", "1,1,1,1,1,1,1"), &["ogden_shear_moduli_pa", "at most 6"]),
        (&ogden("soft", "2"), &["ogden_shear_moduli_pa", "soft", "list of"]),
        (&ogden("1678", "2")[..1], &["material.ogden_exponents", "missing"]),
        (&[("material.ogden_exponents", "2")], &["material.ogden_exponents", "neo_hookean", "ogden"]),
        (&[("material.model", "ogdn")], &["ogdn", "did you mean ogden"]),
        (&[("material.volumetric", "log")], &["log", "quadratic, logarithmic"]),
        (&[("material.prony_share", "0.5")], &["material.prony_share", "material.prony_shares"]),
        (&[("material.prony_shares", "0.5")], &["material.prony_times_s", "0 numbers", "has 1"]),
        (
            &[("material.prony_shares", "0.5, 0.5"), ("material.prony_times_s", "1, 2")],
            &["material.prony_shares", "sum is 1", "liquid"],
        ),
        (&[("material.prony_shares", "1.5"), ("material.prony_times_s", "1")], &["prony_shares", "1.5", "(0, 1)"]),
        (&[("material.prony_shares", "0.5"), ("material.prony_times_s", "0")], &["prony_times_s", "0.0", "(0, "]),
        (&[("material.prony_shares", "0.5"), ("material.prony_times_s", "-1")], &["prony_times_s", "-1.0", "(0, "]),
    ] {
        assert_names(&refusal(change(changes)), parts);
    }
}

#[test]
fn every_default_is_allowed() {
    for key in KEYS.iter() {
        if let Some(text) = key.default {
            key.parse(text, "default").unwrap_or_else(|e| panic!("{e}"));
        }
        assert!(!key.description.is_empty() && !key.allowed().is_empty(), "{}", key.path);
        if let Some((selector, words)) = key.only_with {
            let element = selector.replace("materials.", "materials.any.").replace("regions.", "regions.any.");
            let selector = keys::find(&element).unwrap_or_else(|| panic!("{selector}"));
            assert!(matches!(selector.kind, Kind::Word(all) if words.iter().all(|word| all.contains(word))));
        }
        let named_unit =
            [("_pa", "Pa"), ("_kg_per_m3", "kg/m3"), ("_m_per_s", "m/s"), ("_n_per_m", "N/m"), ("_j_per_m2", "J/m2")]
                .into_iter()
                .chain([("_hz", "Hz"), ("_s", "s"), ("_m", "m"), ("_n", "N")])
                .find(|(suffix, _)| key.path.ends_with(suffix));
        if let Some((_, unit)) = named_unit {
            assert_eq!(key.unit, unit, "{}: the name carries the unit", key.path);
        }
    }
}

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

#[test]
fn live_keys_are_those_that_change_no_cloud() {
    let live: Vec<_> = KEYS.iter().filter(|key| key.live).map(|key| key.path).collect();
    assert!(live.contains(&"instrument.deformation_coefficient") && live.contains(&"stepping.tolerance"));
    assert!(live.iter().all(|path| path.starts_with("instrument.") || path.starts_with("stepping.")));
}

#[test]
fn motion_reaches_depth_holds_and_comes_back() {
    let mut scene = Scene::preset("needle_insertion").unwrap();
    let poses: Vec<_> = scene.motion.unwrap().poses().collect();
    assert_eq!(poses.len(), 10_001);
    assert_eq!(poses[0], (0.0, 0.0));
    assert_eq!(poses[10_000], (10.0, 0.01));
    for (key, value) in [("depth_m", "0.00105"), ("hold_s", "0.002"), ("retract", "true"), ("speed_m_per_s", "0.1")] {
        scene.set(&format!("motion.{key}"), value).unwrap();
    }
    let motion = scene.motion.unwrap();
    let depths: Vec<f64> = motion.poses().map(|(_, depth)| depth).collect();
    assert_eq!(depths.len() as f64, motion.pose_count());
    assert_eq!(depths.iter().filter(|d| **d == 0.00105).count(), 3, "full depth, then held for two intervals");
    assert!(depths.windows(2).all(|w| (w[1] - w[0]).abs() <= 1.0001e-4), "never faster than the speed");
    assert_eq!(depths.last(), Some(&0.0));
    scene.set("motion.insertions", "2").unwrap();
    let twice: Vec<_> = scene.motion.unwrap().poses().collect();
    assert_eq!(twice.len() as f64, scene.motion.unwrap().pose_count());
    assert!(twice.windows(2).all(|w| w[1].0 > w[0].0), "time goes on");
    assert!(twice.iter().map(|(_, depth)| *depth).eq(depths.iter().chain(&depths[1..]).copied()), "once more the same");
    let mirrored: Vec<f64> = depths.iter().rev().copied().collect();
    assert_eq!(depths, mirrored);
}

/// A scene with every number anywhere in its registry range, and words and counts at random. Sizes are drawn as
/// fractions of the sample, so that most of them also fit together.
fn random_scene() -> impl Strategy<Value = Vec<(String, Value)>> {
    let words = (any::<u64>(), proptest::array::uniform32(0.0..1.0f64), "\\PC{0,40}", "[a-z_]{1,12}");
    words.prop_map(|(bits, fraction, description, name)| {
        let mut bits = bits;
        let mut out = Vec::new();
        let height = 1e-3 + fraction[0];
        // materials and regions need a name in a file
        let keys = KEYS.iter().filter(|key| !["materials", "regions"].contains(&key.section()));
        for (key, &f) in keys.zip(fraction.iter().cycle()) {
            let mut pick = |n: usize| {
                let i = bits as usize % n;
                bits = bits.rotate_right(7).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                i
            };
            let value = match (key.path, key.kind) {
                ("name", _) => Value::from(name.as_str()),
                (_, Kind::Text) => Value::from(description.as_str()),
                ("sample.height_m", _) => height.into(),
                ("sample.diameter_m" | "sample.size_x_m" | "sample.size_y_m", _) => (height * (0.5 + f)).into(),
                ("discretisation.spacing_m", _) => (height * (0.02 + 0.2 * f)).into(),
                ("instrument.diameter_m", _) => (height * 0.1 * (f + 0.01)).into(),
                ("instrument.capture_radius_m", _) => (height * 0.1 * (f + 1.0)).into(),
                ("instrument.entry_x_m" | "instrument.entry_y_m", _) => (height * 0.02 * (f - 0.5)).into(),
                ("motion.depth_m", _) => (height * f).into(),
                ("motion.speed_m_per_s", _) => (0.01 + f).into(),
                ("motion.start_depth_m", _) => 0.0.into(),
                ("motion.hold_s", _) => f.into(),
                ("motion.pose_hz", _) => (1.0 + 1e4 * f).into(),
                ("stepping.min_steps_per_pose", _) => Value::Integer(1 + (10.0 * f) as i64),
                ("stepping.max_steps_per_pose", _) => Value::Integer(11 + (1e5 * f) as i64),
                (_, Kind::Word(words)) => Value::from(words[pick(words.len())]),
                (_, Kind::OneOf(choices)) => Value::Integer(choices[pick(choices.len())]),
                ("motion.insertions", _) => Value::Integer(1 + (2.0 * f) as i64),
                (_, Kind::Integer(low, high)) => Value::Integer(low + ((high - low) as f64 * f) as i64),
                (_, Kind::Boolean) => Value::Boolean(pick(2) == 0),
                (_, Kind::Point) => Value::Point([height * 0.3 * (f - 0.5), height * 0.1 * f, height * f]),
                ("material.prony_shares", _) => vec![0.01 + 0.5 * f, 0.4].into(),
                (_, Kind::List(range, _)) => vec![range.high * (0.1 + 0.9 * f), range.high * (0.05 + 0.9 * f)].into(),
                (_, Kind::Real(range)) => (range.low + (range.high - range.low) * (0.001 + 0.998 * f)).into(),
            };
            let path = key.path.replace("targets.", "targets.0.");
            out.push((path, if key.path == "targets.name" { Value::from("t") } else { value }));
        }
        out
    })
}

/// Whether a key belongs to the words that were drawn, and the key that chooses them does too.
fn applies(path: &str, values: &[(String, Value)]) -> bool {
    let Some((selector, words)) = keys::find(path).and_then(|key| key.only_with) else { return true };
    let drawn = values.iter().find(|(p, _)| p == selector).map(|(_, value)| value);
    applies(selector, values) && words.iter().any(|w| Some(&Value::from(*w)) == drawn)
}

/// The random values that apply to the words that were drawn, on the sample that was drawn.
fn build(values: &[(String, Value)]) -> Result<Scene, SceneError> {
    let changes: Vec<_> = values
        .iter()
        .filter(|(path, _)| applies(path, values))
        .map(|(path, value)| Override::typed(path, value.clone(), "random"))
        .collect();
    Scene::from_toml(MINIMAL, "minimal")?.with(&changes)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, max_global_rejects: 4096, ..ProptestConfig::default() })]

    #[test]
    fn a_scene_survives_being_written_and_read(values in random_scene()) {
        let scene = match build(&values) {
            Ok(scene) => scene,
            Err(SceneError::Inconsistent { .. }) => return Err(TestCaseError::reject("parts don't fit")),
            Err(error) => return Err(TestCaseError::fail(error.to_string())),
        };
        let text = scene.to_toml();
        let again = Scene::from_toml(&text, "again.toml");
        prop_assert_eq!(again.as_ref(), Ok(&scene), "{}", text);
        for path in scene.paths() {
            prop_assert!(scene.get(&path).is_some());
        }
    }

    #[test]
    fn random_text_never_panics(text in "\\PC*") {
        let _ = Scene::from_toml(&text, "random");
    }

    #[test]
    fn random_bytes_of_toml_like_text_never_panic(text in "[\\[\\]=\"'#.,\\n a-z0-9_{}-]{0,200}") {
        let _ = Scene::from_toml(&text, "random");
    }

    #[test]
    fn a_damaged_scene_file_never_panics(at in 0usize..2000, with in "\\PC{0,3}", cut in 0usize..40) {
        let mut text: Vec<char> = PRESETS[2].text.chars().collect();
        let start = at.min(text.len());
        let end = (start + cut).min(text.len());
        text.splice(start..end, with.chars());
        let _ = Scene::from_toml(&text.into_iter().collect::<String>(), "damaged");
    }

    #[test]
    fn random_settings_never_panic(path in "[a-z0-9_.]{0,30}", value in "\\PC{0,20}", i in 0usize..100) {
        let mut scene = Scene::preset("needle_insertion").unwrap();
        let _ = scene.set(&path, &value);
        let _ = scene.set(KEYS[i % KEYS.len()].path, &value);
        let _ = Override::parse(&value, "--set");
    }

    #[test]
    fn random_numbers_never_panic(x in any::<f64>(), i in 0usize..100) {
        let mut scene = Scene::preset("needle_insertion").unwrap();
        let _ = scene.set(KEYS[i % KEYS.len()].path, &format!("{x:?}"));
    }
}

#[test]
fn words_and_their_types_agree() {
    let methods: Vec<_> = Method::WORDS.iter().map(|word| Method::from_word(word)).collect();
    assert_eq!(methods, [Some(Method::Mmls), Some(Method::Mls), Some(Method::Tet4)]);
    assert_eq!(Precision::from_word(Precision::F64.as_str()), Some(Precision::F64));
    assert_eq!(VolumeRatio::from_word("averaged"), Some(VolumeRatio::Averaged));
}
