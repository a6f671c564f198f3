//! Contract of scene files: presets load, every key can be set, a scene survives being written and read,
//! and nothing that a user can write makes the reader panic.
#![allow(clippy::unwrap_used, clippy::panic)]

use mtled::solver::Precision;
use needle_core::scene::keys::{self, KEYS};
use needle_core::scene::{
    Correction, Dimension, InstrumentKind, Kind, Method, Override, PRESETS, Scene, SceneError, Shape, Value,
    VolumeRatio, Word,
};

pub const MINIMAL: &str = r#"
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

pub fn minimal_with(more: &str) -> Result<Scene, SceneError> {
    Scene::from_toml(&format!("{MINIMAL}{more}"), "mine.toml")
}

/// The message of a scene that must be refused.
pub fn refusal(result: Result<Scene, SceneError>) -> String {
    match result {
        Ok(scene) => panic!("accepted: {scene:?}"),
        Err(error) => error.to_string(),
    }
}

pub fn assert_names(message: &str, parts: &[&str]) {
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

/// With another coefficient on the way out tissue would stay displaced, so one key is enough.
#[test]
fn tissue_goes_back_as_it_came_unless_said_otherwise() {
    let back = |scene: &Scene| scene.get("instrument.retraction_coefficient").unwrap().as_real();
    let needle = Scene::preset("needle_insertion").unwrap();
    let with = |scene: &Scene, keys: &[(&str, f64)]| {
        let keys: Vec<_> = keys.iter().map(|(path, value)| Override::typed(path, *value, "test")).collect();
        scene.with(&keys).unwrap()
    };
    const IN: &str = "instrument.deformation_coefficient";
    const OUT: &str = "instrument.retraction_coefficient";
    assert_eq!(back(&needle), Some(0.4));
    let half = with(&needle, &[(IN, 0.5)]);
    assert_eq!(back(&half), Some(0.5));
    assert_eq!(back(&Scene::from_toml(&half.to_toml(), "half.toml").unwrap()), Some(0.5));
    let apart = with(&needle, &[(IN, 0.5), (OUT, 0.2)]);
    assert_eq!(back(&apart), Some(0.2));
    assert_eq!(back(&with(&apart, &[(IN, 0.6)])), Some(0.2), "they were not equal");
    let text =
        needle.to_toml().replace("retraction_coefficient", "# ").replace("_coefficient = 0.4", "_coefficient = 0.55");
    assert_eq!(back(&Scene::from_toml(&text, "file.toml").unwrap()), Some(0.55));
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
    if cfg!(feature = "research") {
        let full = [("discretisation.dimension", "full"), ("discretisation.cells", "hexahedra")];
        let keys: Vec<_> = full.iter().map(|(k, v)| Override::text(k, v, "test")).collect();
        scenes.push(Scene::preset("compression").unwrap().with(&keys).unwrap());
    }
    let bent = [
        ("instrument.tip", "bevel"),
        ("instrument.bevel_force_n", "0.001"),
        ("instrument.flexible", "true"),
        ("instrument.length_m", "0.1"),
    ];
    scenes.push(whole.with(&bent.map(|(key, value)| Override::text(key, value, "test"))).unwrap());
    scenes.push(corrected(&whole));
    scenes.push(whole.with(&[Override::text("align.contact_depth_m", "0.001", "test")]).unwrap());
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

/// The scene with a correction of its cloud at two depths.
fn corrected(scene: &Scene) -> Scene {
    let similarity = [1.01, 0.0, 0.02, 0.0];
    let correction = Correction {
        apply: true,
        learnt_from: "a finer cloud".to_owned(),
        left: 0.01,
        of: scene.correction_digest(),
        mesh: scene.sample.mesh_digest(),
        depths: vec![0.001, 0.002],
        force: similarity.repeat(2),
        targets: similarity.repeat(2 * scene.targets.len()),
        checksum: String::new(),
    };
    Scene { correction: Some(correction.sealed()), ..scene.clone() }
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
        // hexahedra have tests of their own: tests/twin/mesh_hexahedra.rs
        // a needle that bends has a length: tests/twin/needle_bending.rs
        if ["motion.start_depth_m", "discretisation.cells", "instrument.flexible"].contains(&path.as_str()) {
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
            (Kind::Real(_), _) if path.ends_with("support_factor") => Value::Real(1.9),
            (Kind::Real(_), Value::Real(x)) => Value::Real(if *x == 0.0 { 0.001 } else { x * 0.9990234375 }),
            (Kind::Real(_), Value::Text(_)) => Value::Real(if path.ends_with("spacing_m") { 0.002 } else { 0.2 }),
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
            let selects = match selector.kind {
                Kind::Word(all) => words.iter().all(|word| all.contains(word)),
                Kind::Boolean => words.iter().all(|word| ["true", "false"].contains(word)),
                _ => false,
            };
            assert!(selects, "{} by {words:?}", selector.path);
        }
        let named_unit = [
            ("_pa", "Pa"),
            ("_kg_per_m3", "kg/m3"),
            ("_m_per_s", "m/s"),
            ("_n_per_m", "N/m"),
            ("_n_per_s", "N/s"),
            ("_j_per_m2", "J/m2"),
        ]
        .into_iter()
        .chain([("_hz", "Hz"), ("_s", "s"), ("_m", "m"), ("_n", "N")])
        .find(|(suffix, _)| key.path.ends_with(suffix));
        if let Some((_, unit)) = named_unit {
            assert_eq!(key.unit, unit, "{}: the name carries the unit", key.path);
        }
    }
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

#[test]
fn words_and_their_types_agree() {
    let methods: Vec<_> = Method::WORDS.iter().map(|word| Method::from_word(word)).collect();
    assert_eq!(methods, [Some(Method::Mmls), Some(Method::Mls), Some(Method::Tet4)]);
    assert_eq!(Precision::from_word(Precision::F64.as_str()), Some(Precision::F64));
    assert_eq!(VolumeRatio::from_word("averaged"), Some(VolumeRatio::Averaged));
}
