// Any text as a scene, and any changes to it: shared by the fuzz target in `fuzz/` and by `tests/fuzz.rs`.

use needle_core::scene::{Override, Scene};

/// The scene stands before a line `---`, changes `key=value` behind it.
pub fn exercise(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let (scene, changes) = text.split_once("\n---\n").unwrap_or((&text, ""));
    match Scene::from_toml(scene, "fuzz.toml") {
        Ok(scene) => changed(&scene, changes),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn changed(scene: &Scene, changes: &str) {
    sound(scene);
    let changes: Vec<Override> =
        changes.lines().filter_map(|l| l.split_once('=')).map(|(k, v)| Override::text(k, v, "fuzz")).collect();
    match scene.with(&changes) {
        Ok(scene) => sound(&scene),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// A scene that was let in can be solved.
fn sound(scene: &Scene) {
    assert!(scene.motion.as_ref().is_none_or(|m| m.depth.get().is_finite() && m.depth.get() >= 0.0));
    assert!(scene.material.density.get() > 0.0 && scene.material.density.get().is_finite());
    assert!(scene.material.bulk_modulus().is_finite());
}
