//! Contract of scenes that nobody has thought of: each random one is refused with a reason, or is the same after being written and read.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::scenes::MINIMAL;
use needle_core::scene::keys::{self, KEYS};
use needle_core::scene::{Kind, Override, PRESETS, Scene, SceneError, Value};
use proptest::prelude::*;

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
    let selects = |word: &str| match drawn {
        Some(Value::Boolean(yes)) => yes.to_string() == word,
        drawn => Some(&Value::from(word)) == drawn,
    };
    applies(selector, values) && words.iter().any(|word| selects(word))
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
    #![proptest_config(ProptestConfig { cases: 512, max_global_rejects: 16384, ..ProptestConfig::default() })]

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
