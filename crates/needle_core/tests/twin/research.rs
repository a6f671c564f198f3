//! Contract of the feature `research`: a build without it refuses keys and words for research with the reason, reads their defaults, and
//! neither lists nor writes them.
#![allow(clippy::unwrap_used)]

use needle_core::scene::keys::{self, KEYS};
use needle_core::scene::{Kind, Override, Research, Scene};

/// What only research sets.
const CHANGES: [(&str, &str); 4] = [
    ("discretisation.penalty", "0.02"),
    ("discretisation.cells", "hexahedra"),
    ("discretisation.volume_ratio", "averaged"),
    ("instrument.deformation_rule", "absolute"),
];

fn needle(key: &str, value: &str) -> Result<Scene, String> {
    let full = Override::text("discretisation.dimension", "full", "test");
    let change = Override::text(key, value, "test");
    Scene::preset("needle_insertion").unwrap().with(&[full, change]).map_err(|e| e.to_string())
}

#[test]
fn what_is_for_research_needs_a_build_for_it() {
    for (key, value) in CHANGES {
        let said = needle(key, value);
        if cfg!(feature = "research") {
            assert_eq!(said.unwrap().get(key).unwrap().to_string().trim_matches('"'), value);
            continue;
        }
        let said = said.unwrap_err();
        for part in ["test: ", key, value, "--features research"] {
            assert!(said.contains(part), "\"{part}\" is not named in: {said}");
        }
        let description = keys::find(key).unwrap().description.trim_end_matches('.');
        assert!(said.contains(description), "{said}");
    }
    let said = Scene::preset("needle_insertion")
        .unwrap()
        .to_toml()
        .replace("[discretisation]", "[discretisation]\npenalty = 0.02");
    let said = Scene::from_toml(&said, "old.toml").map_err(|e| e.to_string());
    assert!(cfg!(feature = "research") || said.unwrap_err().starts_with("old.toml:"));
}

#[test]
fn files_that_write_a_default_out_are_read() {
    let scene = needle("discretisation.penalty", "1e-2").unwrap();
    let text = scene.to_toml();
    let written = |text: &str| text.contains("penalty = ");
    assert_eq!(written(&text), cfg!(feature = "research"));
    let old = if written(&text) { text } else { text.replace("[discretisation]", "[discretisation]\npenalty = 0.01") };
    assert_eq!(Scene::from_toml(&old, "old.toml").unwrap(), scene);
}

#[test]
fn lists_of_keys_have_what_is_built() {
    let listed = |path: &str| KEYS.iter().any(|key| key.path == path);
    assert_eq!(listed("discretisation.penalty"), cfg!(feature = "research"));
    assert_eq!(listed("discretisation.points_per_hexahedron"), cfg!(feature = "research"));
    for key in KEYS.iter() {
        if let (Research::Words(research), Kind::Word(words)) = (key.research, key.kind) {
            assert!(research.iter().all(|word| words.contains(word) == cfg!(feature = "research")), "{}", key.path);
        }
    }
    let shown = Scene::preset("needle_insertion").unwrap().paths();
    assert_eq!(shown.iter().any(|path| path == "discretisation.penalty"), cfg!(feature = "research"));
}
